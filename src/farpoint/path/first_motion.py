"""Test of the first motion of a path by two views with larger flow."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from farpoint.geometry import so3
from farpoint.geometry.sphere import tangent_basis
from farpoint.path.constants import CHI2_P999_OF_5, DECISIVE_LOG_RATIO, FIRST_ITERATIONS
from farpoint.path.history import TrackObservations
from farpoint.path.information import inverse
from farpoint.path.selection import select_tracks
from farpoint.path.window import Window
from farpoint.pose import PoseStatus, RelativePose

__all__ = ["WindowView", "contradicting_motion"]


class WindowView(NamedTuple):
    """A frame with tracks, pose ``world_from_cam`` and velocity; see `Keyframe`."""

    frame: int
    timestamp: float
    R: np.ndarray
    p: np.ndarray
    twist: np.ndarray
    tracks: TrackObservations


def contradicting_motion(
    first: WindowView,
    now: WindowView,
    motion: RelativePose,
    new_window: Callable[[], Window],
    most: int,
) -> Window | None:
    """Window of two views, optimised from ``motion``, if ``motion`` contradicts the path.

    With short flow, two different motions may explain the matches, and the path may have started
    from the wrong motion. Two motions between the views are therefore optimised separately, each
    with lens and shutter: the motion of the path, and the two-view ``motion`` with the same length.
    The two-view motion contradicts the path if it differs significantly from the motion of the
    path, and if its log likelihood is not more than 2 below that of the motion of the path. The
    result is None without a contradiction.

    Parameters
    ----------
    first, now : WindowView
        The first keyframe, and a later frame with larger flow.
    motion : RelativePose
        Motion between the two frames, from a two-view estimate.
    new_window : callable
        Returns an empty window with the prior of lens and shutter.
    most : int
        Largest number of tracks of each view in the window.
    """
    length = float(np.linalg.norm(now.p - first.p))
    if length == 0.0 or motion.status is not PoseStatus.OK:
        return None
    assert motion.rotation_cam1_from_cam0 is not None
    other = now._replace(
        R=first.R @ motion.rotation_cam1_from_cam0.T,
        p=first.p + length * (first.R @ motion.heading_cam0),
    )
    current, alternative = (_optimised(first, view, new_window(), most) for view in (now, other))
    if alternative.cost > current.cost + DECISIVE_LOG_RATIO or _is_consistent(alternative, now):
        return None
    return alternative


def _optimised(first: WindowView, now: WindowView, window: Window, most: int) -> Window:
    for frame, timestamp, R, p, twist, tracks in (first, now):
        window.add(frame, timestamp, R, p, twist)
        window.observe(select_tracks(tracks, window.landmarks, most))
    window.set_unit()
    window.triangulate()
    window.solve(FIRST_ITERATIONS)
    return window


def _is_consistent(views: Window, now: WindowView) -> bool:
    """Whether the motion of a two-view window is consistent with the path (chi-square test).

    ``now`` has the pose of the path. The rotations and the directions of translation are compared,
    but not the lengths of the translations.
    """
    motion, covariance = views.relative_pose(0, 1)
    first, length = views.frames[0], float(np.linalg.norm(motion[:3, 3]))
    turn = so3.log(now.R.T @ first.R @ motion[:3, :3].T)
    away = now.R.T @ (first.p - now.p) - motion[:3, 3]
    across = np.zeros((5, 6))
    across[:3, :3], across[3:, 3:] = np.eye(3), tangent_basis(motion[:3, 3] / length).T
    off = across @ np.concatenate([turn, away])
    return bool(off @ inverse(across @ covariance @ across.T) @ off < CHI2_P999_OF_5)
