"""When the search stops drawing samples: its loop alone, with everything that it calls mocked."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from farpoint._kernels import five_rays, search

FLOW, CONFIDENCE, MATCHES = 0.01, 0.99, 60


def interpreted(kernel: Callable) -> Callable:
    """The Python of a kernel, compiled or not."""
    return getattr(kernel, "py_func", kernel)


def needed(wrong: float, contested: bool, least: int = 0, most: int = 10**6) -> int:
    return interpreted(five_rays.iterations_needed)(wrong, FLOW, contested, CONFIDENCE, least, most)


@pytest.fixture
def drawn(monkeypatch):
    """Samples that a search draws whose ``rivals`` (number of the sample) win, and show this share
    of ``wrong`` matches from then on.
    """

    def run(wrong: list[float], rivals: tuple[int, ...] = (), least: int = 0, most: int = 10**6):
        samples: list[int] = []
        shares = iter(wrong)
        mocks = {
            "_draw_distinct": lambda *_: samples.append(len(samples) + 1),
            "challenge": lambda *_: bool(samples) and samples[-1] in rivals,
            "unexplained": lambda *_: next(shares),
            "_typical_flow": lambda *_: FLOW,
            "iterations_needed": interpreted(five_rays.iterations_needed),
            "intersect_circles": lambda *_: True,
            "solve_five": lambda *_: True,
            "score_pose": lambda *_: 1.0,
            "planar_twin": lambda *_: False,
            "layer_twin": lambda *_: False,
        }
        nothing = "refine", "noise_of", "start_noise", "_step_away", "_longest_flow_first"
        mocks |= {name: lambda *_: None for name in (*nothing, "search_direction", "copy")}
        mocks |= {"draw_direction": lambda *_: None}
        for name, mock in mocks.items():
            monkeypatch.setattr(search, name, mock)
        empty = np.ones(9)
        told = interpreted(search.search_pose)(
            empty, empty, MATCHES, empty, 3.0, 100.0, 1e-6, CONFIDENCE, least, most,
            *(empty for _ in range(5)),
        )  # fmt: skip
        assert told == len(samples)
        return len(samples)

    return run


@pytest.mark.parametrize("wrong", [0.0, 0.3, 0.6])
def test_without_a_rival_the_first_share_of_wrong_matches_decides(drawn, wrong):
    assert drawn([wrong]) == needed(wrong, contested=False)


def test_a_rival_asks_for_the_samples_of_a_search_that_knows_nothing(drawn):
    assert needed(0.4, contested=True) > 2 * needed(0.4, contested=False) > 4
    assert drawn([0.4, 0.4], rivals=(2,)) == needed(0.4, contested=True)


def test_a_better_pose_changes_what_is_needed(drawn):
    assert needed(0.2, contested=True) > 3
    assert drawn([0.5, 0.2], rivals=(3,)) == needed(0.2, contested=True)
    assert drawn([0.2, 0.5], rivals=(1,)) == needed(0.5, contested=True)


def test_a_search_that_has_drawn_enough_already_stops_at_once(drawn):
    late = needed(0.1, contested=True) + 2
    assert needed(0.6, contested=False) > late
    assert drawn([0.6, 0.1], rivals=(late,)) == late


def test_the_bounds_hold_whatever_is_wrong(drawn):
    assert drawn([0.0], least=16) == 16
    assert drawn([1.0], most=40) == 40
    assert drawn([0.9, 0.9], rivals=(1,), most=25) == 25
