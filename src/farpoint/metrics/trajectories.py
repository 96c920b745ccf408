"""Errors of whole trajectories: absolute, relative, and over KITTI's segments.

Poses are ``world_from_cam``, shape (N, 4, 4). Row k of the estimate and row k of the truth are
poses of the same frame. `absolute_errors` compares positions in the world, so the trajectories must
be aligned. The other functions compare motions, so a monocular estimate needs the true scale, but
no alignment.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.errors import InputError
from farpoint.geometry import so3

__all__ = [
    "KITTI_LENGTHS_M",
    "RelativeErrors",
    "SegmentErrors",
    "absolute_errors",
    "kitti_segment_errors",
    "path_length",
    "relative_errors",
    "scale_drift",
]

KITTI_LENGTHS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
"""Segment lengths of the KITTI odometry benchmark."""

KITTI_STEP_FRAMES = 10
"""Frames between the starts of KITTI's segments: one start per second at 10 frames a second."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RelativeErrors:
    """Errors of motions over a fixed number of frames (relative pose error, RPE).

    Attributes
    ----------
    delta_frames : int
        Frames between the two poses of each motion.
    translation : ndarray, shape (M,)
        Lengths of the errors of translation, in the unit of the truth.
    rotation_rad : ndarray, shape (M,)
        Angles of the errors of rotation, rad.
    """

    delta_frames: int
    translation: np.ndarray
    rotation_rad: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class SegmentErrors:
    """Errors over segments of the true path, each divided by the segment's length.

    Attributes
    ----------
    first_frame : ndarray of int, shape (M,)
        Index of the pose that each segment starts from.
    length : ndarray, shape (M,)
        Length of each segment, in the unit of the truth (KITTI: m).
    translation_ratio : ndarray, shape (M,)
        Error of translation per length, dimensionless (KITTI prints per cent).
    rotation_rad_per_length : ndarray, shape (M,)
        Error of rotation per length, rad per unit of the truth.
    """

    first_frame: np.ndarray
    length: np.ndarray
    translation_ratio: np.ndarray
    rotation_rad_per_length: np.ndarray


def absolute_errors(estimate: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Distances (N,) between positions of aligned trajectories. The RMSE of distances is the ATE.

    The error is defined by Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems",
    IROS 2012, doi:10.1109/IROS.2012.6385773. Align the trajectories first, by `align_sim3` or
    `align_se3`.
    """
    _check(estimate, truth)
    return np.linalg.norm(estimate[:, :3, 3] - truth[:, :3, 3], axis=1)


def relative_errors(
    estimate: np.ndarray, truth: np.ndarray, *, delta_frames: int = 1, stride: int = 1
) -> RelativeErrors:
    """Errors of the motions from pose i to pose ``i + delta_frames``, for i in steps of ``stride``.

    The error is ``E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j)`` for truth Q and estimate P (Sturm et al. 2012,
    eq. 1). By default a motion starts at every pose. With ``stride=delta_frames``, the motions do
    not overlap.
    """
    _check(estimate, truth)
    for name, value in (("delta_frames", delta_frames), ("stride", stride)):
        if value < 1:
            raise InputError(f"expected at least 1, got {value}", field=name)
    start = np.arange(0, len(truth) - delta_frames, stride)
    error = _error_between(estimate, truth, start, start + delta_frames)
    return RelativeErrors(
        delta_frames=delta_frames,
        translation=np.linalg.norm(error[:, :3, 3], axis=1),
        rotation_rad=_angles(error),
    )


def kitti_segment_errors(
    estimate: np.ndarray,
    truth: np.ndarray,
    *,
    lengths: tuple[float, ...] = KITTI_LENGTHS_M,
    step_frames: int = KITTI_STEP_FRAMES,
) -> SegmentErrors:
    """Errors over all segments of the given lengths, as KITTI's development kit counts them.

    A segment of length L starts at every ``step_frames``-th pose and ends at the first pose more
    than L further along the true path. Segments that would end beyond the path are left out. The
    benchmark is described by Geiger, Lenz and Urtasun, CVPR 2012, doi:10.1109/CVPR.2012.6248074.
    """
    _check(estimate, truth)
    travelled = _travelled(truth)
    first, last, length = [], [], []
    for start in range(0, len(truth), step_frames):
        for wanted in lengths:
            end = int(np.searchsorted(travelled, travelled[start] + wanted, side="right"))
            if end < len(truth):
                first.append(start)
                last.append(end)
                length.append(wanted)
    error = _error_between(
        estimate, truth, np.array(first, dtype=np.intp), np.array(last, dtype=np.intp)
    )
    along = np.array(length)
    return SegmentErrors(
        first_frame=np.array(first, dtype=np.intp),
        length=along,
        translation_ratio=np.linalg.norm(error[:, :3, 3], axis=1) / along,
        rotation_rad_per_length=_angles(error) / along,
    )


def path_length(world_from_cam: np.ndarray) -> float:
    """Length of the polygon through the positions, in the unit of the positions."""
    return float(_travelled(world_from_cam)[-1])


def scale_drift(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Relative change of the estimate's scale from the first to the last 20 % of the true path.

    A scale that grew by 5 % gives 0.05. The result is NaN if one of the two parts has no length.
    """
    _check(estimate, truth)
    along, made = _travelled(truth), _travelled(estimate)
    # Lengths of the estimate over the first and the last 20 % of the true path, with interpolation
    # between poses.
    rises = np.concatenate([[True], np.diff(along) > 0.0])
    begin, end = (
        float(np.diff(np.interp(np.array(part) * along[-1], along[rises], made[rises]))[0])
        for part in ((0.0, 0.2), (0.8, 1.0))
    )
    return end / begin - 1.0 if begin > 0.0 and end > 0.0 else float("nan")


def _travelled(world_from_cam: np.ndarray) -> np.ndarray:
    steps = np.linalg.norm(np.diff(world_from_cam[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _error_between(
    estimate: np.ndarray, truth: np.ndarray, i: np.ndarray, j: np.ndarray
) -> np.ndarray:
    estimated = _inverse(estimate[i]) @ estimate[j]
    return _inverse(_inverse(truth[i]) @ truth[j]) @ estimated


def _inverse(poses: np.ndarray) -> np.ndarray:
    """Inverses of rigid transforms (N, 4, 4)."""
    inverse = np.zeros_like(poses)
    inverse[:, :3, :3] = np.swapaxes(poses[:, :3, :3], 1, 2)
    inverse[:, :3, 3] = -(inverse[:, :3, :3] @ poses[:, :3, 3, None])[..., 0]
    inverse[:, 3, 3] = 1.0
    return inverse


def _angles(poses: np.ndarray) -> np.ndarray:
    if not len(poses):
        return np.empty(0)
    return np.linalg.norm(so3.log(poses[:, :3, :3]), axis=1)


def _check(estimate: np.ndarray, truth: np.ndarray) -> None:
    for name, poses in (("estimate", estimate), ("truth", truth)):
        if poses.ndim != 3 or poses.shape[1:] != (4, 4) or not len(poses):
            raise InputError(f"expected shape (N, 4, 4), got {poses.shape}", field=name)
    if len(estimate) != len(truth):
        raise InputError(
            f"expected as many poses as the truth has, {len(truth)}, got {len(estimate)}",
            field="estimate",
        )
