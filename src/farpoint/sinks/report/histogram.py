"""Histogram of the split-half errors, with the density for correct covariances."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.special import gammainc

from farpoint.metrics import SplitHalf, chi2_quantile, consistency_ratio

__all__ = ["halves_section"]

_WIDTH, _HEIGHT = 1000, 300
_MOST_BINS, _TESTS_A_BIN = 20, 4
_MIN_COUNT = 5


def halves_section(halves: Sequence[SplitHalf]) -> str:
    """The histogram with a sentence about the result; empty if too few pairs were tested."""
    tested = [half for half in halves if half.dof]
    if len(tested) < _MIN_COUNT:
        return ""
    ratio = consistency_ratio(tested)
    dof = Counter(half.dof for half in tested).most_common(1)[0][0]
    values = np.array([half.nees for half in tested if half.dof == dof])
    verdict = _verdict(ratio.ratio, ratio.low, ratio.high)
    if ratio.opposed:
        verdict += f" The directions of {ratio.opposed} more are opposite, so one of them is wrong."
    return (
        f"<section><h2>Is the covariance honest?</h2>"
        f'<p class="quiet">{ratio.count} pairs were estimated twice, from two halves of their '
        f"matches. The difference of the two, squared and divided by what the covariances expect, "
        f"is {ratio.ratio:.2f} on average; honest covariances give {ratio.low:.2f} to "
        f"{ratio.high:.2f}. {verdict} What both halves share, such as a wrong calibration, this "
        f"test cannot see.</p>{_figure(values, dof, ratio.ratio)}</section>\n"
    )


def _verdict(ratio: float, low: float, high: float) -> str:
    if ratio > high:
        return f"The 1-sigmas on this page are too small by about {np.sqrt(ratio):.2g} times."
    if ratio < low:
        return "The 1-sigmas on this page are on the safe side."
    return "The 1-sigmas on this page hold."


def _figure(values: np.ndarray, dof: int, ratio: float) -> str:
    """Bars of the tests and the density of chi-square; the last bar counts all larger values."""
    end = chi2_quantile(0.995, dof)
    bins = int(np.clip(len(values) // _TESTS_A_BIN, 6, _MOST_BINS))
    edges = np.linspace(0.0, end, bins + 1)
    counts = np.histogram(np.minimum(values, end * (1 - 1e-9)), edges)[0]
    expected = len(values) * np.diff(gammainc(0.5 * dof, 0.5 * edges))  # chi-square's
    tallest = 1.1 * max(counts.max(), expected.max())
    step = _WIDTH / bins
    bars = "".join(
        f'<rect class="c1" x="{index * step + 2:.1f}" width="{step - 4:.1f}" '
        f'y="{_HEIGHT * (1 - count / tallest):.1f}" height="{_HEIGHT * count / tallest:.1f}">'
        f"<title>{count} tests, {expected[index]:.1f} expected</title></rect>"
        for index, count in enumerate(counts)
    )
    points = " ".join(
        f"{(index + 0.5) * step:.1f},{_HEIGHT * (1 - value / tallest):.1f}"
        for index, value in enumerate(expected)
    )
    labels = "".join(
        f'<span class="x" style="left:{100 * value / end:.2f}%">{value:g}</span>'
        for value in range(0, int(end) + 1, 5)
    )
    return (
        f"<figure><figcaption><b>Normalised split-half errors</b> <small>squared, {dof} degrees "
        f'of freedom; the last bar holds all beyond</small> <span class="key c1">tests</span> '
        f'<span class="key c2">chi-square</span></figcaption><div class="plot">'
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" preserveAspectRatio="none" role="img" '
        f'aria-label="histogram of {len(values)} tests, mean {ratio:.2f} of what is expected">'
        f'{bars}<polyline class="curve c2" points="{points}"/></svg>{labels}</div></figure>'
    )
