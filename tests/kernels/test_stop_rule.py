"""When the search stops drawing samples: its loop alone, with everything that it calls mocked."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from farpoint._kernels import five_rays, search
from farpoint._kernels.contest import BESIDE, LOST, RIVAL
from farpoint._kernels.pose import PackedMatches, Pose

FLOW, CONFIDENCE, MATCHES = 0.01, 0.99, 60


def interpreted(kernel: Callable) -> Callable:
    """The Python of a kernel, compiled or not."""
    return getattr(kernel, "py_func", kernel)


def needed(wrong: float, *, has_rival: bool) -> int:
    effort = five_rays.Effort(3.0, CONFIDENCE, 0, 10**6)
    return interpreted(five_rays.iterations_needed)(wrong, FLOW, has_rival, effort)


@pytest.fixture
def drawn(monkeypatch):
    """Samples that a search draws if some (by their number) are a rival of the best, or beside it,
    and show this share of ``wrong`` matches from then on. The truncated squares of the start, and
    of every sample, are the ``scores``, each of the matches up to 9.
    """

    def run(
        wrong: list[float],
        contests: dict[int, np.int64] | None = None,
        least: int = 0,
        most: int = 10**6,
        scores: tuple[float, float] = (1.0, 1.0),
    ) -> int:
        samples: list[int] = []
        shares = iter(wrong)

        def challenge(*_):
            return (contests or {}).get(samples[-1] if samples else 0, LOST), False

        mocks = {
            "_draw_distinct": lambda *_: samples.append(len(samples) + 1),
            "challenge": challenge,
            "unexplained": lambda *_: next(shares),
            "_typical_flow": lambda *_: FLOW,
            "iterations_needed": interpreted(five_rays.iterations_needed),
            "_solve_sample": lambda *_: True,
            "score_pose": lambda *_: scores[1] if samples else scores[0],
            "noise_of": lambda *given: given[-1].fill(1.0),
            "is_rival": lambda *_: False,
            "is_close_second": lambda *_: False,
            "_search_twins": lambda *_: False,
        }
        nothing = "refine", "start_noise", "search_direction", "copy"
        mocks |= {name: lambda *_: None for name in nothing}
        for name, mock in mocks.items():
            monkeypatch.setattr(search, name, mock)
        empty = np.ones(9)
        matches = PackedMatches(empty, empty, MATCHES, 100.0, 1e-6, math.inf, gives_way=True)
        effort = five_rays.Effort(3.0, CONFIDENCE, least, most)
        poses = (Pose(*(empty.copy() for _ in Pose._fields)) for _ in range(3))
        told, *_ = interpreted(search.search_pose)(matches, empty, effort, empty, *poses)
        assert told == len(samples)
        return len(samples)

    return run


@pytest.mark.parametrize("wrong", [0.0, 0.3, 0.6])
def test_without_a_rival_the_first_share_of_wrong_matches_decides(drawn, wrong):
    assert drawn([wrong]) == needed(wrong, has_rival=False)


def test_a_rival_asks_for_the_samples_of_a_search_that_knows_nothing(drawn):
    assert needed(0.4, has_rival=True) > 2 * needed(0.4, has_rival=False) > 4
    assert drawn([0.4, 0.4], {2: RIVAL}) == needed(0.4, has_rival=True)


def test_a_pose_beside_the_best_leaves_as_much_to_do(drawn):
    assert drawn([0.4, 0.4], {2: BESIDE}) == needed(0.4, has_rival=False)
    # Nor does it make up for a rival.
    assert drawn([0.4, 0.4, 0.4], {2: RIVAL, 3: BESIDE}) == needed(0.4, has_rival=True)


@pytest.mark.parametrize(
    ("scores", "is_tried"),
    # Up to twice the squares; and at least half the support, of 540 less the squares.
    [((50.0, 99.0), True), ((50.0, 101.0), False), ((340.0, 439.0), True), ((340.0, 441.0), False)],
)
def test_only_a_sample_that_comes_near_the_best_may_be_its_rival(drawn, scores, is_tried):
    tried = drawn([0.4, 0.4], {2: RIVAL}, scores=scores)
    assert tried == needed(0.4, has_rival=is_tried)


def test_a_better_pose_changes_what_is_needed(drawn):
    assert needed(0.2, has_rival=True) > 3
    assert drawn([0.5, 0.2], {3: RIVAL}) == needed(0.2, has_rival=True)
    assert drawn([0.2, 0.5], {1: RIVAL}) == needed(0.5, has_rival=True)


def test_a_search_that_has_drawn_enough_already_stops_at_once(drawn):
    late = needed(0.1, has_rival=True) + 2
    assert needed(0.6, has_rival=False) > late
    assert drawn([0.6, 0.1], {late: RIVAL}) == late


def test_the_bounds_hold_whatever_is_wrong(drawn):
    assert drawn([0.0], least=16) == 16
    assert drawn([1.0], most=40) == 40
    assert drawn([0.9, 0.9], {1: RIVAL}, most=25) == 25
