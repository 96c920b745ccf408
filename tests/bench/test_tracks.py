"""The table of what OpenCV tracks."""

from __future__ import annotations

import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.tables import tracks


def test_a_few_pairs_fill_the_rows_one_by_one(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(tracks, "_CELLS", ((200, 20.0), (100, 20.0)))
    options = BenchOptions(tables=("tracks",), pairs=4)
    first, table = tracks.tracks_table(options, silent)
    assert len(first.rows) == 1
    rows = [
        dict(zip((column.name for column in table.columns), row, strict=True)) for row in table.rows
    ]
    assert [row["corners"] for row in rows] == [200, 100]
    for row in rows:
        assert (row["pairs"], row["OK"]) == (4, 4)
        assert row["corners"] / 2 < row["tracks"] <= row["corners"]
        assert 0.0 <= row["pose_95"] <= 1.0
        assert 0.1 < row["pose_nees"] < 100.0
