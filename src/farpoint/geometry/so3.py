"""Rotations: exponential, logarithm, and the two layouts users meet.

Perturbations are on the left, ``R_true = Exp(dtheta) @ R``. Quaternions are ``qx qy qz qw``.
"""

from __future__ import annotations

import numpy as np
import scipy  # its parts load on first use

__all__ = ["angle_between", "exp", "log", "matrix_from_quat_xyzw", "quat_xyzw_from_matrix", "skew"]


def skew(v: np.ndarray) -> np.ndarray:
    """Cross-product matrix of ``v`` (3,): ``skew(v) @ w == cross(v, w)``, shape (3, 3)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp(rotation_vector: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad."""
    vectors = np.asarray(rotation_vector)
    # As one list: SciPy before 1.17 knows no arrays of more axes.
    R = scipy.spatial.transform.Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    return R.reshape(*vectors.shape, 3)


def log(R: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3), rad, of rotation matrices (..., 3, 3); the inverse of `exp`."""
    R = np.asarray(R)
    vectors = scipy.spatial.transform.Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return vectors.reshape(R.shape[:-1])


def angle_between(R0: np.ndarray, R1: np.ndarray) -> np.ndarray:
    """Angle of ``R1 @ R0.T``, rad, for rotation matrices (..., 3, 3)."""
    return np.linalg.norm(log(R1 @ np.swapaxes(R0, -1, -2)), axis=-1)


def quat_xyzw_from_matrix(R: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4), ``qx qy qz qw`` with ``qw >= 0``, of rotation matrices."""
    R = np.asarray(R)
    rotations = scipy.spatial.transform.Rotation.from_matrix(R.reshape(-1, 3, 3))
    return rotations.as_quat(canonical=True).reshape(*R.shape[:-2], 4)


def matrix_from_quat_xyzw(quat_xyzw: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) ``qx qy qz qw``, normalised here."""
    quat_xyzw = np.asarray(quat_xyzw)
    R = scipy.spatial.transform.Rotation.from_quat(quat_xyzw.reshape(-1, 4)).as_matrix()
    return R.reshape(*quat_xyzw.shape[:-1], 3, 3)
