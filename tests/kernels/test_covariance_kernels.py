"""Covariance at a pose and nearby, against the formulas in NumPy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
import scipy.linalg
from kernels_kit import View, half_width_of, packed, two_views
from scipy.stats import chi2, f

from farpoint._kernels import covariance
from farpoint._kernels.compile import kernel
from farpoint._kernels.constants import (
    LONG_TAIL,
    MAX_COVARIANCE_EXCESS,
    MIN_SIGNAL,
    MIN_SIGNAL_NEARBY,
    MODEL_VARIANCE_WEIGHT,
)
from farpoint._kernels.covariance import (
    covariance_around,
    covariance_beside,
    covariance_here,
    step_with_shrunk_flow,
)
from farpoint._kernels.epipolar import sampson
from farpoint._kernels.information import information
from farpoint._kernels.likelihood import linearize
from farpoint._kernels.pairs import address
from farpoint._kernels.pose import LinearisationPoint
from farpoint._kernels.vectors import matrix, tangent_columns, vector
from farpoint.geometry import so3, sphere

MIXTURE, CLUTTER, INLIERS = np.array([1.3, 0.1, 0.2, 0.0]), 0.05, 50.0
SPHERE = np.diag([0.0, 0.0, 0.0, 1.0, 1.0])


@kernel
def here_by(
    point: LinearisationPoint, inlier: float, shrunk_flow: bool, least: float, out: np.ndarray
) -> bool:
    return covariance_here(point, inlier, shrunk_flow, least, out)


@kernel
def beside_by(
    point: LinearisationPoint, shrunk_flow: bool, step: np.ndarray, out: np.ndarray
) -> bool:
    return covariance_beside(point, INLIERS, shrunk_flow, step, out)


@kernel
def step_by(point: LinearisationPoint) -> None:
    step_with_shrunk_flow(point)


@kernel
def noise_factor_of(inlier: float, effective: float) -> float:
    return covariance._estimated_noise_factor(inlier, effective)


def point_of(view: View) -> LinearisationPoint:
    return LinearisationPoint(
        view.pairs,
        packed(np.ones(view.size)),
        view.R,
        view.t,
        MIXTURE,
        half_width_of(MIXTURE, CLUTTER),
        LONG_TAIL,
    )


def here(
    view: View, least: float, out: np.ndarray, shrunk_flow: bool = False, inlier: float = INLIERS
) -> bool:
    return here_by(point_of(view), inlier, shrunk_flow, least, out)


class Expected(NamedTuple):
    """Gauss-Newton matrix, the part of it that is noise, and variance of the gradient."""

    whole: np.ndarray
    noise: np.ndarray
    variance: np.ndarray


def expected_of(view: View, shrunk_flow: bool = False, freedom: float = INLIERS - 5.0) -> Expected:
    normal, noise, scatter = np.empty((6, 6)), np.empty((5, 5)), np.empty((5, 5))
    share, effective = information(point_of(view), shrunk_flow, normal, noise, scatter)
    scatter_weight = effective / (effective + MODEL_VARIANCE_WEIGHT)
    noise_factor = noise_factor_of(freedom + 5.0, 0.0) - 10.0 / effective * scatter_weight**2
    whole = share * noise_factor * normal[:5, :5]
    variance = scatter_weight * noise_factor * scatter + (1.0 - scatter_weight) * whole + SPHERE
    return Expected(whole, share * noise_factor * noise, variance)


def sandwich(H: np.ndarray, V: np.ndarray) -> np.ndarray:
    return np.linalg.solve(H, np.linalg.solve(H, V).T)


def basis_of(t: np.ndarray) -> np.ndarray:
    return np.stack(tangent_columns(t), axis=1)


def beside(view: View, step: np.ndarray, shrunk_flow: bool = False) -> np.ndarray:
    """Covariance if the true pose is a step from that of the view, in the basis of the view."""
    R, t = so3.exp(step[:3]) @ view.R, sphere.normalize(view.t + basis_of(view.t) @ step[3:])
    whole, noise, *_ = expected_of(view._replace(R=R, t=t), shrunk_flow)
    basis_change = np.eye(5)
    basis_change[3:, 3:] = basis_of(view.t).T @ basis_of(t)
    H = whole + SPHERE - (0.0 if shrunk_flow else noise)
    return basis_change @ sandwich(H, whole + SPHERE) @ basis_change.T


def assert_covariances(actual: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(actual, expected, rtol=1e-8, atol=1e-10 * np.trace(expected))


@pytest.mark.parametrize("shrunk_flow", [False, True])
def test_the_covariance_is_the_sandwich_of_what_is_stated_and_what_is_seen(shrunk_flow):
    view, out = two_views(5, 60, error_rad=2e-3), np.empty((5, 5))
    assert here(view, MIN_SIGNAL, out, shrunk_flow)
    whole, noise, variance = expected_of(view, shrunk_flow)
    # Shrunk flow has no noise to subtract.
    assert_covariances(out, sandwich(whole + SPHERE - (0.0 if shrunk_flow else noise), variance))


def test_few_matches_have_a_large_covariance():
    view, out = two_views(5, 60, error_rad=2e-3), np.empty((5, 5))
    here(view, MIN_SIGNAL, out, inlier=5.0)
    whole, noise, variance = expected_of(view, freedom=4.0)
    assert_covariances(out, sandwich(whole + SPHERE - noise, variance))


@pytest.mark.parametrize("shrunk_flow", [False, True])
def test_matches_of_uncertain_label_leave_the_covariance_infinite(shrunk_flow):
    # About three sigma off, inlier and outlier are equally likely: the variance of the scores
    # exceeds the information.
    view, out = two_views(5, 200, error_rad=2e-3), np.zeros((5, 5))
    R, t = matrix(view.R), vector(view.t)
    off = np.array([abs(sampson(view.pairs, address(i), R, t)) for i in range(view.size)])
    uncertain = packed((off > 2.5) & (off < 3.0))
    mixture = np.array([1.0, 0.1, 0.01, 0.0])
    point = LinearisationPoint(
        view.pairs, uncertain, view.R, view.t, mixture, half_width_of(mixture, 0.02), LONG_TAIL
    )
    spare = np.empty((6, 6)), np.empty((5, 5)), np.empty((5, 5))
    assert information(point, shrunk_flow, *spare)[0] < 0.0
    assert not here_by(point, INLIERS, shrunk_flow, MIN_SIGNAL_NEARBY, out)
    assert np.isposinf(out).all()


@pytest.mark.parametrize("shrunk_flow", [False, True])
@pytest.mark.parametrize("axis", [None, 0, 2, 3, 4])
def test_the_covariance_beside_a_pose_is_that_of_the_pose_there_in_the_axes_of_this_one(
    axis, shrunk_flow
):
    view = two_views(5, 60, error_rad=2e-3)
    step, out = np.zeros(5), np.empty((5, 5))
    if axis is not None:
        step[axis] = 1e-3 if axis < 3 else 0.02
    assert beside_by(point_of(view), shrunk_flow, step, out)
    assert_covariances(out, beside(view, step, shrunk_flow))


@pytest.mark.parametrize(("baseline_m", "shows"), [(0.029, False), (0.031, True)])
def test_where_less_than_a_quarter_of_the_flow_is_signal_there_is_no_covariance(baseline_m, shows):
    view, out = two_views(5, 60, baseline_m=baseline_m), np.empty((5, 5))
    assert here(view, MIN_SIGNAL_NEARBY, out) == shows
    assert beside_by(point_of(view), False, np.zeros(5), out) == shows
    assert share_of(view) == pytest.approx(MIN_SIGNAL_NEARBY, abs=0.1)
    assert (share_of(view) > MIN_SIGNAL_NEARBY) == shows


def share_of(view: View, shrunk_flow: bool = False) -> float:
    """Share of signal in the flow, along the axis with the least of it."""
    whole, noise, *_ = expected_of(view, shrunk_flow)
    return 1.0 - scipy.linalg.eigh(noise, whole + SPHERE, eigvals_only=True)[-1]


def test_predicted_flow_has_a_covariance_whatever_it_shows():
    view, out = two_views(5, 60, baseline_m=0.03, error_rad=1e-3), np.empty((5, 5))
    share = share_of(view, shrunk_flow=True)
    assert share > share_of(view) + 0.1
    assert here(view, share - 0.01, out, shrunk_flow=True)
    assert not here(view, share + 0.01, out, shrunk_flow=True)
    whole, _, variance = expected_of(view, shrunk_flow=True)
    assert_covariances(out, sandwich(whole + SPHERE, variance))
    assert beside_by(point_of(view), True, np.zeros(5), out)


@pytest.mark.parametrize("freedom", [4.0, 5.0, 11.0, 15.0, 40.0, 85.0, 1000.0])
def test_noise_estimated_from_few_matches_inflates_the_covariance(freedom):
    mean = freedom / (freedom - 2.0)
    held = 5.0 * f.ppf(0.95, 5, freedom) / chi2.ppf(0.95, 5)
    assert 1.0 / noise_factor_of(freedom + 5.0, 0.0) == pytest.approx(0.5 * (mean + held), rel=0.02)


def test_the_step_is_that_of_the_predicted_normal_equations():
    view = two_views(5, 60, baseline_m=0.1, error_rad=1e-3)
    R, t = view.R.copy(), view.t.copy()
    normal, told_beside = np.empty((6, 6)), np.empty((2, 5, 5))
    information(point_of(view), True, normal, *told_beside)
    x = -np.linalg.solve(normal[:5, :5] + SPHERE, normal[:5, 5])
    assert 1e-4 < np.linalg.norm(x) < 0.3
    step_by(point_of(view))
    np.testing.assert_allclose(view.R, so3.exp(x[:3]) @ R, atol=1e-10)
    np.testing.assert_allclose(view.t, sphere.normalize(t + basis_of(t) @ x[3:]), atol=1e-10)


def log_likelihood(view: View, step: np.ndarray) -> float:
    """Log likelihood of all matches at a step from the view, averaged over the poses nearby."""
    R, t = so3.exp(step[:3]) @ view.R, sphere.normalize(view.t + basis_of(view.t) @ step[3:])
    normal = np.empty((6, 6))
    cost = linearize(point_of(view._replace(R=R, t=t)), False, normal, np.empty(4))
    return -cost - 0.5 * np.linalg.slogdet(np.eye(5) + normal[:5, :5])[1]


def around(
    view: View,
    covariance: np.ndarray,
    shrunk_flow: bool = False,
    allowed: np.ndarray | None = None,
) -> np.ndarray:
    """Mean over the poses within ``allowed``, by default the covariance itself."""
    values, axes = np.linalg.eigh(covariance if allowed is None else allowed)
    excess = np.zeros((5, 5))
    for step in np.ascontiguousarray((axes * np.sqrt(values)).T):
        sides = step, -step
        likely = np.exp([log_likelihood(view, side) - log_likelihood(view, step) for side in sides])
        for side, share in zip(sides, likely / likely.sum(), strict=True):
            shows = beside_by(point_of(view), shrunk_flow, side, np.empty((5, 5)))
            there = (
                beside(view, side, shrunk_flow)
                if shows
                else (1.0 + MAX_COVARIANCE_EXCESS) * covariance
            )
            excess += share * (there - beside(view, np.zeros(5), shrunk_flow))
    root = np.linalg.cholesky(covariance)
    more, along = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, excess).T))
    root = root @ along * np.sqrt(1.0 + np.clip(more, 0.0, MAX_COVARIANCE_EXCESS))
    return root @ root.T


@pytest.mark.parametrize(
    ("seed", "times", "least", "most"),
    # As it is; a little less sure, unless it is so everywhere; with an unlikely side where hardly
    # anything is signal, once, for then it is wide; with a likely one; and with many.
    [
        (7, 1.0, 1.0, 1.0),
        (6, 20.0, 1.002, 1.08),
        (8, 240.0, 1.13, 1.33),
        (6, 240.0, 2.77, 2.9),
        (5, 1e3, 9.0, 9.0),
    ],
)
def test_the_covariance_is_averaged_over_the_poses_nearby(seed, times, least, most):
    view = two_views(seed, 60, error_rad=2e-3)
    covariance, out = times * beside(view, np.zeros(5)), np.empty((5, 5))
    covariance_around(point_of(view), INLIERS, False, covariance, out)
    assert_covariances(out, around(view, covariance))
    scaled_pairs = scipy.linalg.eigh(out, covariance)[0]
    assert least - 1e-9 < scaled_pairs[0] <= scaled_pairs[-1] < most + 0.01


def test_a_covariance_with_a_large_excess_is_averaged_again():
    view = two_views(5, 60, error_rad=2e-3)
    covariance, out = 180.0 * beside(view, np.zeros(5)), np.empty((5, 5))
    once = around(view, covariance)
    covariance_around(point_of(view), INLIERS, False, covariance, out)
    assert_covariances(out, around(view, covariance, allowed=once))
    assert 1.4 < direction_variance(once) / direction_variance(covariance) < 1.6
    assert direction_variance(out) > 5.0 * direction_variance(once)


def direction_variance(covariance: np.ndarray) -> float:
    return float(np.trace(covariance[3:, 3:]))


def test_the_excess_with_shrunk_flow_is_that_of_shrunk_flow():
    view = two_views(6, 60, error_rad=2e-3)
    covariance, out = 20.0 * beside(view, np.zeros(5), shrunk_flow=True), np.empty((5, 5))
    covariance_around(point_of(view), INLIERS, True, covariance, out)
    assert_covariances(out, around(view, covariance, shrunk_flow=True))
    assert scipy.linalg.eigh(out, covariance)[0][-1] > 1.005
