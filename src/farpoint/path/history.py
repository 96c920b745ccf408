"""Track positions and covariances, accumulated from match to match."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from farpoint.path.landmarks import packed
from farpoint.tracks import Tracks

__all__ = ["TrackHistory", "TrackObservations"]


class TrackObservations(NamedTuple):
    """Tracks observed in a frame, one row for each track, in ascending order of ids.

    Attributes
    ----------
    ids : ndarray of int64, shape (N,)
    pixels : ndarray, shape (N, 2)
        Positions: first position of the track plus the sum of the displacements of all matches.
    last, accumulated : ndarray, shape (N, 3)
        Covariance (uu, uv, vv), px^2, of the last match, and sum of the covariances of all matches.
    """

    ids: np.ndarray
    pixels: np.ndarray
    last: np.ndarray
    accumulated: np.ndarray

    def select(self, which: np.ndarray) -> TrackObservations:
        """Rows selected by a mask (N,)."""
        return TrackObservations(*(column[which] for column in self))

    def rows_of(self, ids: np.ndarray) -> np.ndarray:
        """Rows (M,) of the tracks with the given ids; -1 if there is no such track."""
        if not len(self.ids):
            return np.full(len(ids), -1)
        at = np.searchsorted(self.ids, ids).clip(0, len(self.ids) - 1)
        return np.where(self.ids[at] == ids, at, -1)


class TrackHistory:
    """Accumulates the displacements of tracks.

    The position of a track is its first position plus the sum of the displacements of its matches.
    A match therefore need not start where the previous match ended.

    Attributes
    ----------
    order : ndarray of int64, shape (N,)
        Indices that sort the matches of the last `update` by track id.
    """

    def __init__(self) -> None:
        self.order = np.empty(0, np.int64)
        self._now = TrackObservations(
            np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 3)), np.empty((0, 3))
        )

    @property
    def now(self) -> TrackObservations:
        """Tracks in the last frame."""
        return self._now

    def update(self, tracks: Tracks) -> tuple[TrackObservations, TrackObservations]:
        """Add the matches of a pair; return the tracks in the first and in the second frame."""
        order = self.order = np.argsort(tracks.ids)
        ids, points0 = tracks.ids[order], tracks.points0[order]
        covariance = packed(tracks.covariance_px2[order])
        rows = self._now.rows_of(ids)
        continues = rows >= 0
        pixels, last, accumulated = points0.copy(), np.zeros((len(ids), 3)), np.zeros((len(ids), 3))
        pixels[continues] = self._now.pixels[rows[continues]]
        last[continues] = self._now.last[rows[continues]]
        accumulated[continues] = self._now.accumulated[rows[continues]]
        before = TrackObservations(ids, pixels, last, accumulated)
        self._now = TrackObservations(
            ids, pixels + (tracks.points1[order] - points0), covariance, accumulated + covariance
        )
        return before, self._now
