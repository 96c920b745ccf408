"""Errors of lens and shutter with which a rotation alone explains the flow.

The errors ``z`` (r,) are those of `lens_errors`.
"""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.cholesky import factorised, solved
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel
from farpoint._kernels.constants import (
    LENS_CONVERGED_SIGMA,
    LENS_LINEAR_SIGMA,
    LINEAR_STEP_RAD,
    ROUNDING,
    STUDENT_FREEDOM,
)
from farpoint._kernels.lens_errors import RaysWithErrors, by_turn, flow_variance
from farpoint._kernels.linear import apply_rotation_step
from farpoint._kernels.normal_equations import add_row
from farpoint._kernels.row_rotation import column
from farpoint._kernels.vectors import Matrix, dot, matrix, rotate, vector

__all__ = ["explain_by_rotation"]


@kernel
def explain_by_rotation(
    R: np.ndarray,
    first: RaysWithErrors,
    second: RaysWithErrors,
    noise_px: float,
    farthest2: float,
    contradicts2: float,
    steps: int,
    z: np.ndarray,
) -> tuple[bool, int]:
    """Errors of lens and shutter with which a rotation explains most of the flow, by Gauss-Newton.

    The method maximises the likelihood of the rotation and of the errors times the prior of the
    errors. The likelihood has heavy tails, because near points also move by the translation.

    Parameters
    ----------
    R : ndarray, shape (3, 3)
        Initial rotation, cam1_from_cam0; receives the rotation of the last step.
    first, second : RaysWithErrors
        The rays of both images with the errors ``z``.
    noise_px : float
        Sigma of a pixel coordinate, px.
    farthest2 : float
        Largest sum of squares of the errors.
    contradicts2 : float
        Squared Mahalanobis distance of a flow beyond which a match contradicts the rotation.
    steps : int
        Largest number of steps.
    z : ndarray, shape (r,)
        Initial errors; receives the errors of the last step.

    Returns
    -------
    is_explained : bool
        False if more than half of the matches contradict a rotation.
    remaining : int
        0 at the end; the number of steps that remain if a step has left the range in which the rays
        are linear in rotation and errors.
    """
    size, matches = 3 + len(z), len(first.rays)
    flow0, by_x = np.empty((matches, 3)), np.empty((matches, 3, size))
    count = _flow_per_sigma(matrix(R), first, second, noise_px, flow0, by_x)
    flow = np.empty((count, 3))
    x, moved, step = np.zeros(size), np.zeros(size), np.zeros(size)
    for k in range(len(z)):
        x[3 + k] = z[k]
    H, g, L, unit = np.empty((size, size)), np.empty(size), np.empty((size, size)), np.empty(size)
    _flow_at(flow0, by_x, moved, flow)
    is_linear, is_final = True, False
    while steps > 0 and is_linear and not is_final:
        steps -= 1
        _sum_robust(flow, by_x, H, g)
        for k in range(3, size):
            H[k, k] += 1.0
            g[k] += x[k]
        clear(step)
        if factorised(H, ROUNDING, unit, L):
            solved(L, unit, g, step)
        for k in range(size):
            moved[k] -= step[k]
        _flow_at(flow0, by_x, moved, flow)
        if 2 * _count_beyond(flow, contradicts2) > count:
            return False, 0
        for k in range(size):
            x[k] -= step[k]
        if _shorten(farthest2, x, moved):
            _flow_at(flow0, by_x, moved, flow)
        is_final, is_linear = _largest(step, 3) < LENS_CONVERGED_SIGMA, _is_linear(moved)
    apply_rotation_step(R, x[0], x[1], x[2], R)
    for k in range(len(z)):
        z[k] = x[3 + k]
    return True, 0 if is_final else steps


@inner_kernel
def _flow_per_sigma(
    R: Matrix,
    first: RaysWithErrors,
    second: RaysWithErrors,
    noise_px: float,
    flow: np.ndarray,
    by_x: np.ndarray,
) -> int:
    """Derotated flow ``b - R a`` (N, 3) and its derivatives (N, 3, 3 + r), divided by the sigma.

    ``x`` is ``[dtheta, z]``. To first order in the length of the flow, the flow is perpendicular to
    ``b``. The result is the number of matches with finite rays, to which the first rows belong.
    Through a lens with errors, some pixels may have no ray.
    """
    count = 0
    for i in range(len(first.rays)):
        rotated = rotate(R, vector(first.rays[i]))
        scale = 1.0 / (noise_px * math.sqrt(flow_variance(first, second, i)))
        columns = by_turn(rotated)
        total = 0.0
        for k in range(3):
            flow[count, k] = scale * (second.rays[i, k] - rotated[k])
            for j in range(3):
                by_x[count, k, j] = -scale * columns[k][j]
            for j in range(first.by_error.shape[2]):
                by_first = dot(R[k], column(first.by_error, i, j))
                by_x[count, k, 3 + j] = scale * (second.by_error[i, k, j] - by_first)
                total += by_x[count, k, 3 + j]
            total += flow[count, k]
        if math.isfinite(total):
            count += 1
    return count


@inner_kernel
def _flow_at(flow0: np.ndarray, by_x: np.ndarray, x: np.ndarray, flow: np.ndarray) -> None:
    """``flow = flow0 + by_x x`` for the first rows."""
    for i in range(len(flow)):
        for k in range(3):
            total = flow0[i, k]
            for j in range(len(x)):
                total += by_x[i, k, j] * x[j]
            flow[i, k] = total


@inner_kernel
def _sum_robust(flow: np.ndarray, by_x: np.ndarray, H: np.ndarray, g: np.ndarray) -> None:
    """Normal equations of the flow (N, 3), with Student's t weights."""
    clear(g)
    for j in range(len(g)):
        clear(H[j])
    for i in range(len(flow)):
        weight = (STUDENT_FREEDOM + 2.0) / (STUDENT_FREEDOM + _square(flow, i))
        for k in range(3):
            add_row(by_x[i, k], weight, flow[i, k], H, g)


@inner_kernel
def _count_beyond(flow: np.ndarray, square: float) -> int:
    count = 0
    for i in range(len(flow)):
        count += _square(flow, i) > square
    return count


@inlined_kernel
def _square(flow: np.ndarray, i: int) -> float:
    return flow[i, 0] * flow[i, 0] + flow[i, 1] * flow[i, 1] + flow[i, 2] * flow[i, 2]


@inner_kernel
def _shorten(farthest2: float, x: np.ndarray, moved: np.ndarray) -> bool:
    """Scale the errors in ``x`` down to the squared length ``farthest2``; whether they were longer.

    ``moved``, the distance of ``x`` from the point of linearisation, changes by the same amount.
    """
    length2 = 0.0
    for k in range(3, len(x)):
        length2 += x[k] * x[k]
    if length2 <= farthest2:
        return False
    excess = 1.0 - math.sqrt(farthest2 / length2)
    for k in range(3, len(x)):
        moved[k] -= excess * x[k]
        x[k] -= excess * x[k]
    return True


@inner_kernel
def _is_linear(moved: np.ndarray) -> bool:
    """Whether rays are linear in a change of rotation (3) and errors (r)."""
    return _largest(moved, 3) <= LENS_LINEAR_SIGMA and _largest(moved[:3], 0) <= LINEAR_STEP_RAD


@inner_kernel
def _largest(x: np.ndarray, first: int) -> float:
    largest = 0.0
    for k in range(first, len(x)):
        largest = max(largest, abs(x[k]))
    return largest
