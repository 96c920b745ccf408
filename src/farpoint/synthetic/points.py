"""Point scenes: matches between two views of random points, with exact truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3, sphere
from farpoint.options import coerce_float, coerce_int

__all__ = ["OutlierKind", "PointScene", "PointSceneOptions", "make_point_scene"]

_BATCH = 4096
_BATCHES = 50
_MARGIN_SIGMA = 5.0  # distance of true pixels from the image border, in sigma of the noise


class OutlierKind(Enum):
    """Distribution of the outliers."""

    UNIFORM = "uniform"
    """Outliers lie anywhere in image 1."""
    EPIPOLAR = "epipolar"
    """Outliers lie anywhere on the epipolar line in image 1: no epipolar test can detect them."""


@dataclass(frozen=True, kw_only=True)
class PointSceneOptions:
    """Options of a point scene.

    Attributes
    ----------
    camera : Camera
        Camera of both images. The image size must be known.
    matches : int
        Number of all matches, including outliers.
    outliers : int
        Number of outliers.
    outlier_kind : OutlierKind
        Distribution of the outliers.
    far_share : float
        Share of the inliers in the far range, 0 to 1. The number of far inliers is rounded.
    near_range_m, far_range_m : (float, float)
        Ranges from which distances from camera 0 along the ray, m, are drawn uniformly. If both
        ends of a range are infinite, the points of the range are at infinity.
    rotation_vector_rad : (float, float, float)
        Rotation vector: ``R_cam1_from_cam0 = Exp(rotation_vector)``.
    translation_m : (float, float, float)
        Translation of ``X_cam1 = R_cam1_from_cam0 @ X_cam0 + translation``, m.
    noise_px : float
        1-sigma of the normal noise on each pixel coordinate in each image, px.

    Raises
    ------
    InputError
        If a field is out of its range.
    """

    camera: Camera
    matches: int = 110
    outliers: int = 20
    outlier_kind: OutlierKind = OutlierKind.UNIFORM
    far_share: float = 0.5
    near_range_m: tuple[float, float] = (1.0, 4.0)
    far_range_m: tuple[float, float] = (25.0, 35.0)
    rotation_vector_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    translation_m: tuple[float, float, float] = (0.0, 0.0, -0.3)
    noise_px: float = math.sqrt(0.05)

    def __post_init__(self) -> None:
        if self.camera.size is None:
            raise InputError("expected a camera of known image size", field="camera")
        coerce_int(self, 1, "matches")
        coerce_int(self, 0, "outliers")
        if self.outliers > self.matches:
            raise InputError(f"expected 0 to {self.matches}, got {self.outliers}", field="outliers")
        coerce_float(self, "0 to 1", lambda share: 0 <= share <= 1, "far_share")
        coerce_float(self, "0 or more px", lambda noise: noise >= 0, "noise_px")
        for name in ("near_range_m", "far_range_m"):
            low, high = getattr(self, name)
            if not 0.0 < low <= high or (math.isinf(high) and not math.isinf(low)):
                raise InputError(f"expected 0 < low <= high, got {(low, high)}", field=name)
        for name in ("rotation_vector_rad", "translation_m"):
            if not np.isfinite(getattr(self, name)).all():
                raise InputError(f"expected finite numbers, got {getattr(self, name)}", field=name)
        if self.outliers and self.outlier_kind is OutlierKind.EPIPOLAR and not self.baseline_m:
            raise InputError("expected a translation, for epipolar lines", field="translation_m")

    @property
    def baseline_m(self) -> float:
        """Length of the translation, m."""
        return float(np.linalg.norm(self.translation_m))


@dataclass(frozen=True, kw_only=True, eq=False)
class PointScene:
    """Matches of two views in random order, with the ground truth.

    Attributes
    ----------
    camera : Camera
        Camera of both images.
    points0, points1 : ndarray, shape (N, 2)
        Pixels with noise. All matches are inside both images.
    is_outlier : ndarray of bool, shape (N,)
        Whether a match is an outlier.
    is_far : ndarray of bool, shape (N,)
        Whether a match is an inlier in the far range.
    depths : ndarray, shape (N,)
        Distance from camera 0 along the ray, m; NaN for outliers.
    true_rays0 : ndarray, shape (N, 3)
        Unit rays in camera 0 without noise; NaN for outliers.
    rotation_cam1_from_cam0 : ndarray, shape (3, 3)
    translation_cam1_from_cam0 : ndarray, shape (3,)
        ``X_cam1 = R @ X_cam0 + translation``, m.
    noise_px : float
        1-sigma of the noise on each pixel coordinate in each image, px.
    """

    camera: Camera
    points0: np.ndarray
    points1: np.ndarray
    is_outlier: np.ndarray
    is_far: np.ndarray
    depths: np.ndarray
    true_rays0: np.ndarray
    rotation_cam1_from_cam0: np.ndarray
    translation_cam1_from_cam0: np.ndarray
    noise_px: float

    def __len__(self) -> int:
        return len(self.points0)

    @property
    def direction_cam1_from_cam0(self) -> np.ndarray | None:
        """Unit vector along the translation, shape (3,); None for a pure rotation."""
        if not self.translation_cam1_from_cam0.any():
            return None
        return sphere.normalize(self.translation_cam1_from_cam0)

    @property
    def heading_cam0(self) -> np.ndarray | None:
        """Direction of travel in axes of camera 0, unit vector; None for a pure rotation."""
        direction = self.direction_cam1_from_cam0
        return None if direction is None else -self.rotation_cam1_from_cam0.T @ direction


def make_point_scene(
    options: PointSceneOptions, *, seed: int | np.random.Generator = 0
) -> PointScene:
    """Draw a scene with uniform positions in image 0 and uniform distances within the ranges.

    Parameters
    ----------
    options : PointSceneOptions
        Options of the scene.
    seed : int or numpy.random.Generator
        Seed or random generator. The same options and seed give the same scene.

    Raises
    ------
    InputError
        If hardly any point is visible in both images.

    Examples
    --------
    >>> camera = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)
    >>> scene = make_point_scene(PointSceneOptions(camera=camera, matches=30, outliers=5), seed=1)
    >>> scene.points0.shape, int(scene.is_outlier.sum())
    ((30, 2), 5)
    """
    rng = np.random.default_rng(seed)
    inliers = options.matches - options.outliers
    far = round(options.far_share * inliers)
    parts = [
        _draw_true(options, rng, inliers - far, options.near_range_m),
        _draw_true(options, rng, far, options.far_range_m),
        _draw_wrong(options, rng, options.outliers),
    ]
    pixels0, pixels1, rays0, depths = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    kind = np.repeat([0, 1, 2], [inliers - far, far, options.outliers])
    order = rng.permutation(options.matches)
    noise0, noise1 = rng.normal(0.0, options.noise_px, (2, options.matches, 2))
    return PointScene(
        camera=options.camera,
        points0=(pixels0 + noise0)[order],
        points1=(pixels1 + noise1)[order],
        is_outlier=(kind == 2)[order],
        is_far=(kind == 1)[order],
        depths=depths[order],
        true_rays0=rays0[order],
        rotation_cam1_from_cam0=so3.exp(np.array(options.rotation_vector_rad)),
        translation_cam1_from_cam0=np.array(options.translation_m, dtype=np.float64),
        noise_px=options.noise_px,
    )


# Columns of drawn matches: pixels in image 0, pixels in image 1, rays in camera 0, depths.
_Columns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def _draw_true(
    options: PointSceneOptions,
    rng: np.random.Generator,
    count: int,
    range_m: tuple[float, float],
) -> _Columns:
    R = so3.exp(np.array(options.rotation_vector_rad))

    def batch() -> _Columns:
        pixels0 = _uniform_pixels(options, rng)
        rays0 = options.camera.unproject(pixels0)
        depths = rng.uniform(*range_m, _BATCH) if math.isfinite(range_m[1]) else _INFINITE
        # Divided by the depth, so that points at infinity need no special case.
        rays1 = rays0 @ R.T + np.array(options.translation_m) / depths[:, None]
        return pixels0, options.camera.project(rays1), rays0, depths

    return _draw(options, count, batch)


def _draw_wrong(options: PointSceneOptions, rng: np.random.Generator, count: int) -> _Columns:
    def batch() -> _Columns:
        pixels0 = _uniform_pixels(options, rng)
        pixels1 = _uniform_pixels(options, rng)
        if options.outlier_kind is OutlierKind.EPIPOLAR:
            pixels1 = _onto_epipolar_line(options, pixels0, pixels1)
        return pixels0, pixels1, np.full((_BATCH, 3), np.nan), np.full(_BATCH, np.nan)

    return _draw(options, count, batch)


_INFINITE = np.full(_BATCH, math.inf)


def _draw(options: PointSceneOptions, count: int, batch: Callable[[], _Columns]) -> _Columns:
    """Draw batches of matches until ``count`` matches are visible in both images."""
    kept: list[_Columns] = []
    missing = count
    for _ in range(_BATCHES):
        columns = batch()
        seen = np.flatnonzero(_inside(options, columns[0]) & _inside(options, columns[1]))[:missing]
        kept.append(tuple(column[seen] for column in columns))  # pyright: ignore[reportArgumentType]
        missing -= len(seen)
        if missing == 0:
            pixels0, pixels1, rays0, depths = (np.concatenate(c) for c in zip(*kept, strict=True))
            return pixels0, pixels1, rays0, depths
    raise InputError(
        f"expected a motion after which points stay in view; {_BATCH * _BATCHES} draws gave "
        f"{count - missing} of {count} matches",
        field="translation_m",
    )


def _uniform_pixels(options: PointSceneOptions, rng: np.random.Generator) -> np.ndarray:
    assert options.camera.size is not None
    width, height = options.camera.size
    return rng.uniform((0.0, 0.0), (width - 1.0, height - 1.0), (_BATCH, 2))


def _inside(options: PointSceneOptions, pixels: np.ndarray) -> np.ndarray:
    assert options.camera.size is not None
    margin = _MARGIN_SIGMA * options.noise_px
    upper = np.array(options.camera.size) - 1.0 - margin
    return np.all((pixels >= margin) & (pixels <= upper), axis=1)  # NaN is not inside


def _onto_epipolar_line(
    options: PointSceneOptions, pixels0: np.ndarray, pixels1: np.ndarray
) -> np.ndarray:
    """Move each of ``pixels1`` by the smallest angle onto the epipolar line of ``pixels0``."""
    R = so3.exp(np.array(options.rotation_vector_rad))
    rotated = options.camera.unproject(pixels0) @ R.T
    normals = sphere.normalize(np.cross(np.array(options.translation_m), rotated))
    rays1 = options.camera.unproject(pixels1)
    return options.camera.project(rays1 - normals * np.sum(rays1 * normals, 1, keepdims=True))
