"""Covariance of a pose, and mean of the covariance over nearby poses."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel
from farpoint._kernels.constants import (
    MAX_COVARIANCE_EXCESS,
    MAX_DIRECTION_VARIANCE,
    MIN_SIGNAL_NEARBY,
    MODEL_VARIANCE_WEIGHT,
    OUTER_ROUNDS,
    POSE_PARAMETERS,
    REPEAT_AVERAGE_ABOVE,
)
from farpoint._kernels.hypothesis_comparison import laplace_factor
from farpoint._kernels.information import information
from farpoint._kernels.likelihood import linearize
from farpoint._kernels.linear import eigen_five, sandwich, tangent_basis
from farpoint._kernels.normal_equations import predicted_decrease, solve_five_spd
from farpoint._kernels.pose import LinearisationPoint, apply_step, take_step

__all__ = [
    "MEASURED_FLOW",
    "SHRUNK_FLOW",
    "covariance_around",
    "covariance_beside",
    "covariance_here",
    "finite_sample_inflation",
    "step_with_shrunk_flow",
]

# Values of the argument ``shrunk_flow``: measured flow, or flow shrunk as in `information`. NumPy
# booleans, because numba would compile the kernels once for each of the literals True and False.
MEASURED_FLOW, SHRUNK_FLOW = np.bool_(False), np.bool_(True)


@kernel
def covariance_here(
    point: LinearisationPoint, inliers: float, shrunk_flow: bool, least: float, out: np.ndarray
) -> bool:
    """Covariance ``out`` (5, 5) of the pose; ``inliers`` is the expected number of inliers.

    The covariance is the sandwich ``H^-1 V H^-1``. H is the Gauss-Newton matrix of `information`.
    Without ``shrunk_flow``, the part of H that is due to noise is subtracted. V is the variance of
    the gradient: a weighted mean of the Gauss-Newton matrix and of the scatter of the gradient
    (`information`). The weight of the scatter increases with the effective number of matches.

    The function returns whether, along every axis, at least a share ``least`` of the Gauss-Newton
    matrix remains after the part that is due to noise is subtracted. If less remains and the flow
    is not shrunk, ``out`` is infinite. ``out`` is also infinite if the matches determine no pose,
    or if the mixture components of all matches are uncertain.
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
    """Take one step of the normal equations of `information` with the shrunk flow."""
    normal, noise, scatter, x = np.empty((6, 6)), np.empty((5, 5)), np.empty((5, 5)), np.empty(5)
    information(point, SHRUNK_FLOW, normal, noise, scatter)
    _add_direction_prior(normal)
    if solve_five_spd(normal, 0.0, x):
        take_step(point.R, point.t, x, predicted_decrease(normal, x)[1])


@inlined_kernel
def _scatter_weight(effective: float) -> float:
    """Weight of the scatter, 0 to 1, for an ``effective`` number of matches."""
    return effective / (effective + MODEL_VARIANCE_WEIGHT)


@inlined_kernel
def _estimated_noise_factor(inliers: float, effective: float) -> float:
    """Factor on the information for the estimated noise variance and the estimated scatter.

    The factor is the inverse of `finite_sample_inflation`, because the noise variance is estimated,
    minus a second term, because the scatter is estimated, too. The second term is the relative
    variance of the scatter times the squared weight of the scatter. Along one axis, the scatter is
    an estimate from n = effective / `POSE_PARAMETERS` matches, with the relative variance 2 / n.
    """
    scatter_weight = _scatter_weight(effective)
    scattered = (
        2.0 * POSE_PARAMETERS * scatter_weight * scatter_weight / max(effective, POSE_PARAMETERS)
    )
    return 1.0 / _finite_sample_inflation(max(inliers - 5.0, 4.0)) - scattered


def finite_sample_inflation(freedom: float) -> float:
    """Inflation of a covariance whose noise variance was estimated with f degrees of freedom.

    With an estimated noise variance, the squared Mahalanobis distance of a pose from the true pose
    has the distribution ``5 F(5, f)``. With a known variance, this distance would have a
    chi-squared distribution with 5 degrees of freedom. The estimate of the variance multiplies the
    expectation by ``f / (f - 2)``, and the 95 % quantile by ``1 + 4 / f + 12 / f^2`` (to 3 %). The
    inflation is the mean of these two factors.
    """
    on_average, for_most = freedom / (freedom - 2.0), 1.0 + (4.0 + 12.0 / freedom) / freedom
    return 0.5 * (on_average + for_most)


_finite_sample_inflation = inlined_kernel(finite_sample_inflation)


