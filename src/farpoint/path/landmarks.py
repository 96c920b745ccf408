"""Points of the scene, and the keyframes' observations of them: arrays, a row each."""

from __future__ import annotations

import numpy as np

from farpoint.path.lens import LensEstimate

__all__ = ["Landmarks", "packed"]

_OF_POINTS = ("ids", "anchor", "s", "s_variance", "has_depth", "is_placed")
_OF_OBSERVATIONS = (
    "point", "serial", "pixels", "last", "travelled", "rays", "ray_by_lens", "residuals", "by_s",
)  # fmt: skip


def packed(covariances: np.ndarray) -> np.ndarray:
    """Symmetric matrices (N, 2, 2) as rows (uu, uv, vv)."""
    return covariances.reshape(-1, 4)[:, [0, 1, 3]]


class Landmarks:
    """Points, each along the ray of the observation in which it was first seen.

    Attributes
    ----------
    ids : ndarray of int64, shape (M,)
        Tracks, ascending.
    anchor : ndarray of int64, shape (M,)
        Observation whose ray the point lies along.
    s, s_variance : ndarray, shape (M,)
        Inverse distance from there, and its variance where all else is known.
    has_depth, is_placed : ndarray of bool, shape (M,)
        Whether it has been seen twice; and whether its distance, or that it is far, is more than
        the noise of its pixels and of the keyframes' poses.
    point, serial : ndarray of int64, shape (N,)
        Of each observation its point's row and its keyframe; keyframes are in their order.
    pixels : ndarray, shape (N, 2)
        Where it was found.
    last, travelled : ndarray, shape (N, 3)
        Covariances (uu, uv, vv), px^2: of the match that ends there, and of all of its track.
    rays, ray_by_lens : ndarray, shapes (N, 3), (N, 3, r)
        Of the pixels, and their derivatives by the lens.
    residuals, by_s : ndarray, shape (N, 2)
        Expected less found pixel, px, and its derivative by the inverse distance, as last computed.
    """

    def __init__(self, lens: LensEstimate) -> None:
        self._lens = lens
        self.ids, self.anchor = np.empty(0, np.int64), np.empty(0, np.int64)
        self.s, self.s_variance = np.empty(0), np.empty(0)
        self.has_depth, self.is_placed = np.empty(0, bool), np.empty(0, bool)
        self.point, self.serial = np.empty(0, np.int64), np.empty(0, np.int64)
        self.pixels, self.residuals, self.by_s = (np.empty((0, 2)) for _ in range(3))
        self.last, self.travelled, self.rays = (np.empty((0, 3)) for _ in range(3))
        self.ray_by_lens = np.empty((0, 3, lens.size))

    def rows_of(self, ids: np.ndarray) -> np.ndarray:
        """Rows (N,) of the points of tracks, -1 where there is none."""
        if not len(self.ids):
            return np.full(len(ids), -1)
        at = np.searchsorted(self.ids, ids).clip(0, len(self.ids) - 1)
        return np.where(self.ids[at] == ids, at, -1)

    def seen_from(self, serial: int) -> np.ndarray:
        """Observations of a keyframe."""
        return np.flatnonzero(self.serial == serial)

    def latest(self) -> np.ndarray:
        """The last observation (M,) of each point."""
        found = np.zeros(len(self.ids), np.int64)
        found[self.point] = np.arange(len(self.point))
        return found

    def observe(
        self,
        serial: int,
        ids: np.ndarray,
        pixels: np.ndarray,
        last: np.ndarray,
        travelled: np.ndarray,
    ) -> None:
        """Add what the newest keyframe sees; a track without a point begins one there."""
        rays, by_lens = self._lens.rays_of(pixels)
        seen = np.isfinite(rays).all(axis=1) & np.isfinite(by_lens).all(axis=(1, 2))
        ids, rays, by_lens = ids[seen], rays[seen], by_lens[seen]
        rows = self._begin(ids)
        nothing = np.zeros((len(ids), 2))
        added = (
            rows, np.full(len(ids), serial), pixels[seen], last[seen], travelled[seen], rays,
            by_lens, nothing, nothing,
        )  # fmt: skip
        for name, values in zip(_OF_OBSERVATIONS, added, strict=True):
            setattr(self, name, np.concatenate([getattr(self, name), values]))

    def _begin(self, ids: np.ndarray) -> np.ndarray:
        """Rows of tracks that are observed next, new ones included."""
        rows = self.rows_of(ids)
        fresh = np.flatnonzero(rows < 0)
        if not len(fresh):
            return rows
        count = len(self.ids)
        values = (
            ids[fresh], len(self.point) + fresh, np.zeros(len(fresh)), np.full(len(fresh), np.inf),
            np.zeros(len(fresh), bool), np.zeros(len(fresh), bool),
        )  # fmt: skip
        all_ids = np.concatenate([self.ids, ids[fresh]])
        order = np.argsort(all_ids, kind="stable")
        for name, more in zip(_OF_POINTS, values, strict=True):
            setattr(self, name, np.concatenate([getattr(self, name), more])[order])
        row_of = np.empty(len(order), np.int64)
        row_of[order] = np.arange(len(order))
        self.point = row_of[self.point]
        rows[fresh] = count + np.arange(len(fresh))
        return row_of[rows]

    def keep(self, points: np.ndarray, observations: np.ndarray | None = None) -> None:
        """Keep points (M,) and, of their observations, those (N,) that masks mark."""
        kept = points[self.point]
        if observations is not None:
            kept &= observations
        row_of, place_of = np.cumsum(points) - 1, np.cumsum(kept) - 1
        self.anchor = place_of[self.anchor]
        self.point = row_of[self.point]
        for name in _OF_POINTS:
            setattr(self, name, getattr(self, name)[points])
        for name in _OF_OBSERVATIONS:
            setattr(self, name, getattr(self, name)[kept])

    def next_anchors(self, rows: np.ndarray, serial: int) -> np.ndarray:
        """For points (N,) the first observation by another keyframe than ``serial``; -1: none."""
        first = np.full(len(self.ids), -1)
        others = np.flatnonzero(self.serial != serial)[::-1]
        first[self.point[others]] = others  # the first one is written last
        return first[rows]

    def take_rays(self) -> None:
        """Take all rays anew, of the lens as it is; what it sees no more is dropped."""
        self.rays, self.ray_by_lens = self._lens.rays_of(self.pixels)
        by_lens = self.ray_by_lens.reshape(len(self.rays), -1)
        seen = np.asarray(np.isfinite(np.column_stack([self.rays, by_lens])).all(axis=1))
        if not seen.all():
            self.keep(seen[self.anchor], seen)
