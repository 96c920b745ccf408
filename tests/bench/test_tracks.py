"""The table of what OpenCV tracks and matches."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.feature_matcher import FeatureMatcher
from farpoint.bench.options import BenchOptions
from farpoint.bench.tables import tracks
from farpoint.camera import Camera
from farpoint.frames import Frame
from farpoint.synthetic import RenderedSequence
from farpoint.trajectory.files import Trajectory


class RenderedOnce(RenderedSequence):
    """Every kind of match is of the same streets, told apart by their seeds."""

    _rendered: ClassVar[dict[int, list[Frame]]] = {}

    def __init__(self, camera: Camera, path: Trajectory, *, seed: int) -> None:
        super().__init__(camera, path, seed=seed)
        self._key = seed

    def __iter__(self) -> Iterator[Frame]:
        if self._key not in self._rendered:
            self._rendered[self._key] = list(super().__iter__())
        return iter(self._rendered[self._key])


def test_a_few_pairs_fill_the_rows_one_by_one(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(tracks, "_FPS", (20.0,))
    monkeypatch.setattr(tracks, "RenderedSequence", RenderedOnce)
    options = BenchOptions(tables=("tracks",), pairs=4)
    first, *_, table = tracks.tracks_table(options, silent)
    assert len(first.rows) == 1
    rows = [
        dict(zip((column.name for column in table.columns), row, strict=True)) for row in table.rows
    ]
    assert [row["kind"] for row in rows] == [*tracks._MATCHERS]
    # Key points of ORB lie on whole pixels, and a plane may explain them by two motions.
    expected = ((250, 500, 4), (75, 150, 4), (80, 1000, 4), (80, 1000, 3))
    for row, (fewest, most, least) in zip(rows, expected, strict=True):
        assert row["pairs"] == 4
        assert row["OK"] >= least
        assert fewest < row["matches"] <= most
        assert 0.0 <= row["pose_95"] <= 1.0
        assert 0.1 < row["pose_nees"] < 100.0


@pytest.mark.parametrize("kind", ["SIFT", "ORB"])
def test_features_are_matched_and_images_without_any_are_no_error(kind):
    image = np.random.default_rng(1).integers(0, 255, (40, 60), np.uint8)
    image = np.kron(image, np.ones((6, 6), np.uint8))
    points0, points1 = FeatureMatcher(kind).match(image[:, 5:], image[:, :-5])
    assert len(points0) == len(points1) > 50
    shift = points1 - points0
    # ORB finds points to the pixel of the level.
    assert np.mean(np.abs(shift - (5.0, 0.0)).max(axis=1) < 4.0) > 0.9
    blank = np.full((200, 200), 128, np.uint8)
    for points in FeatureMatcher(kind).match(blank, blank):
        assert points.shape == (0, 2)
