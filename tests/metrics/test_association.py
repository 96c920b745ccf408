"""The true pose at the time of an estimate."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.metrics import AssociationOptions, poses_at_frames, poses_at_times

RATE = np.array([0.3, -0.2, 0.5])  # rad/s
SPEED = np.array([1.0, 2.0, -3.0])  # m/s


def screw(times: np.ndarray) -> np.ndarray:
    """Constant angular and linear velocity, which slerp and linear interpolation follow exactly."""
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = so3.exp(np.outer(times, RATE))
    poses[:, :3, 3] = np.outer(times, SPEED)
    return poses


TRUTH_TIMES = 100.0 + np.arange(50) * 0.05


def test_interpolation_follows_a_steady_motion_exactly():
    wanted = np.array([101.234, 100.0, 102.45, 100.025])
    poses = poses_at_times(TRUTH_TIMES, screw(TRUTH_TIMES), wanted)
    np.testing.assert_allclose(poses, screw(wanted), atol=1e-9)


def test_times_outside_the_truth_have_no_pose_but_rounded_ones_do():
    wanted = np.array([99.9, 99.9995, 101.0, 102.4504, 102.46])
    poses = poses_at_times(TRUTH_TIMES, screw(TRUTH_TIMES), wanted)
    assert np.isnan(poses[:, 0, 0]).tolist() == [True, False, False, False, True]
    np.testing.assert_allclose(poses[1], screw(TRUTH_TIMES[:1])[0])


def test_nothing_is_interpolated_across_a_gap():
    times = np.delete(TRUTH_TIMES, slice(10, 20))
    wanted = np.array([100.42, 100.45, 100.7, 101.0])
    options = AssociationOptions(max_gap_s=0.2)
    poses = poses_at_times(times, screw(times), wanted, options)
    assert np.isnan(poses[:, 0, 0]).tolist() == [False, False, True, False]
    wider = poses_at_times(times, screw(times), wanted, AssociationOptions(max_gap_s=0.6))
    np.testing.assert_allclose(wider, screw(wanted), atol=1e-9)


def test_exact_times_need_no_neighbours():
    times = np.array([0.0, 10.0, 20.0])
    np.testing.assert_allclose(poses_at_times(times, screw(times), times), screw(times), atol=1e-12)
    one = poses_at_times(times[1:2], screw(times[1:2]), times)
    assert np.isnan(one[:, 0, 0]).tolist() == [True, False, True]
    np.testing.assert_allclose(one[1], screw(times)[1])


def test_disjoint_times_are_reported_with_both_spans():
    with pytest.raises(InputError, match=r"do not overlap: estimates 0\.0.* truth 100\.0"):
        poses_at_times(TRUTH_TIMES, screw(TRUTH_TIMES), np.arange(5.0))
    with pytest.raises(InputError, match=r"only in gaps over 0\.2 s"):
        poses_at_times(np.array([0.0, 10.0]), screw(np.array([0.0, 10.0])), np.array([5.0]))
    with pytest.raises(InputError, match="0 estimated and 50 true"):
        poses_at_times(TRUTH_TIMES, screw(TRUTH_TIMES), np.empty(0))


def test_times_must_be_in_order():
    times = TRUTH_TIMES.copy()
    times[7] = times[5]
    with pytest.raises(InputError, match=r"^truth pose 7: expected time stamps in order"):
        poses_at_times(times, screw(TRUTH_TIMES), TRUTH_TIMES)


def test_of_equal_times_the_first_counts():
    times = np.repeat(TRUTH_TIMES, 2)
    truth = screw(times)
    truth[1::2, :3, 3] = 1e3
    wanted = np.array([100.02, 100.05])
    np.testing.assert_allclose(poses_at_times(times, truth, wanted), screw(wanted), atol=1e-9)


def test_frames_pick_their_rows():
    truth = screw(np.arange(5.0))
    poses = poses_at_frames(truth, np.array([4, 0, 5, -1]))
    np.testing.assert_array_equal(poses[:2], truth[[4, 0]])
    assert np.isnan(poses[2:]).all()
    with pytest.raises(InputError, match="poses for 5 frames"):
        poses_at_frames(truth, np.array([5, 6]))


@pytest.mark.parametrize("field", ["tolerance_s", "max_gap_s"])
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_options_are_checked(field: str, value: float):
    with pytest.raises(InputError, match=rf"^{field}: expected seconds"):
        AssociationOptions(**{field: value})
