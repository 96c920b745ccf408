"""Points of the scene, and the keyframes' observations of them: arrays, a row each."""

from __future__ import annotations

import numpy as np

from farpoint.path.lens import LensEstimate

__all__ = ["Landmarks", "packed"]

_OF_POINTS = ("ids", "anchor", "rays", "ray_by_lens", "s", "s_variance", "has_depth", "is_placed")
_OF_OBSERVATIONS = ("point", "slot", "pixels", "last", "travelled", "residuals", "by_s")


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
    rays, ray_by_lens : ndarray, shapes (M, 3), (M, 3, r)
        That ray, and its derivatives by the lens.
    s, s_variance : ndarray, shape (M,)
        Inverse distance from there, and its variance where all else is known.
    has_depth, is_placed : ndarray of bool, shape (M,)
        Whether it has been seen twice; and whether its distance, or that it is far, is more than
        the noise of its pixels and of the keyframes' poses.
    point, slot : ndarray of int64, shape (N,)
        Of each observation its point's row and its keyframe's place; keyframes ascend.
    pixels : ndarray, shape (N, 2)
        Where it was found.
    last, travelled : ndarray, shape (N, 3)
        Covariances (uu, uv, vv), px^2: of the match that ends there, and of all of its track.
    residuals, by_s : ndarray, shape (N, 2)
        Expected less found pixel, px, and its derivative by the inverse distance, as last computed.
    """

    def __init__(self, lens: LensEstimate) -> None:
        self._lens = lens
        self.ids, self.anchor = np.empty(0, np.int64), np.empty(0, np.int64)
        self.s, self.s_variance = np.empty(0), np.empty(0)
        self.has_depth, self.is_placed = np.empty(0, bool), np.empty(0, bool)
        self.point, self.slot = np.empty(0, np.int64), np.empty(0, np.int64)
        self.pixels, self.residuals, self.by_s = (np.empty((0, 2)) for _ in range(3))
        self.last, self.travelled, self.rays = (np.empty((0, 3)) for _ in range(3))
        self.ray_by_lens = np.empty((0, 3, lens.size))

    def rows_of(self, ids: np.ndarray) -> np.ndarray:
        """Rows (N,) of the points of tracks, -1 where there is none."""
        if not len(self.ids):
            return np.full(len(ids), -1)
        at = np.searchsorted(self.ids, ids).clip(0, len(self.ids) - 1)
        return np.where(self.ids[at] == ids, at, -1)

    def seen_from(self, slot: int) -> np.ndarray:
        """Observations of a keyframe."""
        return np.flatnonzero(self.slot == slot)

    def latest(self) -> np.ndarray:
        """The last observation (M,) of each point."""
        found = np.zeros(len(self.ids), np.int64)
        found[self.point] = np.arange(len(self.point))
        return found

    def observe(
        self,
        slot: int,
        ids: np.ndarray,
        pixels: np.ndarray,
        last: np.ndarray,
        travelled: np.ndarray,
    ) -> None:
        """Add what the newest keyframe sees; a track without a point begins one there."""
        rows = self.rows_of(ids)
        fresh = np.flatnonzero(rows < 0)
        rays, by_lens, seen = self.seen_along(pixels[fresh])
        count = len(self.ids) + int(seen.sum())
        rows[fresh[seen]] = np.arange(len(self.ids), count)
        taken = rows >= 0
        place = len(self.point) + np.cumsum(taken) - 1
        begun, new = np.zeros(count - len(self.ids)), fresh[seen]
        of_points = (
            ids[new], place[new], rays[seen], by_lens[seen], begun, begun + np.inf,
            np.zeros(len(new), bool), np.zeros(len(new), bool),
        )  # fmt: skip
        self._extend(_OF_POINTS, of_points)
        rows, nothing = rows[taken], np.zeros((int(taken.sum()), 2))
        of_observations = (
            rows, np.full(len(rows), slot), pixels[taken], last[taken], travelled[taken], nothing,
            nothing,
        )  # fmt: skip
        self._extend(_OF_OBSERVATIONS, of_observations)
        if len(new):
            self._sort()

    def _extend(self, names: tuple[str, ...], values: tuple[np.ndarray, ...]) -> None:
        for name, more in zip(names, values, strict=True):
            setattr(self, name, np.concatenate([getattr(self, name), more]))

    def _sort(self) -> None:
        """Put points into the order of their tracks."""
        order = np.argsort(self.ids, kind="stable")
        for name in _OF_POINTS:
            setattr(self, name, getattr(self, name)[order])
        row_of = np.empty(len(order), np.int64)
        row_of[order] = np.arange(len(order))
        self.point = row_of[self.point]

    def seen_along(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rays of pixels (N, 2), their derivatives by the lens, and whether it sees them."""
        rays, by_lens = self._lens.rays_of(pixels)
        seen = np.isfinite(rays).all(axis=1) & np.isfinite(by_lens).all(axis=(1, 2))
        return rays, by_lens, np.asarray(seen)

    def keep(self, points: np.ndarray, observations: np.ndarray | None = None) -> None:
        """Keep points (M,) and, of their observations, those (N,) that masks mark."""
        kept = points[self.point]
        if observations is not None:
            kept &= observations
        row_of, place_of = np.cumsum(points) - 1, np.cumsum(kept) - 1
        self.anchor = place_of[self.anchor]
        self.point = row_of[self.point]
        for names, which in ((_OF_POINTS, points), (_OF_OBSERVATIONS, kept)):
            places = np.flatnonzero(which)
            for name in names:
                setattr(self, name, getattr(self, name)[places])

    def next_anchors(self, rows: np.ndarray, slot: int) -> np.ndarray:
        """For points (N,) the first observation by another keyframe than ``slot``; -1: none."""
        first = np.full(len(self.ids), -1)
        others = np.flatnonzero(self.slot != slot)[::-1]
        first[self.point[others]] = others  # the first one is written last
        return first[rows]

    def leave_out(self, points: np.ndarray, slot: int) -> None:
        """Drop points (M,) that a mask marks, and a keyframe's place with its observations."""
        self.keep(~points, self.slot != slot)
        self.slot -= self.slot > slot

    def take_rays(self) -> None:
        """Take all rays anew, of the lens as it is; points that it sees no more are dropped."""
        self.rays, self.ray_by_lens, seen = self.seen_along(self.pixels[self.anchor])
        if not seen.all():
            self.keep(seen)
