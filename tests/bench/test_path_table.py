"""The table of paths: several drives as segments of one, in their own gauges."""

from __future__ import annotations

import numpy as np
import pytest
from bench_kit import silent

from farpoint import Camera
from farpoint.bench.options import BenchOptions
from farpoint.bench.path_samples import joined
from farpoint.bench.tables import path as table_of_paths
from farpoint.metrics import PathSamples, evaluate_path


def test_small_drives_fill_a_row(monkeypatch: pytest.MonkeyPatch):
    small = Camera.pinhole(240, 160, 165.0, 165.0, 119.5, 79.5)
    monkeypatch.setattr(table_of_paths, "_CAMERAS", (("small", small),))
    monkeypatch.setattr(table_of_paths, "_DRIVES", 2)
    (table,) = table_of_paths.path_table(BenchOptions(tables=("path",), pairs=4), silent)
    row = dict(zip((column.name for column in table.columns), table.rows[0], strict=True))
    assert (row["lens"], row["drives"], row["segments"]) == ("small", 2, 2)
    assert row["motions"] == 6  # the first of each drive is its unit
    assert 0.0 < row["pose_nees"] < 3.0 * row["pose_high"]
    assert 0.0 <= row["lengths_95"] <= 1.0


def straight(bend: float) -> PathSamples:
    """Six poses in two segments, the last length of each wrong by ``bend``, of a sigma of 1 %."""
    steps = np.array([1.0, 1.0, np.exp(bend)])
    truth = np.tile(np.eye(4), (6, 1, 1))
    truth[:, 2, 3] = np.cumsum([0.0, *steps[1:], 0.0, *steps[1:]])
    found = truth.copy()
    found[:, 2, 3] = [0.0, 1.0, 2.0, 2.0, 3.0, 4.0]
    covariances = np.tile(1e-4 * np.eye(7), (6, 1, 1))
    covariances[[0, 3]] = 0.0
    covariances[[1, 4], 6, 6] = 0.0
    nan = np.nan
    return PathSamples(
        segments=np.array([0, 0, 0, 1, 1, 1]),
        world_from_cam=found,
        covariances=covariances,
        truth=truth,
        lengths=np.array([nan, 1.0, 1.0, nan, 1.0, 1.0]),
        length_sigmas=np.array([nan, 0.0, 0.01, nan, 0.0, 0.01]),
        length_from=np.array([0, 0, 1, 3, 3, 4]),
    )


def test_drives_are_joined_without_being_mixed():
    drives = [straight(0.01), straight(-0.02)]
    path = joined(drives)
    np.testing.assert_array_equal(path.segments, [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3])
    found = evaluate_path(path)
    assert found is not None
    assert (found.scale.segments, found.scale.poses) == (4, 4)
    assert found.scale.mean_nees == pytest.approx((1.0 + 4.0) / 2.0)
    # The last drive alone says the same of itself.
    alone = evaluate_path(drives[1])
    assert alone is not None
    assert alone.scale.mean_nees == pytest.approx(4.0)
