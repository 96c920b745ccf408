from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

from farpoint.bench.chart import line_chart

SVG = "{http://www.w3.org/2000/svg}"
X = np.array([10.0, 100.0, 1000.0])


def points_of(chart: str) -> list[np.ndarray]:
    """Corners (N, 2) of the drawn lines, the last drawn first."""
    paths = [
        path.get("d", "")
        for path in ElementTree.fromstring(chart).iter(f"{SVG}path")
        if path.get("class") == "line" and "L" in path.get("d", "")
    ]
    return [
        np.array([pair.split() for pair in path[1:].split("L")], dtype=float)
        for path in reversed(paths)
    ]


def test_lines_are_where_their_logarithms_are():
    lines = {"a & b": np.array([1.0, 10.0, 100.0]), "c": np.array([100.0, 100.0, 100.0])}
    chart = line_chart("T", "x", "ms", X, lines, log_x=True)
    first, second = points_of(chart)
    steps = np.diff(first, axis=0)
    np.testing.assert_allclose(steps[0], steps[1], atol=0.2)
    assert steps[0][0] > 0 > steps[0][1]  # up is less y
    assert np.ptp(second[:, 1]) == 0.0
    assert second[0, 1] == pytest.approx(first[2, 1])
    texts = [text.text for text in ElementTree.fromstring(chart).iter(f"{SVG}text")]
    assert {"T", "x", "ms", "a & b", "c", "10", "1000", "100"} <= set(texts)


def test_a_linear_axis_starts_at_zero():
    chart = line_chart("T", "%", "ms", np.array([0.0, 1.0, 4.0]), {"a": X}, log_x=False)
    (first,) = points_of(chart)
    assert (first[1, 0] - first[0, 0]) * 4 == pytest.approx(first[2, 0] - first[0, 0], abs=1.0)
