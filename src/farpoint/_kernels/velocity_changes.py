"""Normal equations of a motion and of the changes of the velocity between two views."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import inlined_kernel, kernel
from farpoint._kernels.constants import POSE_PARAMETERS, VELOCITY_CHANGES
from farpoint._kernels.epipolar import sampson_jacobian
from farpoint._kernels.normal_equations import add_row
from farpoint._kernels.pairs import address
from farpoint._kernels.pose import LinearisationPoint
from farpoint._kernels.vectors import (
    Matrix,
    Vector,
    axpby,
    cross,
    matrix,
    rotate_back,
    tangent_columns,
    vector,
)

__all__ = ["sum_by_changes"]


@kernel
def sum_by_changes(
    point: LinearisationPoint,
    inlier: np.ndarray,
    phase0: np.ndarray,
    phase1: np.ndarray,
    share: float,
    H: np.ndarray,
    g: np.ndarray,
) -> None:
    """Sum the products of the Sampson residuals and of their derivatives.

    The first five rows and columns belong to the motion ``[dtheta, dbeta]``, the others to the
    changes of the velocity.

    Parameters
    ----------
    point : LinearisationPoint
        The motion, and the matches after correction of the rows.
    inlier : ndarray, shape (N,)
        Inlier probabilities.
    phase0, phase1 : ndarray, shape (N,)
        Phases of the rows in both images, -1/2 to 1/2.
    share : float
        Read-out time divided by the time between the views.
    H, g : ndarray, shapes (11, 11) and (11,)
        Out: sums of ``w J^T J`` and ``w J^T r``, with w the inlier probability over the noise
        variance. Only the lower triangle of H is written.
    """
    R, t = matrix(point.R), vector(point.t)
    basis, precision = tangent_columns(t), 1.0 / point.mixture[0]
    row = np.empty(POSE_PARAMETERS + VELOCITY_CHANGES)
    clear(g)
    for j in range(len(row)):
        clear(H[j])
    for i in range(len(phase0)):
        at, early, late = address(i), 0.5 * share * phase0[i], 0.5 * share * phase1[i]
        x, y, z, u, v, residual = sampson_jacobian(point.pairs, at, R, t, basis)
        _by_motion_and_changes((x, y, z), (u, v), R, t, basis, early, late, row)
        add_row(row, precision * inlier[i], residual, H, g)


@inlined_kernel
def _by_motion_and_changes(
    by_theta: Vector,
    by_beta: tuple[float, float],
    R: Matrix,
    t: Vector,
    basis: tuple[Vector, Vector],
    early: float,
    late: float,
    row: np.ndarray,
) -> None:
    """Derivatives (11,) by motion and changes, from those by the motion.

    A further rotation of the ray in camera 1 has the same effect as the opposite rotation of ``R
    a`` and of ``t``. ``early`` and ``late`` are half of the times of the rows of a match after the
    middle rows, in the time between the views.
    """
    by_turn = cross(t, axpby(by_beta[0], basis[0], by_beta[1], basis[1]))
    by_ray0, by_ray1 = rotate_back(R, by_theta), axpby(-1.0, by_theta, -1.0, by_turn)
    row[0], row[1], row[2] = by_theta
    row[3], row[4] = by_beta
    row[5], row[6], row[7] = axpby(early, by_ray0, -late, by_ray1)
    row[8], row[9], row[10] = axpby(early, by_turn, late, by_turn)
