"""The table of compressed video."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.tables import codecs
from farpoint.camera import Camera


def test_each_codec_has_a_row(monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("av")
    camera = Camera.pinhole(320, 240, 220.0, 220.0, 159.5, 119.5).with_readout(0.0)
    monkeypatch.setattr(codecs, "_CAMERAS", (camera,))
    monkeypatch.setattr(codecs, "_FPS", (30,))
    first, *_, table = codecs.codecs_table(BenchOptions(tables=("codecs",), pairs=4), silent)
    assert len(first.rows) == 1
    names = [column.name for column in table.columns]
    rows: dict[Any, dict[str, Any]] = {
        row[0]: dict(zip(names, row, strict=True)) for row in table.rows
    }
    assert list(rows) == list(codecs._CODECS)
    for row in rows.values():
        assert (row["fps"], row["width"], row["pairs"]) == (30, 320, 4)
        assert row["OK"] >= 3
    # Compression makes the errors of neighbouring tracks alike.
    correlations = [rows[name]["correlation"] for name in ("uncompressed", "H.264, crf 28")]
    assert correlations[0] + 0.1 < correlations[1]


def test_images_come_back_from_each_codec_with_its_losses():
    pytest.importorskip("av")
    pytest.importorskip("cv2")
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 255, (12, 16))
    image = np.kron(coarse, np.ones((8, 8))).astype(np.uint8)
    images = [image, np.roll(image, 2, axis=1), np.roll(image, 4, axis=1)]
    losses = {}
    for name, through in codecs._CODECS.items():
        decoded = through(images, 30.0)
        assert [each.shape for each in decoded] == [image.shape] * 3
        losses[name] = np.mean(
            [np.abs(a - b.astype(float)).mean() for a, b in zip(decoded, images, strict=True)]
        )
    assert losses["uncompressed"] == 0.0
    assert losses["JPEG, q 75"] < losses["JPEG, q 50"] < 10.0
    assert 0.0 < losses["H.264, crf 18"] < losses["H.264, crf 28"] < 20.0