@inlined_kernel
def _add_direction_prior(information: np.ndarray) -> None:
    """Add a prior with a sigma of 1 rad on the direction, which bounds the covariance."""
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
    """Mean ``out`` (5, 5) of the covariance over the poses within one sigma of this pose.

    The mean is computed to second order. x is the pose of ``point``, C(x) is the covariance at the
    pose x by `covariance_beside`, s_k is one sigma along the k-th principal axis of ``covariance``,
    and w_k is the likelihood at ``x + s_k`` divided by the sum of the likelihoods at ``x + s_k``
    and ``x - s_k``. The excess is ``sum_k [w_k C(x + s_k) + (1 - w_k) C(x - s_k) - C(x)]``. Along
    every axis the excess is limited to between 0 and `MAX_COVARIANCE_EXCESS` times ``covariance``.
    The mean is ``covariance``, the covariance at ``point``, plus the limited excess. If the
    variance of the direction increases by a factor above `REPEAT_AVERAGE_ABOVE`, but stays below
    `MAX_DIRECTION_VARIANCE`, the mean is computed again with the axes and sigmas of the larger
    covariance.
    """
    allowed = np.empty((5, 5))
    copy(covariance, out)
    for _ in range(OUTER_ROUNDS):
        copy(out, allowed)
        _average(point, inliers, shrunk_flow, covariance, allowed, out)
        if (
            not REPEAT_AVERAGE_ABOVE * (allowed[3, 3] + allowed[4, 4])
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
    """``covariance`` plus the excess of `covariance_around`; s_k are those of ``allowed``."""
    steps, variances = np.empty((5, 5)), np.empty(5)
    excess, half = np.empty((5, 5)), np.empty((5, 5))
    _half_axes(allowed, steps, variances)
    _mean_excess(point, inliers, shrunk_flow, covariance, steps, excess)
    _half_axes(covariance, steps, variances)
    _product(steps, excess, half)
    _product(half, steps, excess)
    # In axes in which the covariance is the identity, the eigenvalues of the excess are ratios of
    # the excess to the covariance.
    for k in range(5):
        for j in range(5):
            excess[k, j] /= variances[k] * variances[j]
    eigen_five(excess, half)
    clear(out)
    for k in range(5):
        more = 1.0 + min(max(excess[k, k], 0.0), MAX_COVARIANCE_EXCESS)
        for i in range(5):
            for j in range(5):
                out[i, j] += more * _along(half, steps, k, i) * _along(half, steps, k, j)


@inner_kernel
def _half_axes(covariance: np.ndarray, out: np.ndarray, variances: np.ndarray) -> None:
    """Write the principal axes of a covariance (5, 5), times their sigmas, to the rows of ``out``.

    The variances are written to ``variances``.
    """
    values, axes = np.empty((5, 5)), np.empty((5, 5))
    copy(covariance, values)
    eigen_five(values, axes)
    for k in range(5):
        variances[k] = values[k, k]
        for i in range(5):
            out[k, i] = math.sqrt(values[k, k]) * axes[k, i]


@inlined_kernel
def _along(A: np.ndarray, B: np.ndarray, i: int, j: int) -> float:
    """Element (i, j) of ``A @ B`` (5, 5)."""
    total = 0.0
    for k in range(5):
        total = total + A[i, k] * B[k, j]
    return total


@step_kernel
def _mean_excess(
    point: LinearisationPoint,
    inliers: float,
    shrunk_flow: bool,
    covariance: np.ndarray,
    steps: np.ndarray,
    out: np.ndarray,
) -> None:
    """Excess ``out`` (5, 5) of the covariance at nearby poses over that at this pose.

    The rows of ``steps`` (5, 5) are the steps to nearby poses, one for each principal axis. ``out``
    is a sum over the axes. Each axis contributes the mean excess at the poses moved by plus and
    minus the step, weighted by the likelihoods of the two poses (`_log_likelihood_beside`). If
    `covariance_beside` finds no covariance at a pose, ``(1 + MAX_COVARIANCE_EXCESS) covariance`` is
    used.
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
    """Add to ``out`` the covariance at the pose moved by a ``step``, times a weight."""
    there = np.empty((5, 5))
    shows = covariance_beside(point, inliers, shrunk_flow, step, there)
    for i in range(5):
        for j in range(5):
            value = there[i, j] if shows else (1.0 + MAX_COVARIANCE_EXCESS) * covariance[i, j]
            out[i, j] += weight * value


@inner_kernel
def _log_likelihood_beside(point: LinearisationPoint, step: np.ndarray) -> float:
    """Log likelihood at the pose moved by a ``step`` (5,), averaged over nearby poses (Laplace)."""
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
    """Covariance ``out`` (5, 5) if the true pose is that of ``point`` moved by a ``step`` (5,).

    The covariance is computed at the moved pose, as by `covariance_here`, and then transformed to
    the tangent basis of the direction of ``point``. The scatter of the gradient is not used,
    because the moved pose is not a maximum of the likelihood. The function returns False if along
    some axis less than a share `MIN_SIGNAL_NEARBY` of the Gauss-Newton matrix remains after the
    part that is due to noise is subtracted. With ``shrunk_flow``, nothing is subtracted.
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
    _change_basis(point.t, moved_t, there, out)
    return True


@step_kernel
def _change_basis(t: np.ndarray, moved_t: np.ndarray, there: np.ndarray, out: np.ndarray) -> None:
    """Transform a covariance (5, 5) from the tangent basis of one direction to that of another."""
    basis, moved_basis, basis_change, half = (
        np.empty((3, 2)),
        np.empty((3, 2)),
        np.empty((5, 5)),
        np.empty((5, 5)),
    )
    tangent_basis(t, basis)
    tangent_basis(moved_t, moved_basis)
    for i in range(5):
        for j in range(5):
            basis_change[i, j] = 1.0 if i == j else 0.0
            if i > 2 and j > 2:
                basis_change[i, j] = 0.0
                for k in range(3):
                    basis_change[i, j] += basis[k, i - 3] * moved_basis[k, j - 3]
    _product(basis_change, there, half)
    _product(half, basis_change, out)


@inner_kernel
def _product(A: np.ndarray, B: np.ndarray, out: np.ndarray) -> None:
    """``A @ B.T`` (5, 5)."""
    for i in range(5):
        for j in range(5):
            out[i, j] = 0.0
            for k in range(5):
                out[i, j] += A[i, k] * B[j, k]
