"""Matches in the format of the estimator: pairs of rays with the noise of each ray."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from farpoint._kernels.constants import (
    FLOW,
    LANES,
    LONG_TAIL,
    MIN_VARIANCE_RAD2,
    PANEL,
    RAY0,
    RAY1,
    ROUNDING,
)
from farpoint._kernels.pairs import pack_pairs, packed_length, take_pairs
from farpoint._kernels.pose import PackedMatches
from farpoint._kernels.rounding import rounding_variance
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry.sphere import normalize, tangent_basis
from farpoint.pose.constants import ISOTROPIC, MIN_NOISE_VARIANCE, MISSPECIFIED_FACTOR
from farpoint.pose.given import check_camera, checked_rows, relative_covariances

__all__ = [
    "Matches",
    "PixelMatches",
    "matches_from_points",
    "matches_from_rays",
]


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenNoise:
    """Functions that replace the given noise of each match by another noise.

    Attributes
    ----------
    uniform : callable
        Returns the matches with the same isotropic noise: the median of the given variances.
    with_floor : callable
        Returns the matches with a variance added to every coordinate. The argument is the added
        variance over the median of the given variances. The sums are divided by their new median.
    """

    uniform: Callable[[], Matches]
    with_floor: Callable[[float], Matches]


@dataclass(frozen=True, kw_only=True, eq=False)
class Matches:
    """Pairs of rays with noise, and the row of each pair in the user's arrays.

    Attributes
    ----------
    pairs : ndarray
        Unit rays in camera 0 and camera 1 and the covariances of the rays, packed for the kernels.
    index : ndarray of int, shape (N,)
        Row of each match in the user's arrays. Matches without a ray are left out.
    total : int
        Number of matches that the user gave.
    unit : str
        Unit of the noise: ``"px"``, or ``"noise_rad"`` if the user gave rays.
    outlier_half_width : float
        Half-width of the domain of outliers, in the unit of the noise sigma. A uniform distribution
        over this domain has the variance of a coordinate of the rays in camera 1.
    misspecification : float
        Misspecification factor of the noise: the factor by which the ratio of the variances of a
        match in two directions may differ from that of the noise model. 1 for independent noise
        without given covariances.
    design_effect : float
        Variance of a motion divided by the variance for independent residuals.
    given_noise : GivenNoise or None
        Other versions of the matches, if the user gave the noise of each match.
    min_variance : float
        Lower bound of the noise variance, due to rounding of coordinates; px^2 or noise_rad^2.
    max_variance : float
        Upper bound of the noise variance, infinite for no bound. A finite bound excludes a heavy
        tail.
    prior_odds : ndarray, shape (N,), or None
        Prior odds of each match to be an inlier, divided by those of all matches; None for equal
        odds.
    """

    pairs: np.ndarray
    index: np.ndarray
    total: int
    unit: str
    outlier_half_width: float
    misspecification: float
    design_effect: float = 1.0
    given_noise: GivenNoise | None = None
    min_variance: float = MIN_NOISE_VARIANCE
    max_variance: float = math.inf
    prior_odds: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.index)

    @property
    def tempering(self) -> float:
        """Number by which log-likelihood ratios are divided.

        Log-likelihood ratios are too large by the factor ``misspecification`` if the variance is
        misspecified, and by the factor ``design_effect`` if residuals are correlated, because the
        effective number of matches is then smaller by this factor. The larger of the two factors is
        used.
        """
        return max(self.misspecification, self.design_effect)

    def select(self, rows: np.ndarray) -> Matches:
        """The matches selected by a mask or by indices, with the same domain of outliers."""
        rows = np.flatnonzero(rows) if rows.dtype == bool else rows
        pairs = np.empty(packed_length(len(rows)) // LANES * PANEL)
        take_pairs(self.pairs, rows, pairs)
        return Matches(
            pairs=pairs,
            index=self.index[rows],
            total=self.total,
            unit=self.unit,
            outlier_half_width=self.outlier_half_width,
            misspecification=self.misspecification,
            design_effect=self.design_effect,
            min_variance=self.min_variance,
            max_variance=self.max_variance,
            prior_odds=None if self.prior_odds is None else self.prior_odds[rows],
        )

    def subsample(self, most: int) -> Matches:
        """At most ``most`` matches, with evenly spaced rows."""
        total = len(self)
        return self if total <= most else self.select(np.arange(most) * total // most)

    def used(self, labels: np.ndarray) -> np.ndarray:
        """Rows, in the user's arrays, of the matches whose label (N,) is not 0."""
        return self.index[np.flatnonzero(labels)]

    def with_design_effect(self, design_effect: float, *, is_misspecified: bool) -> Matches:
        """The matches with a design effect, and with misspecified noise if ``is_misspecified``."""
        factor = MISSPECIFIED_FACTOR if is_misspecified else self.misspecification
        return replace(self, misspecification=factor, design_effect=design_effect)

    def with_noise_up_to(self, variance: float) -> Matches:
        """The matches with an upper bound of the noise variance, at least ``min_variance``."""
        return replace(self, max_variance=max(variance, self.min_variance))

    def packed(self, prior: np.ndarray, *, soft_cheirality: bool) -> PackedMatches:
        """The matches in panels, the format of the kernels, with the ``prior`` of each match."""
        n, width = len(self), self.outlier_half_width
        least, most = self.min_variance, self.max_variance
        odds = self.weights() if self.prior_odds is None else self.weights(self.prior_odds)
        return PackedMatches(
            self.pairs, prior, odds, n, width, LONG_TAIL, least, most, soft_cheirality
        )

    def weights(self, values: np.ndarray | float = 1.0) -> np.ndarray:
        """Values (N,) of the matches in the format of the kernels, padded with 0."""
        packed = np.zeros(packed_length(len(self)))
        packed[: len(self)] = values
        return packed

    @property
    def rays0(self) -> np.ndarray:
        """Unit rays (N, 3) in camera 0."""
        return self._rows(RAY0, RAY0 + 3)

    @property
    def rays1(self) -> np.ndarray:
        """Unit rays (N, 3) in camera 1."""
        return self._rows(RAY1, RAY1 + 3)

    @cached_property
    def precision(self) -> np.ndarray:
        """Inverse (N,), rad^-2, of the mean variance of a coordinate of ``b - R a``; sigma = 1."""
        return 1.0 / self._rows(FLOW, FLOW + 1)[:, 0]

    def _rows(self, first: int, end: int) -> np.ndarray:
        """Values (N, end - first) of all matches in the panel rows from ``first`` to ``end``."""
        panels = self.pairs.reshape(-1, PANEL // LANES, LANES)[:, first:end]
        return panels.transpose(0, 2, 1).reshape(-1, end - first)[: len(self)]


Unrolled = Callable[[int, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""New rays (N, 3), and derivatives (N, 3, 2) by the pixel, from those of image 0 or 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PixelMatches:
    """Rays and noise of matching pixels.

    Attributes
    ----------
    rays : tuple of ndarray, shape (N, 3)
        Unit rays of each image.
    by_pixel : tuple of ndarray, shape (N, 3, 2)
        Derivatives of the rays by the pixel.
    covariances : tuple of ndarray, shape (N, 2, 2) or (1, 2, 2)
        Covariances of the pixels, divided by the median variance of both images.
    min_variance : float
        Lower bound of the noise variance.
    """

    rays: tuple[np.ndarray, np.ndarray]
    by_pixel: tuple[np.ndarray, np.ndarray]
    covariances: tuple[np.ndarray, np.ndarray]
    min_variance: float

    @classmethod
    def of(
        cls,
        points0: np.ndarray,
        points1: np.ndarray,
        camera0: Camera,
        camera1: Camera,
        covariance0_px2: np.ndarray | None = None,
        covariance1_px2: np.ndarray | None = None,
    ) -> PixelMatches:
        """Unproject pixels (N, 2) with covariances (N, 2, 2), px^2 up to a common factor.

        If the covariances of only one image are given, the noise of the other image is isotropic,
        with the median of the given variances.
        """
        check_camera("camera0", camera0)
        check_camera("camera1", camera1)
        points0 = checked_rows("points0", points0, (2,))
        points1 = checked_rows("points1", points1, (2,), rows=len(points0))
        covariances = relative_covariances(len(points0), covariance0_px2, covariance1_px2)
        if camera0 is camera1:
            rays, by_pixel = _rays_of(camera0, np.concatenate((points0, points1)))
            n = len(points0)
            images = (rays[:n], by_pixel[:n]), (rays[n:], by_pixel[n:])
        else:
            images = _rays_of(camera0, points0), _rays_of(camera1, points1)
        (rays0, by_pixel0), (rays1, by_pixel1) = images
        return cls(
            rays=(rays0, rays1),
            by_pixel=(by_pixel0, by_pixel1),
            covariances=covariances,
            min_variance=max(rounding_variance(points0, points1), MIN_NOISE_VARIANCE),
        )

    def matches(self, unrolled: Unrolled | None = None) -> Matches:
        """Matches in the format of the estimator.

        ``unrolled`` corrects the rays for the rolling shutter.
        """
        images = tuple(zip(self.rays, self.by_pixel, strict=True))
        if unrolled is not None:
            images = unrolled(0, *images[0]), unrolled(1, *images[1])
        (rays0, by_pixel0), (rays1, by_pixel1) = images

        def packed(first: np.ndarray, second: np.ndarray) -> Matches:
            noise, least = (first, second), ROUNDING**2
            matches = _pack(rays0, rays1, by_pixel0, by_pixel1, noise, least, "px")
            # Only matches on a pixel grid, which are rare, need a copy with another bound.
            same = self.min_variance == MIN_NOISE_VARIANCE
            return matches if same else replace(matches, min_variance=self.min_variance)

        def with_floor(floor: float) -> Matches:
            return packed(*((C + floor * ISOTROPIC) / (1.0 + floor) for C in self.covariances))

        matches = packed(*self.covariances)
        if self.covariances[0] is ISOTROPIC and self.covariances[1] is ISOTROPIC:
            return matches
        uniform = partial(packed, ISOTROPIC, ISOTROPIC)
        return replace(matches, given_noise=GivenNoise(uniform=uniform, with_floor=with_floor))


def matches_from_points(
    points0: np.ndarray,
    points1: np.ndarray,
    camera0: Camera,
    camera1: Camera,
    covariance0_px2: np.ndarray | None = None,
    covariance1_px2: np.ndarray | None = None,
) -> Matches:
    """Matches of pixels (N, 2), taken with global shutters; see `PixelMatches.of`."""
    given = points0, points1, camera0, camera1, covariance0_px2, covariance1_px2
    return PixelMatches.of(*given).matches()


def _rays_of(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays of pixels, and derivatives of the rays by the pixels."""
    rays = camera.unproject(points)
    return rays, camera.unproject_jacobian(rays)


def matches_from_rays(rays0: np.ndarray, rays1: np.ndarray, noise_rad: float) -> Matches:
    """Matches of rays (N, 3) with the isotropic noise ``noise_rad`` for each ray.

    The function normalises the rays.
    """
    rays0 = checked_rows("rays0", rays0, (3,))
    rays1 = checked_rows("rays1", rays1, (3,), rows=len(rays0))
    if not (isinstance(noise_rad, int | float | np.number) and 0 < noise_rad < np.inf):
        raise InputError(f"expected positive radians, got {noise_rad!r}", field="noise_rad")
    for name, rays in (("rays0", rays0), ("rays1", rays1)):
        if not rays.any(axis=1).all():
            raise InputError("expected rays of non-zero length", field=name)
    rays0, rays1 = normalize(_of_usual_length(rays0)), normalize(_of_usual_length(rays1))
    sigma = max(float(noise_rad), MIN_VARIANCE_RAD2**0.5)
    factors0, factors1 = sigma * tangent_basis(rays0), sigma * tangent_basis(rays1)
    return _pack(rays0, rays1, factors0, factors1, (ISOTROPIC, ISOTROPIC), 0.0, "noise_rad")


def _of_usual_length(rays: np.ndarray) -> np.ndarray:
    """Non-zero rays (N, 3). A ray is scaled if its squared length would overflow or vanish."""
    longest = np.abs(rays).max(axis=1, initial=0.0)
    unusual = (longest > 1e100) | (longest < 1e-100)
    if not unusual.any():
        return rays
    return np.where(unusual[:, None], rays / longest[:, None], rays)


def _pack(
    rays0: np.ndarray,
    rays1: np.ndarray,
    factors0: np.ndarray,
    factors1: np.ndarray,
    covariances: tuple[np.ndarray, np.ndarray],
    least_variance: float,
    unit: str,
) -> Matches:
    total = len(rays0)
    pairs, index = np.empty(packed_length(total) // LANES * PANEL), np.empty(total, np.int64)
    count, half_width = pack_pairs(
        rays0, rays1, factors0, factors1, *covariances, least_variance, pairs, index
    )
    if count < total:
        index = index[:count]
        pairs = pairs[: packed_length(count) // LANES * PANEL]
    return Matches(
        pairs=pairs,
        index=index,
        total=total,
        unit=unit,
        outlier_half_width=half_width,
        misspecification=1.0
        if covariances[0] is covariances[1] is ISOTROPIC
        else MISSPECIFIED_FACTOR,
    )
