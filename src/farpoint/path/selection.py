"""What the window takes: which tracks of a frame, and which keyframes stay."""

from __future__ import annotations

import numpy as np

from farpoint.path.history import Sighting
from farpoint.path.landmarks import Landmarks
from farpoint.path.window import Window

__all__ = ["least_useful", "some_of"]

_GOLDEN = 0.6180339887498949  # reciprocal of the golden ratio: its multiples spread evenly
_LEAST_SHARE = 0.05  # of a keyframe's points still in view; with fewer it goes first
_NEWEST = 2  # keyframes that stay in any case: later frames are measured from them
# Distance, in units of the median distance of points, below which keyframes are at one place.
_SAME_PLACE = 0.02


def some_of(seen: Sighting, landmarks: Landmarks, most: int) -> Sighting:
    """Tracks that have a point, and as many others, spread over the image, as there is room for."""
    known = landmarks.rows_of(seen.ids) >= 0
    room = max(most - int(known.sum()), 0)
    fresh = np.flatnonzero(~known)
    if len(fresh) > room:
        order = np.argsort((seen.ids[fresh] * _GOLDEN) % 1.0, kind="stable")
        known[fresh[order[:room]]] = True
        return seen.select(known)
    return seen


def least_useful(window: Window, alive: np.ndarray) -> int:
    """Slot of the keyframe to take out: of which nothing is in view, or that stands in a crowd.

    The score is that of Engel, Koltun and Cremers, "Direct Sparse Odometry", 2018, section 3.1: the
    root of the distance to the newest times the sum of the inverse distances to the others. So the
    window keeps a baseline when the camera turns on the spot.

    Parameters
    ----------
    window : Window
        With more than two keyframes.
    alive : ndarray of int64, shape (N,)
        Tracks that are in view.
    """
    marks, count = window.landmarks, len(window.frames) - _NEWEST
    in_view = np.isin(marks.ids, alive)[marks.point]
    for slot in range(count):
        mine = marks.slot == slot
        if not mine.any() or in_view[mine].mean() < _LEAST_SHARE:
            return slot
    p = np.array([frame.p for frame in window.frames])
    known = marks.s[marks.has_depth]
    nearness = float(np.median(known)) if len(known) else 1.0
    distances = nearness * np.linalg.norm(p[:, None] - p, axis=2) + _SAME_PLACE
    crowd = np.sum(1.0 / distances[:count, :count], axis=1)
    return int(np.argmax(np.sqrt(distances[:count, -1]) * crowd))
