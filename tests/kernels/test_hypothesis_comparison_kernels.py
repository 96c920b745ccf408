"""Comparison of a hypothesis with the best pose: end of its refinement, and modes kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from kernels_kit import matches_of, two_views

from farpoint._kernels import hypothesis_comparison
from farpoint._kernels.constants import MODE_MARGIN, STATE_PREDICTED_DECREASE
from farpoint._kernels.pose import PackedMatches, Pose

BEST = 100.0
# Cost at the initial pose, and predicted decrease of the first step.
AWAY = (500.0, 200.0)


class Compared(NamedTuple):
    """Result of comparing a hypothesis, after ``steps`` steps."""

    competes: bool
    was_close: bool
    steps: int
    best: Pose
    secondary: Pose


@pytest.fixture
def compared(monkeypatch):
    """Compare a hypothesis with this sequence of costs and predicted decreases."""

    def run(
        course: list[tuple[float, float]],
        *,
        same_after: int = 99,
        elsewhere: bool = True,
        twisted: bool = False,
        within: float = MODE_MARGIN,
    ) -> Compared:
        steps: list[int] = []

        def advance(
            _matches, _linearisation_point, _precision, _normal, cost, _shares, state, _kept
        ):
            steps.append(len(steps) + 1)
            cost[0], state[STATE_PREDICTED_DECREASE] = course[len(steps) - 1]
            return len(steps) < len(course)

        mocks = {
            "begin": lambda *_: None,
            "advance": advance,
            "finish": lambda *_: None,
            "laplace_factor": lambda *_: 0.0,
            "is_same_mode": lambda *_: len(steps) >= same_after,
            "_is_twisted": lambda *_: twisted,
        }
        for name, mock in mocks.items():
            monkeypatch.setattr(hypothesis_comparison, name, mock)
        best, hypothesis, secondary = (_pose() for _ in range(3))
        best.cost[0], secondary.cost[0] = BEST, np.inf
        hypothesis.t[:] = (1.0, 0.0, 0.0) if elsewhere else best.t
        compare_hypothesis = getattr(
            hypothesis_comparison.compare_hypothesis,
            "py_func",
            hypothesis_comparison.compare_hypothesis,
        )
        given = _matches(), hypothesis, best, secondary, within
        return Compared(*compare_hypothesis(*given), len(steps), best, secondary)

    inner = (
        "copy_pose",
        "_has_inliers",
        "refine_if_competitive",
        "_add_laplace_factor",
        "_has_other_direction",
    )
    for name in inner:
        function = getattr(hypothesis_comparison, name)
        monkeypatch.setattr(hypothesis_comparison, name, getattr(function, "py_func", function))
    return run


def _matches() -> PackedMatches:
    return matches_of(two_views(0, 33), 100.0, soft_cheirality=True)


def _pose() -> Pose:
    mixture = np.array([1.0, 0.2, 0.1, 0.05])
    return Pose(np.eye(3), np.array([0.0, 0.0, 1.0]), mixture, np.eye(6), np.zeros(1))


def test_a_small_predicted_decrease_ends_the_refinement_at_once(compared):
    assert compared([(500.0, 10.0), (90.0, 1.0)])[:3] == (False, False, 1)


def test_a_refinement_that_converges_far_from_the_best_ends_early(compared):
    ends = [AWAY, (300.0, 20.0), (290.0, 1.0), (289.0, 0.5), (288.9, 0.0)]
    assert compared(ends)[:3] == (False, False, 3)


def test_a_refinement_whose_noise_variance_decreases_goes_on(compared):
    # The predicted decrease leaves the noise variance out.
    falls = [AWAY, (170.0, 1.0), (140.0, 0.5), (120.0, 0.1), (115.0, 0.0)]
    assert compared(falls)[:3] == (True, False, 5)


def test_a_refinement_towards_the_best_ends_as_soon_as_it_is_the_same_mode(compared):
    assert compared([AWAY, (120.0, 30.0), (90.0, 1.0)], same_after=2).steps == 2


@pytest.mark.parametrize(
    ("end", "elsewhere", "competes", "is_close"),
    [
        (90.0, True, True, True),
        (90.0, False, True, False),
        (60.0, True, True, False),
        (120.0, True, True, True),
        (131.0, True, False, False),
    ],
)
def test_the_likelier_is_the_best_and_the_other_a_mode(
    compared, end, elsewhere, competes, is_close
):
    found = compared([AWAY, (end, 1.0)], elsewhere=elsewhere)
    assert found.competes == competes
    assert found.best.cost[0] == min(end, BEST)
    lost = max(end, BEST)
    assert found.secondary.cost[0] == (lost if is_close else np.inf)


@pytest.mark.parametrize(("matches", "near"), [(9, 30.0), (40, 50.0), (160, 100.0)])
def test_the_margin_of_the_motions_of_a_plane(matches, near):
    planar_margin = getattr(
        hypothesis_comparison.planar_margin, "py_func", hypothesis_comparison.planar_margin
    )
    assert planar_margin(matches) == near


def test_a_twisted_pair_competes_but_is_not_kept(compared):
    found = compared([AWAY, (90.0, 1.0)], twisted=True)
    assert found.competes
    assert (found.best.cost[0], found.secondary.cost[0]) == (BEST, np.inf)


def test_whether_the_initial_pose_was_within_the_margin_is_returned(compared):
    inside, outside = BEST + 49.0, BEST + 51.0
    assert compared([(inside, 9.0), (inside, 0.1)], same_after=1, within=50.0).was_close
    assert not compared([(outside, 99.0), (BEST, 0.1)], same_after=2, within=50.0).was_close


def test_a_hypothesis_within_the_margin_competes(compared):
    ends = [(199.0, 99.0), (149.0, 0.1)]
    assert compared(ends, within=50.0).competes
    assert not compared(ends, within=48.0).competes
