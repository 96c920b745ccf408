"""Tracks as they go on: where they are, and what their matches' errors add up to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from farpoint.path.landmarks import packed
from farpoint.tracks import Tracks

__all__ = ["Sighting", "TrackHistory"]


class Sighting(NamedTuple):
    """Tracks in a frame, a row each, ids ascending.

    Attributes
    ----------
    ids : ndarray of int64, shape (N,)
    pixels : ndarray, shape (N, 2)
        Where the points are by all of their matches.
    last, travelled : ndarray, shape (N, 3)
        Covariances (uu, uv, vv), px^2: of the match that led here, and of all since the beginning.
    """

    ids: np.ndarray
    pixels: np.ndarray
    last: np.ndarray
    travelled: np.ndarray

    def select(self, which: np.ndarray) -> Sighting:
        """Those that a mask (N,) marks."""
        return Sighting(*(column[which] for column in self))

    def rows_of(self, ids: np.ndarray) -> np.ndarray:
        """Rows (M,) of tracks, -1 where there is none."""
        if not len(self.ids):
            return np.full(len(ids), -1)
        at = np.searchsorted(self.ids, ids).clip(0, len(self.ids) - 1)
        return np.where(self.ids[at] == ids, at, -1)


class TrackHistory:
    """Follows tracks from match to match.

    A match starts where the tracker's window lies, which need not be where the one before has put
    the point (`farpoint.path.perspective`): displacements are added up.

    Attributes
    ----------
    order : ndarray of int64, shape (N,)
        Rows of the last pair's tracks, by their ids.
    """

    def __init__(self) -> None:
        self.order = np.empty(0, np.int64)
        self._now = Sighting(
            np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 3)), np.empty((0, 3))
        )

    @property
    def now(self) -> Sighting:
        """The tracks in the last frame."""
        return self._now

    def follow(self, tracks: Tracks) -> tuple[Sighting, Sighting]:
        """Where the tracks of a pair are in its first and in its second frame."""
        order = self.order = np.argsort(tracks.ids)
        ids, points0 = tracks.ids[order], tracks.points0[order]
        covariance = packed(tracks.covariance_px2[order])
        rows = self._now.rows_of(ids)
        goes_on = rows >= 0
        pixels, last, travelled = points0.copy(), np.zeros((len(ids), 3)), np.zeros((len(ids), 3))
        pixels[goes_on] = self._now.pixels[rows[goes_on]]
        last[goes_on] = self._now.last[rows[goes_on]]
        travelled[goes_on] = self._now.travelled[rows[goes_on]]
        before = Sighting(ids, pixels, last, travelled)
        self._now = Sighting(
            ids, pixels + (tracks.points1[order] - points0), covariance, travelled + covariance
        )
        return before, self._now
