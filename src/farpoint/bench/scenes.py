"""Simulated scenes that several tables use."""

from __future__ import annotations

import math

import numpy as np

from farpoint.synthetic import (
    PAPER_NOISE_PX,
    PointScene,
    PointSceneOptions,
    make_point_scene,
    paper_camera,
)

__all__ = ["draw_scenes"]

_MAX_TURN_DEG = 5.0


def draw_scenes(
    count: int,
    rng: np.random.Generator,
    *,
    baseline_m: float,
    far_share: float,
    matches: int,
    outliers: int,
    noise_px: float = PAPER_NOISE_PX,
) -> list[PointScene]:
    """Scenes as in the paper: near points at 1-4 m, far points at 25-35 m.

    The rotation about each axis is at most 5 degrees. The direction of the translation is random.

    Parameters
    ----------
    count : int
        Number of scenes.
    rng : numpy.random.Generator
        Random generator for motions, points and noise.
    baseline_m : float
        Length of the translation, m.
    far_share : float
        Share of the true matches that are far, 0 to 1.
    matches, outliers : int
        Number of all matches, and number of outliers among these matches.
    noise_px : float
        1-sigma of the noise of a coordinate, px.
    """
    scenes = []
    for _ in range(count):
        turn = np.radians(rng.uniform(-_MAX_TURN_DEG, _MAX_TURN_DEG, 3))
        direction = rng.normal(size=3)
        translation = baseline_m / math.hypot(*direction) * direction
        options = PointSceneOptions(
            camera=paper_camera(),
            matches=matches,
            outliers=outliers,
            far_share=far_share,
            near_range_m=(1.0, 4.0),
            far_range_m=(25.0, 35.0),
            rotation_vector_rad=(turn[0], turn[1], turn[2]),
            translation_m=(translation[0], translation[1], translation[2]),
            noise_px=noise_px,
        )
        scenes.append(make_point_scene(options, seed=rng))
    return scenes
