"""How sure a pose is: the covariance at it, and what that is at the poses around."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear, copy
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, step_kernel
from farpoint._kernels.contest import narrowness
from farpoint._kernels.information import information
from farpoint._kernels.likelihood import linearize
from farpoint._kernels.linear import eigen_five, sandwich, tangent_basis
from farpoint._kernels.pose import Seen, apply_step, take_step
from farpoint._kernels.squares import promise, solve_five_spd

__all__ = [
    "MEASURED",
    "PLAIN",
    "PREDICTED",
    "SIGNAL",
    "covariance_around",
    "covariance_beside",
    "covariance_here",
    "growth_by_few",
    "step_by_prediction",
]

# How the flow of a match is known. Of a type of its own: for a plain word numba would compile all
# that is asked of it twice.
MEASURED, PREDICTED = np.bool_(False), np.bool_(True)
# Where less than this of what the measured flow tells, along any axis, is signal, the flow is
# predicted.
PLAIN = 0.85
# Where less than this is, a pose beside the one that was found has no covariance.
SIGNAL = 0.25
# Matches whose residuals weigh as much as the noise that was found, in saying how the gradient
# varies: few residuals, or a few that most depends on, tell little of it.
STATED = 120.0
# Matches of which one tells of the pose along a given axis.
TELLING = 5.0
# How much larger than the covariance of one pose the mean over all may be.
MOST_GROWTH = 8.0
# It is averaged again, so often in all, if the variance of its direction grows by more than that,
# but is less than this, rad^2: more is as much as second order can tell.
MUCH = 1.1
ROUNDS = 3
WIDE = math.radians(12.0) ** 2


@kernel
def covariance_here(
    seen: Seen, right: float, predicted: bool, least: float, out: np.ndarray
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
    share, alike = information(seen, predicted, normal, noise, scatter)
    heard, sure = _heard(alike), _sure(right, alike)
    known = sure * share
    for i in range(5):
        for j in range(5):
            whole[i, j] = known * normal[i, j]
            noise[i, j] *= known
            variance[i, j] = heard * sure * scatter[i, j] + (1.0 - heard) * whole[i, j]
    _bound(variance)
    _bound(whole)
    shows = True
    if predicted:
        shows = sandwich(whole, noise, whole, least, spare)
        clear(noise)
    if sandwich(whole, noise, variance, least, out):
        return shows
    out[:] = math.inf
    return False


@kernel
def step_by_prediction(seen: Seen) -> None:
    """Move the pose by the solution of the normal equations of `information`."""
    normal, noise, scatter, x = np.empty((6, 6)), np.empty((5, 5)), np.empty((5, 5)), np.empty(5)
    information(seen, PREDICTED, normal, noise, scatter)
    _bound(normal)
    if solve_five_spd(normal, 0.0, x):
        take_step(seen.R, seen.t, x, promise(normal, x)[1])


@inlined_kernel
def _heard(alike: float) -> float:
    """How much the scatter of the residuals counts, of 1, where so many matches tell alike."""
    return alike / (alike + STATED)


@inlined_kernel
def _sure(right: float, alike: float) -> float:
    """What is left of the information for having estimated the noise and the scatter, too.

    From few matches both are known roughly: the noise as `growth_by_few` says. The scatter along
    one axis is that of the matches that tell most of it: of one in `TELLING`, and so much larger is
    what its variance, 2 over their number, adds to the inverse, by the square of how far it is
    heard.
    """
    heard = _heard(alike)
    scattered = 2.0 * TELLING * heard * heard / max(alike, TELLING)
    return 1.0 / growth_by_few(max(right - 5.0, 4.0)) - scattered


@kernel
def growth_by_few(freedom: float) -> float:
    """How much larger a covariance is for a variance that was estimated with f degrees of freedom.

    Squared errors are distributed as ``5 F(5, f)``: their mean is larger by ``f / (f - 2)`` than
    with a known variance, and what holds 95 % of them by ``1 + 4 / f + 12 / f^2`` (to 3 %). No
    factor serves both; this one is half-way.
    """
    on_average, for_most = freedom / (freedom - 2.0), 1.0 + (4.0 + 12.0 / freedom) / freedom
    return 0.5 * (on_average + for_most)


@inlined_kernel
def _bound(information: np.ndarray) -> None:
    """Add that of one radian on the direction, none on the rotation: the sphere is bounded."""
    for i in (3, 4):
        information[i, i] += 1.0


@kernel
def covariance_around(
    seen: Seen,
    right: float,
    predicted: bool,
    covariance: np.ndarray,
    out: np.ndarray,
) -> None:
    """Mean ``out`` (5, 5) of the covariance over the poses that it allows itself.

    To second order: larger than the ``covariance`` here by what that is, on average, a sigma to
    either side along each axis, more than here; each side counts as far as the poses there are
    likely. Along no axis it shrinks, or grows by more than `MOST_GROWTH` times. Where it grows
    much, it is averaged again over what it then allows.
    """
    allowed = np.empty((5, 5))
    copy(covariance, out)
    for _ in range(ROUNDS):
        copy(out, allowed)
        _average(seen, right, predicted, covariance, allowed, out)
        if not MUCH * (allowed[3, 3] + allowed[4, 4]) < out[3, 3] + out[4, 4] < WIDE:
            break


@step_kernel
def _average(
    seen: Seen,
    right: float,
    predicted: bool,
    covariance: np.ndarray,
    allowed: np.ndarray,
    out: np.ndarray,
) -> None:
    """The ``covariance`` (5, 5) here, grown to the mean over the poses that ``allowed`` allows."""
    steps, variances = np.empty((5, 5)), np.empty(5)
    growth, half = np.empty((5, 5)), np.empty((5, 5))
    _half_axes(allowed, steps, variances)
    _grow(seen, right, predicted, covariance, steps, growth)
    _half_axes(covariance, steps, variances)
    _product(steps, growth, half)
    _product(half, steps, growth)
    # In axes in which the covariance is the identity, growth is what it is times as large.
    for k in range(5):
        for j in range(5):
            growth[k, j] /= variances[k] * variances[j]
    eigen_five(growth, half)
    clear(out)
    for k in range(5):
        more = 1.0 + min(max(growth[k, k], 0.0), MOST_GROWTH)
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
def _grow(
    seen: Seen,
    right: float,
    predicted: bool,
    covariance: np.ndarray,
    steps: np.ndarray,
    out: np.ndarray,
) -> None:
    """How much larger (5, 5) a ``covariance`` is on average, by such ``steps`` (rows) around here.

    Of the two poses a step ahead and back, each counts as its likelihood, averaged over the poses
    nearby. The covariance is `MOST_GROWTH` times as large again where hardly anything is signal.
    """
    back = np.empty(5)
    clear(out)
    clear(back)
    _add_beside(seen, right, predicted, covariance, back, -5.0, out)
    for k in range(5):
        ahead = steps[k]
        for i in range(5):
            back[i] = -ahead[i]
        against = _log_likelihood_beside(seen, back) - _log_likelihood_beside(seen, ahead)
        share = 1.0 / (1.0 + math.exp(min(against, 50.0)))
        _add_beside(seen, right, predicted, covariance, ahead, share, out)
        _add_beside(seen, right, predicted, covariance, back, 1.0 - share, out)


@inner_kernel
def _add_beside(
    seen: Seen,
    right: float,
    predicted: bool,
    covariance: np.ndarray,
    step: np.ndarray,
    weight: float,
    out: np.ndarray,
) -> None:
    """Add the covariance a ``step`` beside this pose, times a weight."""
    there = np.empty((5, 5))
    shows = covariance_beside(seen, right, predicted, step, there)
    for i in range(5):
        for j in range(5):
            value = there[i, j] if shows else (1.0 + MOST_GROWTH) * covariance[i, j]
            out[i, j] += weight * value


@inner_kernel
def _log_likelihood_beside(seen: Seen, step: np.ndarray) -> float:
    """Of all matches, averaged over the poses around that a ``step`` (5,) beside this one."""
    moved_R, moved_t, normal, shares = np.empty((3, 3)), np.empty(3), np.empty((6, 6)), np.empty(4)
    copy(seen.R, moved_R)
    copy(seen.t, moved_t)
    apply_step(moved_R, moved_t, step)
    moved = Seen(seen.pairs, seen.prior, moved_R, moved_t, seen.mixture, seen.spread, seen.tail)
    cost = linearize(moved, False, normal, shares)
    return max(-cost - narrowness(normal), -1e300)


@inner_kernel
def covariance_beside(
    seen: Seen, right: float, predicted: bool, step: np.ndarray, out: np.ndarray
) -> bool:
    """Covariance ``out`` (5, 5) if the right pose is ``step`` (5,) beside this one.

    As `covariance_here`, in the axes of this pose; the residuals there are not those of a fit, and
    are not heard.
    """
    moved_R, moved_t, there = np.empty((3, 3)), np.empty(3), np.empty((5, 5))
    normal, noise, scatter = np.empty((6, 6)), np.empty((5, 5)), np.empty((5, 5))
    whole = np.empty((5, 5))
    copy(seen.R, moved_R)
    copy(seen.t, moved_t)
    apply_step(moved_R, moved_t, step)
    moved = Seen(seen.pairs, seen.prior, moved_R, moved_t, seen.mixture, seen.spread, seen.tail)
    share, alike = information(moved, predicted, normal, noise, scatter)
    known = _sure(right, alike) * share
    for i in range(5):
        for j in range(5):
            whole[i, j] = known * normal[i, j]
            noise[i, j] *= 0.0 if predicted else known
    _bound(whole)
    if not sandwich(whole, noise, whole, SIGNAL, there):
        return False
    _turn_axes(seen.t, moved_t, there, out)
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
