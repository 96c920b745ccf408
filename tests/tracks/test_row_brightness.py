"""How bright rows are is learnt from tracks, where it is the rows that changed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from farpoint.tracks import Tracker, Tracks
from farpoint.tracks.options import LucasKanadeOptions
from farpoint.tracks.pyramid import build_pyramid
from farpoint.tracks.row_brightness import normalize_rows, remove_row_gains, row_gains

TEXTURE = cv2.GaussianBlur(
    np.random.default_rng(2).integers(0, 255, (200, 300)).astype(np.uint8), (0, 0), 1.5
)
PYRAMID = build_pyramid(TEXTURE, LucasKanadeOptions())
BANDS = 1.0 + 0.25 * np.sin(np.arange(200) / 12.0)


def tracks() -> Tracks:
    tracker = Tracker()
    tracker.track(TEXTURE)
    return tracker.track(TEXTURE)


def gains_of(image: np.ndarray) -> np.ndarray | None:
    return row_gains(PYRAMID, build_pyramid(image, LucasKanadeOptions()), tracks())


def test_bands_are_found_and_taken_back():
    banded = np.rint(TEXTURE * BANDS[:, None]).astype(np.uint8)
    gains = gains_of(banded)
    assert gains is not None
    inside = slice(15, -15)
    ratio = (gains / BANDS)[inside]
    assert np.std(ratio) < 0.02 * np.mean(ratio)
    restored = remove_row_gains(banded, gains)[inside] * np.mean(ratio)
    assert np.median(np.abs(restored - TEXTURE[inside])) < 3.0


@pytest.mark.parametrize("change", ["none", "all rows", "columns", "a shadow", "noise"])
def test_other_changes_are_left_alone(change: str):
    column, row = np.arange(300), np.arange(200)[:, None]
    factor = {
        "none": 1.0,
        "all rows": 0.7,
        "columns": 1.0 + 0.25 * np.sin(column / 12.0),
        "a shadow": np.where(np.hypot(column - 150, row - 100) < 70, 0.6, 1.0),
        "noise": np.random.default_rng(5).normal(1.0, 0.1, TEXTURE.shape),
    }[change]
    assert gains_of(np.clip(TEXTURE * factor, 0, 255).astype(np.uint8)) is None


def test_rows_without_tracks_and_dark_images_tell_nothing():
    assert row_gains(PYRAMID, PYRAMID, Tracks.empty()) is None
    assert gains_of(np.zeros_like(TEXTURE)) is None


def test_even_rows_are_blind_to_bands():
    banded = np.rint(TEXTURE * BANDS[:, None]).astype(np.uint8)
    assert np.abs(normalize_rows(banded).astype(int) - normalize_rows(TEXTURE)).mean() < 2.0
    assert normalize_rows(np.zeros((20, 30), np.uint8)).max() == 0
