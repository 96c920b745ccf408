"""Kernels compiled once for all workers of a machine."""

from __future__ import annotations

import dataclasses

import numpy as np

from farpoint.camera import Camera, KannalaBrandt
from farpoint.odometry import Odometry
from farpoint.pose import RelativePoseOptions, estimate_relative_pose
from farpoint.sinks.kernels.discs import draw_discs

__all__ = ["compile_kernels"]

_LENS = (320, 240, 240.0, 240.0, 159.5, 119.5)
# A pinhole has different kernels with and without distortion; a rolling shutter has its own.
_CAMERAS = (
    Camera.pinhole(*_LENS),
    Camera.pinhole(*_LENS, distortion=(0.01, 0.0, 0.0, 0.0)).with_readout(0.02, 0.002),
)
_FRAMES = 5
_SEEDS = 8  # scenes of each kind; in about 50 % of them the search finds a secondary mode


def compile_kernels() -> None:
    """Compile all kernels of later runs into numba's cache on this machine.

    The function runs small drives and estimates motions in scenes of many kinds. The images are
    large enough for 60 matches, because halves of the tracks correct the covariance only from 60
    matches on.
    """
    # Loaded on use: only this function needs the scenes.
    from farpoint.synthetic import PointSceneOptions, make_point_scene, render_drive

    for camera in _CAMERAS:
        odometry = Odometry(camera)
        for result in odometry.run(render_drive(camera, frames=_FRAMES, seed=0)):
            if result.pose is not None:
                odometry.split_half(result)
    lens = KannalaBrandt(fx=200.0, fy=200.0, cx=159.5, cy=119.5)
    fisheye = Camera(model=lens, size=_LENS[:2])
    usual = PointSceneOptions(camera=_CAMERAS[0])
    rotation = dataclasses.replace(
        usual, translation_m=(0.0, 0.0, 0.0), rotation_vector_rad=(0.02, 0.0, 0.0)
    )
    # In this order: general motion; little parallax; uncertain direction with many matches; large
    # noise; two modes; rotation without translation.
    for options in (
        dataclasses.replace(usual, camera=fisheye, matches=600),
        dataclasses.replace(usual, far_share=0.8, translation_m=(0.02, 0.0, 0.0)),
        dataclasses.replace(usual, matches=300, noise_px=1.0, translation_m=(0.03, 0.0, 0.0)),
        dataclasses.replace(usual, noise_px=3.0),
        dataclasses.replace(
            usual,
            matches=60,
            outliers=0,
            far_share=0.0,
            near_range_m=(3.0, 3.1),
            translation_m=(0.1, 0.0, 0.0),
            noise_px=0.5,
        ),
        rotation,
    ):
        for seed in range(_SEEDS):
            scene = make_point_scene(options, seed=seed)
            given = scene.points0, scene.points1, scene.camera
            estimate_relative_pose(*given)
            estimate_relative_pose(*given, options=RelativePoseOptions(refine=False))
    draw_discs(np.zeros((8, 8, 3), np.uint8), np.array([[4.0, 4.0]]), 2.0, (0, 0, 0))
