"""Which of two motions it was, and when there is no telling."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import point_scene

from farpoint import RelativePoseOptions
from farpoint.pose import rivals
from farpoint.pose.fits import fit_moving
from farpoint.pose.matches import matches_from_points

AHEAD, UP = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def fit():
    drawn = point_scene(3)
    matches = matches_from_points(drawn.points0, drawn.points1, drawn.camera, drawn.camera)
    return fit_moving(matches, 1.5, RelativePoseOptions(), np.zeros(1, np.uint64))


@pytest.fixture
def elsewhere(fit, monkeypatch):
    """`likelier_elsewhere` where the motions found, in turn, are so much less likely."""

    def run(*against: float):
        waiting = list(against)

        def nearest(*given: np.ndarray) -> float:
            *_, R, t = given
            R[:], t[:] = np.eye(3), (AHEAD, UP)[len(waiting) % 2]
            return waiting.pop(0)

        monkeypatch.setattr(rivals, "nearest_rival", nearest)
        found = rivals.likelier_elsewhere(fit, 1.5)
        assert not waiting
        return found

    return run


def test_a_motion_that_is_less_likely_is_the_rival(fit, elsewhere):
    best, other = elsewhere(5.0)
    assert best is fit
    assert other.against == 5.0
    np.testing.assert_array_equal(other.direction_cam1_from_cam0, UP)


def test_without_any_there_is_no_rival(fit, elsewhere):
    assert elsewhere(np.inf) == (fit, None)


def test_a_likelier_motion_is_taken_and_compared_again(fit, elsewhere):
    best, other = elsewhere(-9.0, 12.0)
    assert best is not fit
    assert other.against == 12.0


def test_where_each_is_likelier_than_the_last_there_is_no_telling(elsewhere):
    _, other = elsewhere(-9.0, -9.0, -9.0)
    assert other.against == 0.0


def test_a_plain_motion_has_no_rival_that_comes_near(fit):
    best, other = rivals.likelier_elsewhere(fit, 1.5)
    assert best is fit
    assert other is None or other.against > 20.0
