"""Motion of a camera at any time: a spline through the poses of a path."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from farpoint.errors import InputError
from farpoint.trajectory.files import Trajectory

__all__ = ["SmoothMotion"]


class SmoothMotion:
    """Splines through the poses of a path, with continuous accelerations.

    A path of one pose gives a camera at rest.

    Parameters
    ----------
    path : Trajectory
        Poses ``world_from_cam`` with increasing times. The rotations between neighbouring poses are
        below 180 deg.

    Examples
    --------
    >>> from farpoint.synthetic import sideways
    >>> motion = SmoothMotion(sideways(5, fps=10.0, speed_m_s=2.0))
    >>> motion.poses(np.array([0.05, 0.1]))[:, 2, 3].round(6).tolist()
    [14.1, 14.2]
    """

    def __init__(self, path: Trajectory) -> None:
        times = path.timestamps
        if times is None or len(times) == 0:
            raise InputError("expected at least one pose with its time", field="path")
        if not (np.diff(times) > 0.0).all():
            raise InputError("expected rising times", field="path")
        self._only = path.world_from_body[0] if len(times) == 1 else None
        if self._only is None:
            # Relative to the first time: a float of seconds since 1970 is too coarse for the delay
            # of a row.
            self._start_s = times[0]
            since = times - times[0]
            self._position = CubicSpline(since, path.world_from_body[:, :3, 3])
            turns = Rotation.from_matrix(path.world_from_body[:, :3, :3])
            self._attitude = RotationSpline(since, turns)

    def poses(self, times_s: np.ndarray) -> np.ndarray:
        """``world_from_cam`` (N, 4, 4) at times (N,), s; times beyond the path are extrapolated."""
        poses = np.tile(np.eye(4), (len(times_s), 1, 1))
        if self._only is not None:
            poses[:] = self._only
        elif len(times_s):
            since = times_s - self._start_s
            poses[:, :3, :3] = self._attitude(since).as_matrix()
            poses[:, :3, 3] = self._position(since)
        return poses
