"""Rendered walks with an unknown shutter, one of them with a wrong lens: both are found."""

from __future__ import annotations

import numpy as np

from farpoint import Camera, Odometry
from farpoint.geometry import so3
from farpoint.metrics import chi2_quantile
from farpoint.synthetic import (
    HandheldOptions,
    ImagingOptions,
    Miscalibration,
    RenderedSequence,
    handheld_walk,
)

CAMERA = Camera.pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
FPS, READOUT_S = 30.0, 0.7 / 30.0


def test_lens_and_read_out_are_found_within_three_sigmas():
    hand = HandheldOptions(look_deg=20.0, tremor_deg=0.0)
    sequence = RenderedSequence(
        CAMERA,
        handheld_walk(30, FPS, 1, hand),
        imaging=ImagingOptions(readout_s=READOUT_S),
        given=Miscalibration(focal_share=0.05).of(CAMERA),
    )
    odometry = Odometry(sequence.given)
    for frame in sequence:
        odometry.process(frame.image, frame.timestamp)
    lens = odometry.lens
    assert abs(lens.readout_s - READOUT_S) < 3.0 * lens.readout_sigma_s
    assert lens.readout_sigma_s < 0.3 / FPS
    assert abs(lens.camera.model.parameters["fx"] - 250.0) < 3.0 * lens.sigma["fx"]
    assert lens.sigma["fx"] < 0.03 * 250.0


def test_the_first_covariances_contain_the_unknown_read_out():
    """If an unknown shutter counted as exactly global, 0.21 of the rotations were inside."""
    inside = []
    for seed in range(1, 4):
        imaging = ImagingOptions(readout_s=0.3 / FPS)
        sequence = RenderedSequence(CAMERA, handheld_walk(9, FPS, seed), seed=seed, imaging=imaging)
        for result in Odometry(CAMERA).run(sequence):
            if result.frame1 == 0:
                continue
            true = sequence.cam1_from_cam0(result.frame0, result.frame1)
            error = so3.log(result.pose.rotation_cam1_from_cam0 @ true[:3, :3].T)
            square = error @ np.linalg.solve(result.pose.rotation_covariance, error)
            inside.append(square < chi2_quantile(0.95, 3))
    assert len(inside) == 24
    assert np.mean(inside) >= 0.45
