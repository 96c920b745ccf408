"""Selection of the window's tracks and keyframes."""

from __future__ import annotations

import numpy as np

from farpoint.geometry.vectors import median
from farpoint.path.constants import GOLDEN_SHARE, MIN_SHARE_IN_VIEW, NEWEST_KEYFRAMES, SAME_PLACE
from farpoint.path.history import TrackObservations
from farpoint.path.landmarks import Landmarks
from farpoint.path.window import Window

__all__ = ["redundant_keyframe", "select_tracks"]


def select_tracks(
    observed: TrackObservations, landmarks: Landmarks, most: int
) -> TrackObservations:
    """All tracks with a landmark, and an even sample of the other tracks, ``most`` in total."""
    known = landmarks.rows_of(observed.ids) >= 0
    free_slots = max(most - int(known.sum()), 0)
    fresh = np.flatnonzero(~known)
    if len(fresh) > free_slots:
        order = np.argsort((observed.ids[fresh] * GOLDEN_SHARE) % 1.0, kind="stable")
        known[fresh[order[:free_slots]]] = True
        return observed.select(known)
    return observed


def redundant_keyframe(window: Window, alive: np.ndarray) -> int:
    """Slot of the keyframe to marginalise.

    The result is the oldest keyframe of which less than 5 % of the points are in view. If there is
    no such keyframe, the result is the keyframe with the largest score ``sqrt(d) sum(1 / d_i)``,
    where d is the distance to the newest keyframe, and the d_i are the distances to the other
    removable keyframes (Engel, Koltun and Cremers, "Direct Sparse Odometry", 2018, section 3.1).
    With this score, distant keyframes stay in the window during a pure rotation. The newest two
    keyframes are never the result.

    Parameters
    ----------
    window : Window
        A window of more than two keyframes.
    alive : ndarray of int64, shape (N,)
        Ids of the tracks in view.
    """
    marks, count = window.landmarks, len(window.frames) - NEWEST_KEYFRAMES
    in_view = np.isin(marks.ids, alive)[marks.point]
    for slot in range(count):
        mine = marks.slot == slot
        if not mine.any() or in_view[mine].mean() < MIN_SHARE_IN_VIEW:
            return slot
    p = np.array([frame.p for frame in window.frames])
    known = marks.s[marks.has_depth]
    nearness = median(known) if len(known) else 1.0
    distances = nearness * np.linalg.norm(p[:, None] - p, axis=2) + SAME_PLACE
    density = np.sum(1.0 / distances[:count, :count], axis=1)
    return int(np.argmax(np.sqrt(distances[:count, -1]) * density))
