"""Interlaced pictures are recognised by their combs, and by nothing else."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import farpoint as fp
from farpoint.frames.deinterlace import Deinterlacer, comb_share, one_field
from farpoint.synthetic import render_drive
from farpoint.tracks import Tracker, Tracks

CAMERA = fp.Camera.pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)


@pytest.fixture(scope="module")
def fields() -> list[np.ndarray]:
    return [frame.image for frame in render_drive(CAMERA, frames=16, fps=20.0, seed=4)]


def woven(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    picture = first.copy()
    picture[1::2] = second[1::2]
    return picture


def test_interlaced_pictures_are_distinguished_from_progressive_ones(fields: list[np.ndarray]):
    pairs = list(zip(fields[::2], fields[1::2], strict=True))
    assert max(map(comb_share, fields)) < 0.1
    assert min(comb_share(woven(*pair)) for pair in pairs) > 0.3


@pytest.mark.parametrize("name", ["noise", "dark noise", "rows of 4 px", "checks", "flat", "small"])
def test_textures_and_noise_are_no_combs(name: str):
    rng, row = np.random.default_rng(0), np.arange(240)[:, None]
    image = {
        "noise": rng.integers(0, 255, (240, 320)),
        "dark noise": np.clip(rng.normal(8.0, 4.0, (240, 320)), 0, 255),
        "rows of 4 px": np.repeat(127 + 100 * np.sin(2 * np.pi * row / 4 + 0.3), 320, axis=1),
        "checks": 200 * ((np.arange(320) // 5 + row // 5) % 2),
        "flat": np.full((240, 320), 7),
        "small": rng.integers(0, 255, (9, 9)),
    }[name].astype(np.uint8)
    deinterlace = Deinterlacer()
    for _ in range(3):
        np.testing.assert_array_equal(deinterlace(image), image)


def test_one_field_keeps_pixels_where_they_are():
    """A smooth picture is all but the same by every second line, odd heights included."""
    for height in (60, 61):
        y, x = np.mgrid[0:height, 0:80]
        picture = np.rint(120 + 60 * np.sin(y / 9.0) + 40 * np.cos(x / 7.0)).astype(np.uint8)
        found = one_field(picture)
        inside = slice(4, -4)
        assert np.abs(found[inside].astype(int) - picture[inside]).max() <= 2
        other = picture.copy()
        other[1::2] = 255  # the other field
        np.testing.assert_array_equal(one_field(other), found)


@pytest.mark.parametrize("shift_px", [0.5, 1.25, 1.5])
def test_fine_textures_hardly_pull_windows_to_whole_lines(shift_px: float):
    """Of a lens as sharp as 0.9 px; by 0.03 px and more where the field is not smoothed."""
    fine = np.random.default_rng(1).uniform(0, 255, (960, 320)).astype(np.float32)
    fine = cv2.GaussianBlur(fine, (0, 0), sigmaX=0.875, sigmaY=3.5)
    fine = (fine - fine.mean()) * 40.0 / fine.std() + 127.0
    tracker, tracks = Tracker(), Tracks.empty()
    for begin in (round(4 * shift_px), 0):  # in quarters of a line
        rows = fine[begin : begin + 920].reshape(230, 4, 320).mean(axis=1)
        tracks = tracker.track(one_field(np.clip(np.rint(rows), 0, 255).astype(np.uint8)))
    assert len(tracks) > 100
    moved = np.median(tracks.points1[:, 1] - tracks.points0[:, 1])
    assert abs(moved - shift_px) < 0.02


def test_an_odometry_uses_one_field_and_says_so(fields: list[np.ndarray]):
    odometry, plain = fp.Odometry(CAMERA), fp.Odometry(CAMERA)
    for k, pair in enumerate(zip(fields[::2], fields[1::2], strict=True)):
        result = odometry.process(woven(*pair), k / 10)
        plain.process(pair[0], k / 10)
        if k:
            assert result.pose is not None
            assert result.pose.status is fp.PoseStatus.OK
    assert odometry.notes == ("The images are interlaced: only their even lines are used.",)
    assert plain.notes == ()


def test_strong_combs_count():
    # Lines that alternate between black and white: their squared differences exceed 16 bits.
    image = np.zeros((128, 128), np.uint8)
    image[::2] = 255
    image[64:] = np.repeat(np.arange(64, dtype=np.uint8)[:, None], 128, axis=1)
    assert comb_share(image) == 1.0
