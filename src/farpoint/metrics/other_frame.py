"""Test whether true rotations are given in axes other than the axes of the camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from farpoint.geometry import so3

__all__ = ["OtherFrame", "fits_better", "other_frame"]

_LEAST_MOTIONS = 10
_LEAST_TURN_RAD = np.deg2rad(5.0)
"""Smallest rotation between the axes of the camera and of the truth that is reported. A smaller
rotation counts as a calibration error (convention)."""

_GAIN = 0.1
"""Largest ratio of the squared misfit with the rotation to the squared misfit without the rotation.
Without other axes, the ratio is nearly 1."""


class OtherFrame(NamedTuple):
    """Rotation ``true_from_camera`` (3, 3) from the axes of the camera to the axes of the truth.

    ``without_rad`` and ``with_rad`` are the misfits, rad rms, without and with this rotation.
    """

    true_from_camera: np.ndarray
    without_rad: float
    with_rad: float


def other_frame(estimated: np.ndarray, true: np.ndarray) -> OtherFrame | None:
    """Rotation of the axes after which estimated and true relative rotations (N, 3, 3) agree.

    The result is None if the rotation is below `_LEAST_TURN_RAD`, or reduces the squared misfit to
    more than `_GAIN` times its value.

    If two frames are fixed to each other, the rotation vectors of a motion in one frame and in the
    other frame differ by the constant rotation between the frames (the rotation part of hand-eye
    calibration). The SVD of the products of these vectors gives this rotation (Kabsch, Acta
    Crystallographica A32, 1976).
    """
    known = np.isfinite(estimated).all(axis=(1, 2)) & np.isfinite(true).all(axis=(1, 2))
    if np.count_nonzero(known) < _LEAST_MOTIONS:
        return None
    a, b = so3.log(estimated[known]), so3.log(true[known])
    U, _, Vt = np.linalg.svd(b.T @ a)
    C = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    before, after = _rms(b - a), _rms(b - a @ C.T)
    turn = float(np.linalg.norm(so3.log(C)))
    if turn < _LEAST_TURN_RAD or after**2 > _GAIN * before**2:
        return None
    return OtherFrame(C, before, after)


def fits_better(estimated: np.ndarray, true: np.ndarray, other: np.ndarray) -> bool:
    """Whether ``other`` reduces the squared misfit of estimated rotations below `_GAIN` times.

    The misfit is compared with the misfit to ``true``; all rotations are (N, 3, 3).
    """
    known = np.isfinite(estimated).all(axis=(1, 2))
    known &= np.isfinite(true).all(axis=(1, 2)) & np.isfinite(other).all(axis=(1, 2))
    if np.count_nonzero(known) < _LEAST_MOTIONS:
        return False
    a = so3.log(estimated[known])
    before, after = _rms(so3.log(true[known]) - a), _rms(so3.log(other[known]) - a)
    return after**2 < _GAIN * before**2


def _rms(vectors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))
