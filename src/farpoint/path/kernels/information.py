"""Information of the observations of a window on poses, lens, shutter and points.

The residuals and their derivatives are those of `projection.pixel_residuals`. The functions write
their results into arrays that the caller passes.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.compile import loop_kernel, step_kernel
from farpoint._kernels.constants import STUDENT_FREEDOM
from farpoint.path.constants import UNSEEN_COST, UNSEEN_PX

__all__ = ["gather_information", "point_steps", "robust_cost"]


@step_kernel
def _whitened(noise, last, travelled, before, u, v):
    """Inverse covariance (uu, uv, vv) of the change (u, v) of a residual, and Mahalanobis square.

    ``travelled`` and ``before`` are the sums of the covariances along the track, up to the later
    and up to the earlier observation. The last result is the squared Mahalanobis norm of the
    change.
    """
    uu = noise[3] * (noise[0] * last[0] + noise[1] * abs(travelled[0] - before[0]) + noise[2])
    uv = noise[3] * (noise[0] * last[1] + noise[1] * (travelled[1] - before[1]))
    vv = noise[3] * (noise[0] * last[2] + noise[1] * abs(travelled[2] - before[2]) + noise[2])
    det = uu * vv - uv * uv
    inverse = 1.0 / det if det > 0.0 else 0.0
    uu, uv, vv = vv * inverse, -uv * inverse, uu * inverse
    return uu, uv, vv, uu * u * u + 2.0 * uv * u * v + vv * v * v


@step_kernel
def _write_change(
    frame, a, b, o, residuals, by_pose, by_common, by_s, common, J, where, e, E
):  # fmt: skip
    """Write the change of a residual from observation ``b`` to observation ``o``, and derivatives.

    The derivatives are by the poses of the keyframes that contain ``o``, the anchor ``a`` and,
    unless ``b`` is the anchor, ``b``, and by lens and read-out time, whose rows begin at
    ``common``. ``where`` receives the row of each of these unknowns in the normal equations. The
    function returns the number of these unknowns.
    """
    G, is_first = by_common.shape[2], b == a
    n = 12 if is_first else 18
    for i in range(6):
        where[i], where[6 + i], where[12 + i] = (
            6 * frame[o] + i,
            6 * frame[a] + i,
            6 * frame[b] + i,
        )
    for i in range(G):
        where[n + i] = common + i
    for q in range(2):
        e[q], E[q] = residuals[o, q], by_s[o, q]
        for i in range(6):
            J[q, i], J[q, 6 + i] = by_pose[o, q, i], -by_pose[o, q, i]
        for i in range(G):
            J[q, n + i] = by_common[o, q, i]
        if not is_first:
            e[q] -= residuals[b, q]
            E[q] -= by_s[b, q]
            for i in range(6):
                J[q, 6 + i] += by_pose[b, q, i]
                J[q, 12 + i] = -by_pose[b, q, i]
            for i in range(G):
                J[q, n + i] -= by_common[b, q, i]
    return n + G


@step_kernel
def _whiten(uu, uv, vv, n, J, e, E):
    """Multiply a residual and its derivatives by the root of an inverse covariance (uu, uv, vv).

    The two elements of the residual then have unit variance and are uncorrelated.
    """
    c00 = math.sqrt(uu)
    c01 = uv / c00
    c11 = math.sqrt(max(vv - c01 * c01, 0.0))
    for i in range(n):
        J[0, i], J[1, i] = c00 * J[0, i] + c01 * J[1, i], c11 * J[1, i]
    E[0], E[1] = c00 * E[0] + c01 * E[1], c11 * E[1]
    e[0], e[1] = c00 * e[0] + c01 * e[1], c11 * e[1]


@step_kernel
def _add_products(J, where, e, E, n, H, g, coupling):
    """Add ``J^T J`` to H, ``J^T e`` to g and ``J^T E`` to ``coupling``, at the rows ``where``.

    Each product of two different columns is added to H on one side of the diagonal only.
    """
    for i in range(n):
        a0, a1, row = J[0, i], J[1, i], where[i]
        g[row] += a0 * e[0] + a1 * e[1]
        coupling[row] += a0 * E[0] + a1 * E[1]
        for m in range(i + 1):
            H[row, where[m]] += a0 * J[0, m] + a1 * J[1, m]


@loop_kernel
def gather_information(
    frame, point, last, travelled, anchor, used, noise,
    residuals, by_pose, by_common, by_s,
    patch, before, H, g, coupling, point_h, point_g, patch_sums, point_sums,
):  # fmt: skip
    """Information and gradient of the poses, the lens and the shutter, and of the inverse depths.

    Errors of a track accumulate from match to match. Each term therefore uses the change of the
    track's residual since the last keyframe that observed the track. The unknowns other than the M
    inverse depths are called state: the poses (6 for each keyframe), the lens and the read-out
    time, in this order, D in total.

    Parameters
    ----------
    last, travelled : (N, 3)
        Covariance (uu, uv, vv), px^2, of the last match before the observation, and sum of the
        covariances since the track began.
    noise : (4,)
        Weight of the last covariance, weight of the summed covariances, floor (px^2), and factor on
        the variance.
    patch : (N,) of int
        Number of the image patch that contains the observation.
    before : (M,) of int
        Buffer.
    H, g, coupling, point_h, point_g : (D, D), (D,), (M, D), (M,), (M,)
        Results, initially zero: information and gradient of the state, coupling between inverse
        depths and state, and information and gradient of the inverse depths.
    patch_sums, point_sums : (P, 2), (M, 2)
        Results, initially zero: sums, over the observations in each patch and of each point, of
        residuals divided by their sigma and multiplied by their robust weights.

    Returns
    -------
    (float, float, int)
        Sum of the weighted squared residuals, sum of the squares of the numbers that were added to
        ``patch_sums``, and number of residuals (u, v).
    """
    D, G = len(g), by_common.shape[2]
    J, where = np.empty((2, 18 + G)), np.empty(18 + G, np.int64)
    e, E = np.empty(2), np.empty(2)
    before[:] = -1
    squares, influence, count = 0.0, 0.0, 0
    for o in range(len(frame)):
        j = point[o]
        a = anchor[j]
        if not used[j]:
            continue
        if o == a:
            before[j] = o
            continue
        b = before[j]
        if b < 0 or residuals[o, 0] == UNSEEN_PX:
            continue
        before[j] = o
        n = _write_change(
            frame, a, b, o, residuals, by_pose, by_common, by_s, D - G, J, where, e, E
        )
        uu, uv, vv, square = _whitened(noise, last[o], travelled[o], travelled[b], e[0], e[1])
        if not uu > 0.0:
            continue
        weight = (STUDENT_FREEDOM + 2.0) / (STUDENT_FREEDOM + square)
        squares += weight * square
        count += 1
        _whiten(weight * uu, weight * uv, weight * vv, n, J, e, E)
        root = math.sqrt(weight)
        for q in range(2):
            patch_sums[patch[o], q] += root * e[q]
            point_sums[j, q] += root * e[q]
            influence += weight * e[q] * e[q]
        _add_products(J, where, e, E, n, H, g, coupling[j])
        point_h[j] += E[0] * E[0] + E[1] * E[1]
        point_g[j] += E[0] * e[0] + E[1] * e[1]
    # Each product was added on one side of the diagonal only.
    for i in range(D):
        for m in range(i):
            H[i, m] = H[m, i] = H[i, m] + H[m, i]
    return squares, influence, count


@loop_kernel
def robust_cost(point, last, travelled, anchor, used, noise, residuals, before):
    """Negative log likelihood of the residual changes of `gather_information`, up to a constant."""
    before[:] = -1
    cost = 0.0
    for o in range(len(point)):
        j = point[o]
        if not used[j]:
            continue
        if o == anchor[j]:
            before[j] = o
            continue
        b = before[j]
        if b < 0:
            continue
        if residuals[o, 0] == UNSEEN_PX:
            cost += UNSEEN_COST
            continue
        before[j] = o
        du, dv = residuals[o, 0] - residuals[b, 0], residuals[o, 1] - residuals[b, 1]
        square = _whitened(noise, last[o], travelled[o], travelled[b], du, dv)[3]
        cost += 0.5 * (STUDENT_FREEDOM + 2.0) * math.log(1.0 + square / STUDENT_FREEDOM)
    return cost


@loop_kernel
def point_steps(coupling, point_h, point_g, step, damping, steps):
    """Changes (M,) of the inverse depths for a step (D,) of the other unknowns."""
    for j in range(len(steps)):
        total = point_g[j]
        for i in range(len(step)):
            total += coupling[j, i] * step[i]
        steps[j] = -total / (point_h[j] + damping)
