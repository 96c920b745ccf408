"""Where a frame was taken, by the points whose places the window knows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint._kernels.window import locate
from farpoint.path.history import Sighting
from farpoint.path.information import inverse
from farpoint.path.window import Window

__all__ = ["Located", "locate_frame"]

FEWEST_POINTS = 8
"""A pose has six unknowns."""

# Variances of the residuals are multiplied by these, step by step: from ten sigma off to none.
# Between the two parts the lens is taken where points are expected by then.
_INFLATIONS = np.array([100.0, 100.0, 25.0, 9.0]), np.array([4.0, 1.0, 1.0, 1.0])
_LARGEST_VARIANCE = 1e12  # of an inverse distance that is not known at all


@dataclass(frozen=True, kw_only=True, eq=False)
class Located:
    """A pose by known points.

    Attributes
    ----------
    R, p : ndarray, shapes (3, 3), (3,)
        Rotation ``world_from_cam`` and position.
    covariance : ndarray, shape (6, 6)
        Of ``[theta, rho]``: ``R' = Exp(theta) R``, ``p' = p + rho``, the points as they are.
    ids : ndarray of int64, shape (N,)
        Tracks of the points.
    squares : ndarray, shape (N,)
        Of their residuals, over the variances.
    """

    R: np.ndarray
    p: np.ndarray
    covariance: np.ndarray
    ids: np.ndarray
    squares: np.ndarray

    def fitting(self, limit: float) -> np.ndarray:
        """Tracks whose squared residuals are below a limit."""
        return self.ids[self.squares < limit]


def locate_frame(
    window: Window,
    seen: Sighting,
    last: tuple[np.ndarray, np.ndarray],
    R: np.ndarray,
    start: np.ndarray,
    seconds: float,
) -> Located | None:
    """Most likely pose by Student's t.

    Parameters
    ----------
    window : Window
    seen : Sighting
        The frame's tracks.
    R : ndarray, shape (3, 3)
        Rotation ``world_from_cam``, about right.
    last : (ndarray, ndarray)
        Rotation and position of the frame before.
    start : ndarray, shape (3,)
        Position, about right.
    seconds : float
        Time since the frame before.

    Returns
    -------
    Located or None
        None with fewer than eight points.
    """
    marks = window.landmarks
    rows = marks.rows_of(seen.ids)
    known = rows >= 0
    known[known] = marks.is_placed[rows[known]]
    if known.sum() < FEWEST_POINTS:
        return None
    points = _Points.of(window, rows[known], seen.select(known))
    return points.pose_from(window, last, R, start, seconds)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Points:
    """Known points that a frame sees, a row each; see `farpoint._kernels.window.locate`."""

    ids: np.ndarray
    places: np.ndarray
    base: np.ndarray
    s: np.ndarray
    s_variance: np.ndarray
    pixels: np.ndarray
    row_phase: np.ndarray
    before: np.ndarray
    before_by_s: np.ndarray
    covariances: np.ndarray

    @classmethod
    def of(cls, window: Window, rows: np.ndarray, seen: Sighting) -> _Points:
        """Of rows (N,) of the window's points, and where a frame sees them."""
        marks, since = window.landmarks, window.landmarks.latest()[rows]
        places, base = window.places(rows)
        s = marks.s[rows]
        return cls(
            ids=seen.ids,
            places=places,
            base=base,
            s=s,
            s_variance=np.minimum(marks.s_variance[rows], _LARGEST_VARIANCE),
            pixels=seen.pixels,
            row_phase=window.row_phase(seen.pixels),
            before=marks.residuals[since],
            before_by_s=marks.by_s[since],
            covariances=window.variances_since(since, seen.last, seen.travelled),
        )

    def pose_from(
        self,
        window: Window,
        last: tuple[np.ndarray, np.ndarray],
        R: np.ndarray,
        start: np.ndarray,
        seconds: float,
    ) -> Located | None:
        """Pose from a start; None where the points are not seen from there."""
        R, p, (R0, p0) = R.copy(), start.copy(), last
        H, squares = np.empty((6, 6)), np.empty(len(self.s))
        for inflations in _INFLATIONS:
            rays, offsets, by_ray = self._faced(window, R, p)
            _, count = locate(
                R, p, R0, p0, seconds, window.lens.readout_s, offsets, self.row_phase, rays, by_ray,
                self.covariances, inflations, self.places, self.s, self.s_variance, self.base,
                self.before_by_s, H, squares,
            )  # fmt: skip
            if count < FEWEST_POINTS:
                return None
        covariance = inverse(H / window.design_effect)
        return Located(R=R, p=p, covariance=covariance, ids=self.ids, squares=squares)

    def _faced(
        self, window: Window, R: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The lens where the points are expected: rays, pixels less the found, derivatives."""
        rays = (self.places - self.s[:, None] * p) @ R
        rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-300)
        pixels, by_ray, by_lens = window.lens.pixels_of(rays)
        offsets = pixels + by_lens @ window.lens.change - self.pixels - self.before
        unseen = ~(np.isfinite(offsets).all(axis=1) & np.isfinite(by_ray).all(axis=(1, 2)))
        rays[unseen], offsets[unseen], by_ray[unseen] = 0.0, 0.0, 0.0
        return rays, offsets, by_ray
