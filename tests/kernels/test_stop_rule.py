"""Number of samples of the search: its loop alone, with all callees mocked."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from farpoint._kernels import five_rays, hypothesis_comparison, search
from farpoint._kernels.constants import MODE_MARGIN, SHORT_TAIL
from farpoint._kernels.pose import PackedMatches, Pose

FLOW, CONFIDENCE, MATCHES = 0.01, 0.99, 60


def interpreted(kernel: Callable) -> Callable:
    """The Python of a kernel, compiled or not."""
    return getattr(kernel, "py_func", kernel)


def needed(outlier_shares: float, has_competing_mode: bool, known: int = MATCHES) -> int:
    budget = five_rays.SearchBudget(3.0, CONFIDENCE, 0, 10**6)
    share = known / MATCHES
    return interpreted(five_rays.iterations_needed)(
        outlier_shares, share, FLOW, has_competing_mode, budget
    )


@pytest.fixture
def drawn(monkeypatch):
    """Number of samples that a search draws.

    The samples of the numbers ``competing`` compete with the best. The ``outlier_shares`` are those
    of the initial pose and after each competing sample, ``known`` the numbers of known matches. The
    other mode has the ``known_cost``. ``scores`` are the truncated squares of the initial pose
    and of every sample; the limit of a match is 9.
    """

    def run(
        outlier_shares: list[float],
        competing: tuple[int, ...] = (),
        least: int = 0,
        most: int = 10**6,
        scores: tuple[float, float] = (1.0, 1.0),
        known: list[int] | None = None,
        kinds: list[int] | None = None,
        known_cost: float = math.inf,
        cost: float = 1.0,
    ) -> int:
        samples: list[int] = []
        shares = iter(outlier_shares)
        marked = iter(known or [])
        last = [MATCHES]

        def compare_hypothesis(_matches, _challenger, best, secondary, within):
            # The best costs 1 at first, or infinitely much.
            known = known_cost if len(samples) > 1 else math.inf
            assert within == (
                known - best.cost[0] if known < best.cost[0] + MODE_MARGIN else MODE_MARGIN
            )
            secondary.cost[0] = known_cost
            return samples[-1] in competing, False

        def get_to_know(*_):
            # After a competing mode, matches consistent with the best are marked, then those with
            # the other.
            last[0] = next(marked, last[0])
            return last[0] / MATCHES

        def draw(_sample, among, *_):
            samples.append(len(samples) + 1)
            is_of_known = last[0] < MATCHES and len(samples) % 2 == 0
            assert is_of_known == (among is not everyone)

        def solve(_pairs, _sample, kind, *_):
            if kinds is not None:
                kinds.append(kind)
            return True

        mocks = {
            "_draw_distinct": draw,
            "_mark_known": get_to_know,
            "compare_hypothesis": compare_hypothesis,
            "outlier_share_of": lambda *_: next(shares),
            "_typical_flow": lambda *_: FLOW,
            "iterations_needed": interpreted(five_rays.iterations_needed),
            "_solve_sample": solve,
            "_start": lambda *_: (9.0, scores[0]),
            "score_pose": lambda *_: scores[1],
            "initial_noise": lambda *_: None,
            "copy": lambda *_: None,
            "is_secondary_mode": lambda *_: False,
            "_search_ambiguous_motions": lambda *_: False,
        }
        for name, mock in mocks.items():
            monkeypatch.setattr(search, name, mock)
        empty, everyone = np.ones(9), np.ones(MATCHES)
        matches = PackedMatches(
            empty, everyone, everyone, MATCHES, 100.0, SHORT_TAIL, 1e-6, math.inf, True
        )
        budget = five_rays.SearchBudget(3.0, CONFIDENCE, least, most)
        poses = [Pose(*(empty.copy() for _ in Pose._fields)) for _ in range(2)]
        poses[0].cost[0] = cost
        drawn_samples, *_ = interpreted(search.search_pose)(matches, empty, budget, empty, *poses)
        assert drawn_samples == len(samples)
        return len(samples)

    return run


@pytest.mark.parametrize("outlier_shares", [0.0, 0.3, 0.6])
def test_without_a_competing_mode_the_first_outlier_share_decides(drawn, outlier_shares):
    assert drawn([outlier_shares]) == needed(outlier_shares, has_competing_mode=False)


def test_a_competing_mode_needs_the_samples_of_an_uninformed_search(drawn):
    assert needed(0.4, has_competing_mode=True) > 2 * needed(0.4, has_competing_mode=False) > 4
    assert drawn([0.4, 0.4], (2,)) == needed(0.4, has_competing_mode=True)


@pytest.mark.parametrize("known_cost", [3.0, 8.0, 99.0, math.inf])
def test_a_hypothesis_less_likely_than_both_modes_is_left_out(drawn, known_cost):
    assert drawn([0.4], least=3, most=3, known_cost=known_cost) == 3


def test_any_hypothesis_is_within_the_margin_of_an_infinitely_unlikely_start(drawn):
    assert drawn([0.4], least=3, most=3, cost=math.inf) == 3


@pytest.mark.parametrize(
    ("scores", "is_tried"),
    # Up to twice the squares; and at least half of the support, 540 minus the squares.
    [((50.0, 99.0), True), ((50.0, 101.0), False), ((340.0, 439.0), True), ((340.0, 441.0), False)],
)
def test_only_a_sample_of_low_score_may_compete(drawn, scores, is_tried):
    tried = drawn([0.4, 0.4], (2,), scores=scores)
    assert tried == needed(0.4, has_competing_mode=is_tried)


def test_a_better_pose_changes_what_is_needed(drawn):
    assert needed(0.2, has_competing_mode=True) > 3
    assert drawn([0.5, 0.2], (3,)) == needed(0.2, has_competing_mode=True)
    assert drawn([0.2, 0.5], (1,)) == needed(0.5, has_competing_mode=True)


def test_the_fewer_matches_are_known_to_agree_the_fewer_samples_are_needed(drawn):
    first, later = (needed(0.5, has_competing_mode=True, known=known) for known in (36, 45))
    assert first < later < 0.5 * needed(0.5, has_competing_mode=True)
    assert drawn([0.5, 0.5], (2,), known=[30, 33, 36]) == first
    assert drawn([0.5] * 3, (2, 3), known=[30, 33, 36, 40, 45]) == later


def test_samples_of_known_matches_are_not_solved_from_the_best_pose(drawn):
    kinds: list[int] = []
    assert drawn([0.5], least=60, most=60, known=[30], kinds=kinds) == 60
    assert [kinds[::2].count(kind) for kind in range(3)] == [10, 10, 10]
    assert [kinds[1::2].count(kind) for kind in range(3)] == [0, 15, 15]


def test_a_search_that_has_drawn_enough_already_stops_at_once(drawn):
    late = needed(0.1, has_competing_mode=True) + 2
    assert needed(0.6, has_competing_mode=False) > late
    assert drawn([0.6, 0.1], (late,)) == late


def test_the_bounds_hold_for_any_outlier_share(drawn):
    assert drawn([0.0], least=16) == 16
    assert drawn([1.0], most=40) == 40
    assert drawn([0.9, 0.9], (1,), most=25) == 25


@pytest.mark.parametrize("outcome", [(False, False), (False, True), (True, False)])
def test_the_second_motion_of_a_plane_has_the_planar_margin(monkeypatch, outcome):
    """Returns whether that motion was within the margin, before or after refinement."""
    asked: list[float] = []

    def compare_hypothesis(*given):
        asked.append(given[-1])
        return outcome

    mocks = {
        "second_planar_motion": lambda *_: True,
        "bas_relief_motion": lambda *_: True,
        "compare_hypothesis": compare_hypothesis,
        "planar_margin": interpreted(hypothesis_comparison.planar_margin),
        "copy": lambda *_: None,
    }
    for name, mock in mocks.items():
        monkeypatch.setattr(search, name, mock)
    empty = np.ones(9)
    matches = PackedMatches(
        empty, empty, empty, 640, 100.0, SHORT_TAIL, 1e-6, math.inf, soft_cheirality=True
    )
    poses = [Pose(*(empty.copy() for _ in Pose._fields)) for _ in range(3)]
    is_planar = interpreted(search._search_ambiguous_motions)(matches, *poses)
    assert asked == [200.0, MODE_MARGIN]
    assert is_planar == any(outcome)
