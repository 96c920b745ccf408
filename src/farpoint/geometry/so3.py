"""Rotations: exponential, logarithm, matrices and quaternions.

Perturbations are on the left, ``R_true = Exp(dtheta) @ R``. Quaternions are ``qx qy qz qw``.
"""

from __future__ import annotations

import math

import numpy as np
import scipy  # SciPy loads its submodules on first use

__all__ = [
    "angle_between",
    "exp",
    "log",
    "matrix_from_quat_xyzw",
    "quat_xyzw_from_matrix",
    "rotation_vector",
    "skew",
]


def skew(v: np.ndarray) -> np.ndarray:
    """Cross-product matrix of ``v`` (3,): ``skew(v) @ w == cross(v, w)``, shape (3, 3)."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def exp(rotation_vector: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad."""
    vectors = np.asarray(rotation_vector)
    if vectors.ndim == 1:
        return _rotation_of(*vectors.tolist())
    # Reshaped, because SciPy before 1.17 supports one leading axis only.
    R = scipy.spatial.transform.Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    return R.reshape(*vectors.shape, 3)


def log(R: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3), rad, of rotation matrices (..., 3, 3); the inverse of `exp`."""
    R = np.asarray(R)
    if R.ndim == 2:
        return np.array(rotation_vector(R))
    vectors = scipy.spatial.transform.Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return vectors.reshape(R.shape[:-1])


def rotation_vector(R: np.ndarray) -> tuple[float, float, float]:
    """Logarithm of one rotation (3, 3) in plain numbers, because arrays take 50 times as long."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R.tolist()
    # The rows of 4 q q^T, where q is the quaternion. The longest row belongs to the largest element
    # of q and has the least relative rounding error.
    w, x, y, z = max(
        (1.0 + xx + yy + zz, zy - yz, xz - zx, yx - xy),
        (zy - yz, 1.0 + xx - yy - zz, xy + yx, xz + zx),
        (xz - zx, xy + yx, 1.0 - xx + yy - zz, yz + zy),
        (yx - xy, xz + zx, yz + zy, 1.0 - xx - yy + zz),
        key=_length2,
    )
    half = math.hypot(x, y, z)
    scale = 2.0 * math.atan2(half, abs(w)) / math.copysign(half, w) if half > 0.0 else 0.0
    return scale * x, scale * y, scale * z


def angle_between(R0: np.ndarray, R1: np.ndarray) -> np.ndarray:
    """Angle of ``R1 @ R0.T``, rad, for rotation matrices (..., 3, 3)."""
    return np.linalg.norm(log(R1 @ np.swapaxes(R0, -1, -2)), axis=-1)


def quat_xyzw_from_matrix(R: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4), ``qx qy qz qw`` with ``qw >= 0``, of rotation matrices."""
    R = np.asarray(R)
    rotations = scipy.spatial.transform.Rotation.from_matrix(R.reshape(-1, 3, 3))
    return rotations.as_quat(canonical=True).reshape(*R.shape[:-2], 4)


def matrix_from_quat_xyzw(quat_xyzw: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) ``qx qy qz qw`` of any length."""
    quat_xyzw = np.asarray(quat_xyzw)
    R = scipy.spatial.transform.Rotation.from_quat(quat_xyzw.reshape(-1, 4)).as_matrix()
    return R.reshape(*quat_xyzw.shape[:-1], 3, 3)


def _rotation_of(x: float, y: float, z: float) -> np.ndarray:
    """`exp` of one rotation vector, computed from the unit quaternion of the rotation."""
    angle = math.hypot(x, y, z)
    # sin(angle / 2) / angle. For tiny angles, this is 1/2 up to rounding.
    scale = math.sin(0.5 * angle) / angle if angle > 1e-8 else 0.5
    w, x, y, z = math.cos(0.5 * angle), scale * x, scale * y, scale * z
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    wx, wy, wz = w * x, w * y, w * z
    return np.array(
        (
            (1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy)),
            (2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx)),
            (2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy)),
        )
    )


def _length2(row: tuple[float, float, float, float]) -> float:
    w, x, y, z = row
    return w * w + x * x + y * y + z * z
