"""Landmarks and their observations by keyframes, as arrays."""

from __future__ import annotations

import numpy as np

from farpoint.path.lens import LensEstimate

__all__ = ["Landmarks", "packed"]

_OF_POINTS = (
    *("ids", "anchor", "rays", "ray_by_lens"),
    *("s", "s_variance", "s_by_state", "has_depth", "is_reliable"),
)
_OF_OBSERVATIONS = (
    *("point", "slot", "pixels", "last", "accumulated"),
    *("residuals", "by_s", "by_pose", "by_common"),
)


def packed(covariances: np.ndarray) -> np.ndarray:
    """Symmetric matrices (N, 2, 2) as rows (uu, uv, vv)."""
    return covariances.reshape(-1, 4)[:, [0, 1, 3]]


class Landmarks:
    """Landmarks, each given by an anchor and an inverse distance.

    The anchor is an observation of the landmark, at first the first observation. The inverse
    distance is measured along the ray of the anchor. There are M landmarks and N observations.

    Attributes
    ----------
    ids : ndarray of int64, shape (M,)
        Track id of each landmark, ascending.
    anchor : ndarray of int64, shape (M,)
        Index of the observation that is the anchor.
    rays, ray_by_lens : ndarray, shapes (M, 3), (M, 3, r)
        Ray of the anchor, and derivatives of the ray by the lens.
    s, s_variance : ndarray, shape (M,)
        Inverse distance from the anchor, and variance of the inverse distance given all other
        unknowns.
    s_by_state : ndarray, shape (M, D)
        Derivatives of the estimated inverse distance by the unknowns of the last solution: 6 for
        each pose, lens and read-out time. Zero for points that were not part of the last solution.
    has_depth, is_reliable : ndarray of bool, shape (M,)
        Whether the inverse distance has been initialised (`Window.triangulate`), and whether the
        inverse distance is accurate enough for resection (`Window._mark_reliable`).
    point, slot : ndarray of int64, shape (N,)
        For each observation, row of the point, and slot of the observing keyframe (index in
        `Window.frames`), ascending.
    pixels : ndarray, shape (N, 2)
        Observed pixels.
    last, accumulated : ndarray, shape (N, 3)
        Covariance (uu, uv, vv), px^2, of the last match before the observation, and sum of the
        covariances of all matches of the track up to the observation.
    residuals, by_s : ndarray, shape (N, 2)
        Residual (expected minus observed pixel), px, and derivative of the residual by the inverse
        distance, at the last solution.
    by_pose, by_common : ndarray, shapes (N, 2, 6), (N, 2, r + 1)
        Derivatives of the residuals by the pose of the observing keyframe, and by lens and read-out
        time.
    """

    def __init__(self, lens: LensEstimate) -> None:
        self._lens = lens
        self.ids, self.anchor = np.empty(0, np.int64), np.empty(0, np.int64)
        self.s, self.s_variance = np.empty(0), np.empty(0)
        self.has_depth, self.is_reliable = np.empty(0, bool), np.empty(0, bool)
        self.point, self.slot = np.empty(0, np.int64), np.empty(0, np.int64)
        self.pixels, self.residuals, self.by_s = (np.empty((0, 2)) for _ in range(3))
        self.last, self.accumulated, self.rays = (np.empty((0, 3)) for _ in range(3))
        self.ray_by_lens, self.s_by_state = np.empty((0, 3, lens.size)), np.empty((0, 0))
        self.by_pose, self.by_common = np.empty((0, 2, 6)), np.empty((0, 2, lens.size + 1))

    def rows_of(self, ids: np.ndarray) -> np.ndarray:
        """Rows (N,) of the points of tracks with the given ids; -1 if a track has no point."""
        if not len(self.ids):
            return np.full(len(ids), -1)
        at = np.searchsorted(self.ids, ids).clip(0, len(self.ids) - 1)
        return np.where(self.ids[at] == ids, at, -1)

    def observations_of(self, slot: int) -> np.ndarray:
        """Indices of the observations of a keyframe."""
        return np.flatnonzero(self.slot == slot)

    def tracks_of(self, slot: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Ids (ascending), pixels and covariances of a keyframe's observations; see `observe`."""
        rows = self.observations_of(slot)
        rows = rows[np.argsort(self.point[rows])]
        return (
            self.ids[self.point[rows]],
            self.pixels[rows],
            self.last[rows],
            self.accumulated[rows],
        )

    def latest(self) -> np.ndarray:
        """Index of the last observation of each point, shape (M,)."""
        found = np.zeros(len(self.ids), np.int64)
        found[self.point] = np.arange(len(self.point))
        return found

    def observe(
        self,
        slot: int,
        ids: np.ndarray,
        pixels: np.ndarray,
        last: np.ndarray,
        accumulated: np.ndarray,
    ) -> None:
        """Add the observations of the newest keyframe. A track without a landmark starts one."""
        rows = self.rows_of(ids)
        fresh = np.flatnonzero(rows < 0)
        rays, by_lens, seen = self.rays_at(pixels[fresh])
        count = len(self.ids) + int(seen.sum())
        rows[fresh[seen]] = np.arange(len(self.ids), count)
        observed = rows >= 0
        rows_new = len(self.point) + np.cumsum(observed) - 1
        zeros, new = np.zeros(count - len(self.ids)), fresh[seen]
        of_points = (
            ids[new], rows_new[new], rays[seen], by_lens[seen], zeros, zeros + np.inf,
            np.zeros((len(new), self.s_by_state.shape[1])),
            np.zeros(len(new), bool), np.zeros(len(new), bool),
        )  # fmt: skip
        self._extend(_OF_POINTS, of_points)
        rows, nothing = rows[observed], np.zeros((int(observed.sum()), 2))
        of_observations = (
            rows, np.full(len(rows), slot), pixels[observed], last[observed], accumulated[observed],
            nothing, nothing, np.zeros((len(rows), 2, 6)),
            np.zeros((len(rows), 2, self.by_common.shape[2])),
        )  # fmt: skip
        self._extend(_OF_OBSERVATIONS, of_observations)
        if len(new):
            self._sort()

    def _extend(self, names: tuple[str, ...], values: tuple[np.ndarray, ...]) -> None:
        for name, more in zip(names, values, strict=True):
            setattr(self, name, np.concatenate([getattr(self, name), more]))

    def _sort(self) -> None:
        """Sort points by track id."""
        order = np.argsort(self.ids, kind="stable")
        for name in _OF_POINTS:
            setattr(self, name, getattr(self, name)[order])
        row_of = np.empty(len(order), np.int64)
        row_of[order] = np.arange(len(order))
        self.point = row_of[self.point]

    def rays_at(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rays of pixels (N, 2), derivatives by the lens, and a mask (N,) of finite values."""
        rays, by_lens = self._lens.rays_of(pixels)
        seen = np.isfinite(rays).all(axis=1) & np.isfinite(by_lens).all(axis=(1, 2))
        return rays, by_lens, np.asarray(seen)

    def keep(self, points: np.ndarray, observations: np.ndarray | None = None) -> None:
        """Keep the points (M,) and observations (N,) selected by masks."""
        kept = points[self.point]
        if observations is not None:
            kept &= observations
        row_of, row_of_observation = np.cumsum(points) - 1, np.cumsum(kept) - 1
        self.anchor = row_of_observation[self.anchor]
        self.point = row_of[self.point]
        for names, which in ((_OF_POINTS, points), (_OF_OBSERVATIONS, kept)):
            indices = np.flatnonzero(which)
            for name in names:
                setattr(self, name, getattr(self, name)[indices])

    def next_anchors(self, rows: np.ndarray, slot: int) -> np.ndarray:
        """First observation of points (N,) by a keyframe other than ``slot``; -1 if none."""
        first = np.full(len(self.ids), -1)
        others = np.flatnonzero(self.slot != slot)[::-1]
        first[self.point[others]] = others  # reversed order: the first observation overwrites
        return first[rows]

    def remove(self, points: np.ndarray, slot: int) -> None:
        """Remove points selected by a mask (M,), and the observations and slot of a keyframe."""
        self.keep(~points, self.slot != slot)
        self.slot -= self.slot > slot

    def update_rays(self) -> None:
        """Recompute all rays with the current lens, and remove points outside the lens' field."""
        self.rays, self.ray_by_lens, seen = self.rays_at(self.pixels[self.anchor])
        if not seen.all():
            self.keep(seen)
