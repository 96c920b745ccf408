"""The covariance at a pose and around it, held against the formulas written in NumPy."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from kernels_kit import View, packed, two_views

from farpoint._kernels.covariance import (
    MOST_GROWTH,
    SIGNAL,
    STATED,
    covariance_beside,
    covariance_here,
    growth_around,
)
from farpoint._kernels.information import information
from farpoint._kernels.vectors import tangent_columns
from farpoint.geometry import so3, sphere

MIXTURE, CLUTTER, RIGHT = np.array([1.3, 0.1, 0.2]), 0.05, 50.0
HEARD = RIGHT / (RIGHT + STATED)
SURE = (RIGHT - 5.0 - 2.0 - 3.0 * HEARD) / (RIGHT - 5.0)
SPHERE = np.diag([0.0, 0.0, 0.0, 1.0, 1.0])


def arguments(view: View) -> tuple:
    """What all three take first."""
    return view.pairs, packed(np.ones(view.size)), view.R, view.t, MIXTURE, CLUTTER


def told(view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss-Newton matrix, the part of it that is noise, and the scatter of the gradient."""
    whole, noise, scatter = np.empty((3, 5, 5))
    known = information(*arguments(view), whole, noise, scatter)
    return SURE * known * whole, SURE * known * noise, SURE * scatter


def sandwich(H: np.ndarray, V: np.ndarray) -> np.ndarray:
    return np.linalg.solve(H, np.linalg.solve(H, V).T)


def basis_of(t: np.ndarray) -> np.ndarray:
    return np.stack(tangent_columns(t), axis=1)


def beside(view: View, step: np.ndarray) -> np.ndarray:
    """Covariance if the right pose is this step beside that of the view, in the axes of that."""
    R, t = so3.exp(step[:3]) @ view.R, sphere.normalize(view.t + basis_of(view.t) @ step[3:])
    whole, noise, _ = told(view._replace(R=R, t=t))
    turn = np.eye(5)
    turn[3:, 3:] = basis_of(view.t).T @ basis_of(t)
    return turn @ sandwich(whole + SPHERE - noise, whole + SPHERE) @ turn.T


def assert_covariances(actual: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(actual, expected, rtol=1e-8, atol=1e-10 * np.trace(expected))


def test_the_covariance_is_the_sandwich_of_what_is_stated_and_what_is_seen():
    view = two_views(5, 60, error_rad=2e-3)
    whole, noise, out = np.empty((3, 5, 5))
    assert covariance_here(*arguments(view), RIGHT, whole, noise, out)
    expected, expected_noise, scatter = told(view)
    assert_covariances(whole, expected + SPHERE)
    assert_covariances(noise, expected_noise)
    V = HEARD * scatter + (1.0 - HEARD) * expected + SPHERE
    assert_covariances(out, sandwich(expected + SPHERE - expected_noise, V))


def test_few_matches_are_hardly_sure_of_anything():
    view = two_views(5, 60, error_rad=2e-3)
    whole, noise, out = np.empty((3, 5, 5))
    covariance_here(*arguments(view), 5.0, whole, noise, out)
    few = (4.0 - 2.0 - 3.0 * 5.0 / (5.0 + STATED)) / 4.0
    assert_covariances(whole - SPHERE, few / SURE * told(view)[0])


@pytest.mark.parametrize("axis", [None, 0, 2, 3, 4])
def test_the_covariance_beside_a_pose_is_that_of_the_pose_there_in_the_axes_of_this_one(axis):
    view = two_views(5, 60, error_rad=2e-3)
    step, out = np.zeros(5), np.empty((5, 5))
    if axis is not None:
        step[axis] = 1e-3 if axis < 3 else 0.02
    assert covariance_beside(*arguments(view), RIGHT, step, out)
    assert_covariances(out, beside(view, step))


@pytest.mark.parametrize(("baseline_m", "shows"), [(0.029, False), (0.031, True)])
def test_where_less_than_a_quarter_of_the_flow_is_signal_there_is_no_covariance(baseline_m, shows):
    view = two_views(5, 60, baseline_m=baseline_m)
    whole, noise, out = np.empty((3, 5, 5))
    assert covariance_here(*arguments(view), RIGHT, whole, noise, out) == shows
    share = 1.0 - scipy.linalg.eigh(noise, whole)[0][-1]
    assert SIGNAL - 0.1 < share < SIGNAL + 0.1
    assert (share > SIGNAL) == shows
    assert covariance_beside(*arguments(view), RIGHT, np.zeros(5), out) == shows


def test_the_growth_is_half_the_second_difference_along_both_axes():
    view = two_views(5, 60, error_rad=2e-3)
    axes, out = np.diag([1e-3, 0.0, 0.0, 0.02, 0.0])[[0, 3]], np.empty((5, 5))
    growth_around(*arguments(view), RIGHT, np.full((5, 5), np.nan), axes, out)
    around = sum(beside(view, step) for step in (*axes, *-axes))
    assert_covariances(out, 0.5 * (around - 4.0 * beside(view, np.zeros(5))))


def test_where_hardly_anything_is_signal_the_covariance_grows_as_far_as_it_may():
    view = two_views(5, 60, error_rad=2e-3)
    covariance, axes, out = np.diag(np.arange(1.0, 6.0)), np.zeros((2, 5)), np.empty((5, 5))
    axes[:, 0] = 0.1
    assert not covariance_beside(*arguments(view), RIGHT, axes[0], out)
    assert not covariance_beside(*arguments(view), RIGHT, -axes[0], out)
    growth_around(*arguments(view), RIGHT, covariance, axes, out)
    most = (1.0 + MOST_GROWTH) * covariance
    assert_covariances(out, 2.0 * (most - beside(view, np.zeros(5))))
