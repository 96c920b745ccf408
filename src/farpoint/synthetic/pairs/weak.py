"""Pairs with little parallax, few matches, much noise, or noise common to neighbours."""

from __future__ import annotations

import numpy as np

from farpoint.geometry import sphere
from farpoint.synthetic.pairs.pair import HardPair, of_scene, vga_camera
from farpoint.synthetic.paper import paper_camera
from farpoint.synthetic.points import PointScene, PointSceneOptions, make_point_scene

__all__ = ["few", "mostly_far", "pure_rotation", "short", "smooth_errors", "smooth_field"]

_TURN_RAD = (0.02, 0.05, -0.03)


def mostly_far(seed: int, *, matches: int = 110) -> PointScene:
    """90 % of the inliers at 25 to 35 m, 10 % at 1 to 4 m; translation of 20 cm, noise of 1 px."""
    return _paper_scene(
        seed,
        matches=matches,
        outliers=matches // 5,
        far_share=0.9,
        noise_px=1.0,
        translation_m=(0.2, 0.0, 0.0),
    )


def short(seed: int, *, matches: int = 90, outliers: int = 0) -> PointScene:
    """A translation of 2 cm to the side with noise of 1 px; half of the inliers at 25 to 35 m."""
    return _paper_scene(
        seed,
        matches=matches,
        outliers=outliers,
        noise_px=1.0,
        far_share=0.5,
        translation_m=(0.02, 0.0, 0.0),
    )


def few(seed: int, *, matches: int = 15, outliers: int = 4) -> PointScene:
    """Few matches of near and far points, some of them wrong, and a translation of 20 cm."""
    return _paper_scene(seed, matches=matches, outliers=outliers, translation_m=(0.2, 0.0, 0.0))


def pure_rotation(seed: int, *, outliers: int = 50) -> PointScene:
    """A rotation without translation, with many outliers."""
    return _paper_scene(seed, outliers=outliers, translation_m=(0.0, 0.0, 0.0))


def smooth_errors(
    seed: int, *, baseline_m: float, size_px: float = 0.4, reach_px: float = 80.0
) -> HardPair:
    """Matches with the errors of a `smooth_field` in image 1, in addition to noise of 0.15 px.

    Errors of a calibration or of a rolling shutter change smoothly over the image, too.
    """
    direction = sphere.normalize(np.random.default_rng(seed).normal(size=3))
    options = PointSceneOptions(
        camera=vga_camera(),
        matches=300,
        outliers=15,
        rotation_vector_rad=_TURN_RAD,
        translation_m=tuple(baseline_m * direction),
        noise_px=0.15,
    )
    scene = make_point_scene(options, seed=seed)
    return of_scene(scene, scene.points1 + smooth_field(seed, scene.points1, size_px, reach_px))


def smooth_field(
    seed: int, points: np.ndarray, size_px: float = 0.4, reach_px: float = 80.0
) -> np.ndarray:
    """Errors (N, 2), px, that change smoothly over the image.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Pixels.
    size_px : float
        1-sigma of each coordinate, px.
    reach_px : float
        Distance, px, up to which the errors of two points are correlated.
    """
    rng = np.random.default_rng(seed)
    waves = 40
    phase = points @ rng.normal(0.0, 1.0 / reach_px, (2, waves)) + rng.uniform(0.0, 6.3, waves)
    return np.cos(phase) @ rng.normal(0.0, size_px * np.sqrt(2.0 / waves), (waves, 2))


def _paper_scene(seed: int, **options) -> PointScene:
    camera = paper_camera()
    options = {"camera": camera, "rotation_vector_rad": _TURN_RAD, **options}
    return make_point_scene(PointSceneOptions(**options), seed=seed)
