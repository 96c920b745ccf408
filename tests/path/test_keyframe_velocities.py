"""Velocities of keyframes, from mean velocities over the intervals between frames."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.geometry import so3
from farpoint.path.keyframe import Keyframe
from farpoint.path.velocities import KeyframeVelocities, mean_velocity

# Velocity (6,) at time t: a polynomial of third degree, with coefficients (4, 6).
COEFFICIENTS = np.random.default_rng(0).normal(size=(4, 6))


def velocity(t: float) -> np.ndarray:
    return t ** np.arange(4) @ COEFFICIENTS


def mean(begin: float) -> np.ndarray:
    """Mean of the velocity over the unit of time from ``begin``."""
    powers = np.arange(1, 5)
    return ((begin + 1.0) ** powers - begin**powers) / powers @ COEFFICIENTS


def keyframe(twist: np.ndarray | None = None) -> Keyframe:
    twist = np.zeros(6) if twist is None else twist
    return Keyframe(frame=2, timestamp=0.0, R=np.eye(3), p=np.zeros(3), twist=twist)


def until_keyframe() -> tuple[KeyframeVelocities, Keyframe]:
    """Two intervals before a keyframe at time 0, and one after it."""
    velocities = KeyframeVelocities()
    velocities.add(mean(-2.0))
    velocities.add(mean(-1.0))
    key = keyframe(velocities.last)
    velocities.add_keyframe(key)
    velocities.add(mean(0.0))
    return velocities, key


def test_a_velocity_is_exact_after_two_intervals_and_a_mean_after_one():
    velocities, key = until_keyframe()
    np.testing.assert_allclose(key.twist, 0.5 * (mean(-1.0) + mean(0.0)))
    velocities.add(mean(1.0))
    np.testing.assert_allclose(key.twist, velocity(0.0))
    velocities.add(mean(2.0))  # later intervals do not change it
    np.testing.assert_allclose(key.twist, velocity(0.0))


def test_the_first_keyframe_has_the_velocity_of_the_next_interval():
    velocities, first = KeyframeVelocities(), keyframe()
    velocities.add_keyframe(first)
    velocities.add(mean(0.0))
    velocities.add(mean(1.0))
    np.testing.assert_allclose(first.twist, mean(0.0))


def test_a_correction_of_the_poses_is_in_the_velocities_that_follow():
    velocities, key = until_keyframe()
    change, last = np.arange(6.0), velocities.last
    before = {key.frame: key.twist}
    key.twist = key.twist + change
    velocities.correct(key, before)
    np.testing.assert_allclose(velocities.last, last + change)
    # All mean velocities of the keyframe are corrected, the one of the next interval is new.
    velocities.add(mean(1.0) + change)
    np.testing.assert_allclose(key.twist, velocity(0.0) + change)


def test_after_a_shift_of_all_poses_the_keyframe_keeps_its_velocity():
    velocities, key = until_keyframe()
    last, twist, rate = velocities.last, key.twist, np.arange(6.0)
    velocities.shift(rate)
    np.testing.assert_allclose(velocities.last, last + rate)
    velocities.add(mean(1.0))
    np.testing.assert_allclose(key.twist, twist)


def test_a_mean_velocity_leads_from_one_pose_to_the_other():
    R0, R1 = so3.exp(np.array([0.1, -0.2, 0.3])), so3.exp(np.array([0.2, 0.1, -0.1]))
    p0, p1 = np.array([1.0, 2.0, 3.0]), np.array([1.5, 2.0, 2.0])
    found = mean_velocity((R0, p0), (R1, p1), 0.5)
    np.testing.assert_allclose(so3.exp(0.5 * found[:3]) @ R0, R1, atol=1e-12)
    np.testing.assert_allclose(p0 + 0.5 * found[3:], p1)
    for seconds in (0.0, -1.0, np.nan):
        assert mean_velocity((R0, p0), (R1, p1), seconds) == pytest.approx(np.zeros(6))
