"""Association of each estimate with the true pose at its time or frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from farpoint.errors import InputError
from farpoint.options import coerce_float

__all__ = ["AssociationOptions", "poses_at_frames", "poses_at_times"]


@dataclass(frozen=True, kw_only=True)
class AssociationOptions:
    """Limits of the interpolation of true poses.

    Attributes
    ----------
    tolerance_s : float
        Largest time difference, s, at which a true pose is used without interpolation. The
        tolerance is for rounded time stamps.
    max_gap_s : float
        Largest time between two true poses, s, for interpolation between these poses.
    """

    tolerance_s: float = 1e-3
    max_gap_s: float = 0.2

    def __post_init__(self) -> None:
        coerce_float(self, "seconds, 0 or more", lambda s: s >= 0, "tolerance_s", "max_gap_s")


def poses_at_times(
    truth_timestamps: np.ndarray,
    truth_poses: np.ndarray,
    timestamps: np.ndarray,
    options: AssociationOptions | None = None,
) -> np.ndarray:
    """True poses (M, 4, 4) at ``timestamps`` (M,), s; NaN at times without a true pose.

    Positions are interpolated linearly, orientations by spherical linear interpolation.

    Parameters
    ----------
    truth_timestamps : ndarray, shape (N,)
        Times of the true poses, s, never decreasing. Of poses at the same time the first is used.
    truth_poses : ndarray, shape (N, 4, 4)
        Rigid transforms.
    timestamps : ndarray, shape (M,)
        Times of the requested poses, s, in any order.
    options : AssociationOptions, optional
        Limits of the interpolation.

    Raises
    ------
    InputError
        If the true time stamps decrease, or no requested time has a true pose.
    """
    options = options or AssociationOptions()
    times, wanted = np.asarray(truth_timestamps, float), np.asarray(timestamps, float)
    if not np.all(np.diff(times) >= 0.0):
        row = int(np.flatnonzero(~(np.diff(times) >= 0.0))[0]) + 1
        raise InputError("expected time stamps in order", field=f"truth pose {row}")
    times, first = np.unique(times, return_index=True)
    poses = np.full((len(wanted), 4, 4), np.nan)
    snapped = _snapped(times, wanted, options.tolerance_s)
    known = _covered(times, snapped, options.max_gap_s)
    if not known.any():
        raise InputError(_no_overlap(times, wanted, options), field="timestamps")
    poses[known] = _interpolated(times, np.asarray(truth_poses, float)[first], snapped[known])
    return poses


def poses_at_frames(truth_poses: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """True poses (M, 4, 4) of frame numbers (M,), for truth with one pose per frame (KITTI).

    Poses are NaN for frames beyond the truth. If all frames are beyond the truth, the function
    raises an InputError.
    """
    frames = np.asarray(frames)
    known = (frames >= 0) & (frames < len(truth_poses))
    if not known.any():
        raise InputError(
            f"the truth has poses for {len(truth_poses)} frames, for none of those estimated",
            field="frames",
        )
    poses = np.full((len(frames), 4, 4), np.nan)
    poses[known] = truth_poses[frames[known]]
    return poses


def _snapped(times: np.ndarray, wanted: np.ndarray, tolerance_s: float) -> np.ndarray:
    """Each requested time, or the nearest true time if the two differ by at most the tolerance."""
    after = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(
        np.abs(times[before] - wanted) <= np.abs(times[after] - wanted), times[before], times[after]
    )
    return np.where(np.abs(nearest - wanted) <= tolerance_s, nearest, wanted)


def _covered(times: np.ndarray, wanted: np.ndarray, max_gap_s: float) -> np.ndarray:
    """Mask of the times at a true pose, or between two poses at most ``max_gap_s`` apart."""
    after = np.searchsorted(times, wanted)
    inside = (after > 0) & (after < len(times))
    later = np.clip(after, 0, len(times) - 1)
    exact = times[later] == wanted
    return exact | (inside & (times[later] - times[np.maximum(later - 1, 0)] <= max_gap_s))


def _interpolated(times: np.ndarray, poses: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    result = np.tile(np.eye(4), (len(wanted), 1, 1))
    if len(times) == 1:
        return result @ poses[0]
    result[:, :3, :3] = Slerp(times, Rotation.from_matrix(poses[:, :3, :3]))(wanted).as_matrix()
    for axis in range(3):
        result[:, axis, 3] = np.interp(wanted, times, poses[:, axis, 3])
    return result


def _no_overlap(times: np.ndarray, wanted: np.ndarray, options: AssociationOptions) -> str:
    if not len(times) or not len(wanted):
        return f"expected poses on both sides, got {len(wanted)} estimated and {len(times)} true"
    apart = wanted.min() > times[-1] or wanted.max() < times[0]
    why = "do not overlap" if apart else f"overlap only in gaps over {options.max_gap_s:g} s"
    return (
        f"times {why}: estimates {wanted.min():.6f} to {wanted.max():.6f} s, "
        f"truth {times[0]:.6f} to {times[-1]:.6f} s"
    )
