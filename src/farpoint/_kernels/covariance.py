"""How sure a pose is: the covariance at it, and what that is at the poses around."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel
from farpoint._kernels.hypothesis_comparison import laplace_factor
from farpoint._kernels.information import information
from farpoint._kernels.likelihood import linearize
from farpoint._kernels.linear import eigen_five, sandwich, tangent_basis
from farpoint._kernels.normal_equations import predicted_decrease, solve_five_spd
from farpoint._kernels.pose import LinearisationPoint, apply_step, take_step

__all__ = [
    "MEASURED_FLOW",
    "MIN_SIGNAL",
    "MIN_SIGNAL_NEARBY",
    "SHRUNK_FLOW",
    "covariance_around",
    "covariance_beside",
    "covariance_here",
    "finite_sample_inflation",
    "step_with_shrunk_flow",
]

# How the flow of a match is known. Of a type of its own: for a plain word numba would compile all
# that is asked of it twice.
MEASURED_FLOW, SHRUNK_FLOW = np.bool_(False), np.bool_(True)
# Where less than this of what the measured flow tells, along any axis, is signal, the flow is
# predicted.
MIN_SIGNAL = 0.85
# Where less than this is, a pose beside the one that was found has no covariance.
MIN_SIGNAL_NEARBY = 0.25
# Matches whose residuals weigh as much as the noise that was found, in saying how the gradient
# varies: few residuals, or a few that most depends on, tell little of it.
MODEL_WEIGHT = 120.0
# Matches of which one tells of the pose along a given axis.
MATCHES_PER_AXIS = 5.0
# How much larger than the covariance of one pose the mean over all may be.
MAX_GROWTH = 8.0
# It is averaged again, so often in all, if the variance of its direction grows by more than that,
# but is less than this, rad^2: more is as much as second order can tell.
REPEAT_ABOVE = 1.1
ROUNDS = 3
MAX_DIRECTION_VARIANCE = math.radians(12.0) ** 2


@kernel
def covariance_here(
    point: LinearisationPoint, inliers: float, shrunk_flow: bool, least: float, out: np.ndarray
) -> bool:
    """Covariance ``out`` (5, 5) of the pose, which so many matches were found to share.

    The sandwich ``H^-1 V H^-1``. H is the Gauss-Newton matrix, as of `information`, less what of it
    is noise, if it is not predicted; V the variance of the gradient: that matrix, and its scatter
    over the matches, the more, the more there are. False where less than ``least`` of the matrix is
    signal; then, if it is not predicted, and where the matches tell nothing, ``out`` is infinite:
    if none of them is known to be right or wrong, less than nothing is known of the pose.
    """
    normal, noise, spare = np.empty((6, 6)), np.empty((5, 5)), np.empty((5, 5))
    scatter, variance, whole = np.empty((5, 5)), np.empty((5, 5)), np.empty((5, 5))
    share, effective = information(point, shrunk_flow, normal, noise, scatter)
    scatter_weight, noise_factor = (
        _scatter_weight(effective),
        _estimated_noise_factor(inliers, effective),
    )
    known = noise_factor * share
    for i in range(5):
        for j in range(5):
            whole[i, j] = known * normal[i, j]
            noise[i, j] *= known
            variance[i, j] = (
                scatter_weight * noise_factor * scatter[i, j] + (1.0 - scatter_weight) * whole[i, j]
            )
    _add_direction_prior(variance)
    _add_direction_prior(whole)
    shows = True
    if shrunk_flow:
        shows = sandwich(whole, noise, whole, least, spare)
        clear(noise)
    if sandwich(whole, noise, variance, least, out):
        return shows
    out[:] = math.inf
    return False


@kernel
def step_with_shrunk_flow(point: LinearisationPoint) -> None:
    """Move the pose by the solution of the normal equations of `information`."""
    normal, noise, scatter, x = np.empty((6, 6)), np.empty((5, 5)), np.empty((5, 5)), np.empty(5)
    information(point, SHRUNK_FLOW, normal, noise, scatter)
    _add_direction_prior(normal)
    if solve_five_spd(normal, 0.0, x):
        take_step(point.R, point.t, x, predicted_decrease(normal, x)[1])


@inlined_kernel
def _scatter_weight(effective: float) -> float:
    """How much the scatter of the residuals counts, of 1, where so many matches tell alike."""
    return effective / (effective + MODEL_WEIGHT)


@inlined_kernel
def _estimated_noise_factor(inliers: float, effective: float) -> float:
    """What is left of the information for having estimated the noise and the scatter, too.

    From few matches both are known roughly: the noise as `finite_sample_inflation` says. The scatter along
    one axis is that of the matches that tell most of it: of one in `MATCHES_PER_AXIS`, and so much larger is
    what its variance, 2 over their number, adds to the inverse, by the square of how far it is
    heard.
    """
    scatter_weight = _scatter_weight(effective)
    scattered = (
        2.0 * MATCHES_PER_AXIS * scatter_weight * scatter_weight / max(effective, MATCHES_PER_AXIS)
    )
    return 1.0 / finite_sample_inflation(max(inliers - 5.0, 4.0)) - scattered


@kernel
def finite_sample_inflation(freedom: float) -> float:
    """How much larger a covariance is for a variance that was estimated with f degrees of freedom.

    Squared errors are distributed as ``5 F(5, f)``: their mean is larger by ``f / (f - 2)`` than
    with a known variance, and what holds 95 % of them by ``1 + 4 / f + 12 / f^2`` (to 3 %). No
    factor serves both; this one is half-way.
    """
    on_average, for_most = freedom / (freedom - 2.0), 1.0 + (4.0 + 12.0 / freedom) / freedom
    return 0.5 * (on_average + for_most)


@inlined_kernel
def _add_direction_prior(information: np.ndarray) -> None:
    """Add that of one radian on the direction, none on the rotation: the sphere is bounded."""
    for i in (3, 4):
        information[i, i] += 1.0


@kernel
def covariance_around(
    point: LinearisationPoint,
    inliers: float,
    shrunk_flow: bool,
    covariance: np.ndarray,
    out: np.ndarray,
) -> None:
    """Mean ``out`` (5, 5) of the covariance over the poses that it allows itself.

    To second order: larger than the ``covariance`` here by what that is, on average, a sigma to
    either side along each axis, more than here; each side counts as far as the poses there are
    likely. Along no axis it shrinks, or grows by more than `MAX_GROWTH` times. Where it grows
    much, it is averaged again over what it then allows.
    """
    allowed = np.empty((5, 5))
    copy(covariance, out)
    for _ in range(ROUNDS):
        copy(out, allowed)
        _average(point, inliers, shrunk_flow, covariance, allowed, out)
        if (
            not REPEAT_ABOVE * (allowed[3, 3] + allowed[4, 4])
            < out[3, 3] + out[4, 4]
            < MAX_DIRECTION_VARIANCE
        ):
            break


@step_kernel
def _average(
    point: LinearisationPoint,
    inliers: float,
    shrunk_flow: bool,
    covariance: np.ndarray,
    allowed: np.ndarray,
    out: np.ndarray,
) -> None:
    """The ``covariance`` (5, 5) here, grown to the mean over the poses that ``allowed`` allows."""
    steps, variances = np.empty((5, 5)), np.empty(5)
    excess, half = np.empty((5, 5)), np.empty((5, 5))
    _half_axes(allowed, steps, variances)
    _add_excess(point, inliers, shrunk_flow, covariance, steps, excess)
    _half_axes(covariance, steps, variances)
    _product(steps, excess, half)
    _product(half, steps, excess)
    # In axes in which the covariance is the identity, growth is what it is times as large.
    for k in range(5):
        for j in range(5):
            excess[k, j] /= variances[k] * variances[j]
    eigen_five(excess, half)
    clear(out)
    for k in range(5):
        more = 1.0 + min(max(excess[k, k], 0.0), MAX_GROWTH)
        for i in range(5):
            for j in range(5):
                out[i, j] += more * _along(half, steps, k, i) * _along(half, steps, k, j)


@inner_kernel
def _half_axes(covariance: np.ndarray, out: np.ndarray, variances: np.ndarray) -> None:
    """A sigma along each axis of a covariance (5, 5), the rows of ``out``, and its square."""
    values, axes = np.empty((5, 5)), np.empty((5, 5))
    copy(covariance, values)
    eigen_five(values, axes)
    for k in range(5):
        variances[k] = values[k, k]
        for i in range(5):
            out[k, i] = math.sqrt(values[k, k]) * axes[k, i]


@inlined_kernel
def _along(A: np.ndarray, B: np.ndarray, i: int, j: int) -> float:
    """An element of ``A @ B`` (5, 5)."""
    total = 0.0
    for k in range(5):
        total = total + A[i, k] * B[k, j]
    return total


@step_kernel
def _add_excess(
    point: LinearisationPoint,
    inliers: float,
    shrunk_flow: bool,
    covariance: np.ndarray,
    steps: np.ndarray,
    out: np.ndarray,
) -> None:
    """How much larger (5, 5) a ``covariance`` is on average, by such ``steps`` (rows) around here.

    Of the two poses a step ahead and back, each counts as its likelihood, averaged over the poses
    nearby. The covariance is `MAX_GROWTH` times as large again where hardly anything is signal.
    """
    back = np.empty(5)
    clear(out)
    clear(back)
    _add_beside(point, inliers, shrunk_flow, covariance, back, -5.0, out)
    for k in range(5):
        ahead = steps[k]
        for i in range(5):
            back[i] = -ahead[i]
        log_ratio = _log_likelihood_beside(point, back) - _log_likelihood_beside(point, ahead)
        share = 1.0 / (1.0 + math.exp(min(log_ratio, 50.0)))
        _add_beside(point, inliers, shrunk_flow, covariance, ahead, share, out)
        _add_beside(point, inliers, shrunk_flow, covariance, back, 1.0 - share, out)


@inner_kernel
def _add_beside(
    point: LinearisationPoint,
    inliers: float,
    shrunk_flow: bool,
    covariance: np.ndarray,
    step: np.ndarray,
    weight: float,
    out: np.ndarray,
) -> None:
    """Add the covariance a ``step`` beside this pose, times a weight."""
    there = np.empty((5, 5))
    shows = covariance_beside(point, inliers, shrunk_flow, step, there)
    for i in range(5):
        for j in range(5):
            value = there[i, j] if shows else (1.0 + MAX_GROWTH) * covariance[i, j]
            out[i, j] += weight * value


@inner_kernel
def _log_likelihood_beside(point: LinearisationPoint, step: np.ndarray) -> float:
    """Of all matches, averaged over the poses around that a ``step`` (5,) beside this one."""
    moved_R, moved_t, normal, shares = np.empty((3, 3)), np.empty(3), np.empty((6, 6)), np.empty(4)
    copy(point.R, moved_R)
    copy(point.t, moved_t)
    apply_step(moved_R, moved_t, step)
    moved = LinearisationPoint(
        point.pairs,
        point.prior,
        moved_R,
        moved_t,
        point.mixture,
        point.outlier_half_width,
        point.long_tail,
    )
    cost = linearize(moved, False, normal, shares)
    return max(-cost - laplace_factor(normal), -1e300)


@inner_kernel
def covariance_beside(
    point: LinearisationPoint, inliers: float, shrunk_flow: bool, step: np.ndarray, out: np.ndarray
) -> bool:
    """Covariance ``out`` (5, 5) if the right pose is ``step`` (5,) beside this one.

    As `covariance_here`, in the axes of this pose; the residuals there are not those of a fit, and
    are not heard.
    """
    moved_R, moved_t, there = np.empty((3, 3)), np.empty(3), np.empty((5, 5))
    normal, noise, scatter = np.empty((6, 6)), np.empty((5, 5)), np.empty((5, 5))
    whole = np.empty((5, 5))
    copy(point.R, moved_R)
    copy(point.t, moved_t)
    apply_step(moved_R, moved_t, step)
    moved = LinearisationPoint(
        point.pairs,
        point.prior,
        moved_R,
        moved_t,
        point.mixture,
        point.outlier_half_width,
        point.long_tail,
    )
    share, effective = information(moved, shrunk_flow, normal, noise, scatter)
    known = _estimated_noise_factor(inliers, effective) * share
    for i in range(5):
        for j in range(5):
            whole[i, j] = known * normal[i, j]
            noise[i, j] *= 0.0 if shrunk_flow else known
    _add_direction_prior(whole)
    if not sandwich(whole, noise, whole, MIN_SIGNAL_NEARBY, there):
        return False
    _turn_axes(point.t, moved_t, there, out)
    return True


@step_kernel
def _turn_axes(t: np.ndarray, moved_t: np.ndarray, there: np.ndarray, out: np.ndarray) -> None:
    """Bring a covariance (5, 5) from the tangent basis of one direction to that of another."""
    basis, moved_basis, turn, half = (
        np.empty((3, 2)),
        np.empty((3, 2)),
        np.empty((5, 5)),
        np.empty((5, 5)),
    )
    tangent_basis(t, basis)
    tangent_basis(moved_t, moved_basis)
    for i in range(5):
        for j in range(5):
            turn[i, j] = 1.0 if i == j else 0.0
            if i > 2 and j > 2:
                turn[i, j] = 0.0
                for k in range(3):
                    turn[i, j] += basis[k, i - 3] * moved_basis[k, j - 3]
    _product(turn, there, half)
    _product(half, turn, out)


@inner_kernel
def _product(A: np.ndarray, B: np.ndarray, out: np.ndarray) -> None:
    """``A @ B.T`` (5, 5)."""
    for i in range(5):
        for j in range(5):
            out[i, j] = 0.0
            for k in range(5):
                out[i, j] += A[i, k] * B[j, k]
