"""A rendered walk, its lens given wrong and its shutter not at all: both are found."""

from __future__ import annotations

from farpoint import Camera, Odometry
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
