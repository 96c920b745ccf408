"""The tables of the lenses: every model, and odometry through wide ones."""

from __future__ import annotations

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.tables import lenses
from farpoint.camera import Camera, KannalaBrandt

OPTIONS = BenchOptions(tables=("lenses",), pairs=2)


def test_every_model_sees_most_of_the_image_it_is_timed_on(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(lenses, "_PIXELS", 2000)
    (table,) = lenses.unprojection_table(OPTIONS, silent)
    models = {type(model).__name__ for _, model in lenses._LENSES}
    assert len(models) == 9
    assert len(table.rows) == len(lenses._LENSES)
    assert all(0.0 <= seconds < 1.0 for _, seconds in table.rows)
    width, height = lenses._SIZE
    pixels = np.random.default_rng(0).uniform((0, 0), (width - 1, height - 1), (2000, 2))
    for name, model in lenses._LENSES:
        assert np.isfinite(model.unproject(pixels)).all(axis=1).mean() > 0.9, name


def test_a_small_drive_fills_a_row(monkeypatch: pytest.MonkeyPatch):
    small = Camera(model=KannalaBrandt(fx=90, fy=90, cx=119.5, cy=119.5), size=(240, 240))
    monkeypatch.setattr(lenses, "CAMERAS", {"small fisheye": small})
    (table,) = lenses.wide_table(OPTIONS, silent)
    row = dict(zip((column.name for column in table.columns), table.rows[0], strict=True))
    assert (row["lens"], row["pairs"], row["OK"]) == ("small fisheye", 2, 2)
    assert 0.0 < row["rotation_median_deg"] < 0.2
    assert 0.1 < row["direction_over_bound"] < 5.0
    assert 0.0 <= row["pose_95"] <= 1.0
