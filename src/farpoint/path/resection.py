"""Resection: the pose of a frame from the window's landmarks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint._kernels.window import locate
from farpoint.path.history import TrackObservations
from farpoint.path.information import inverse
from farpoint.path.window import Window

__all__ = ["Located", "locate_frame"]

FEWEST_POINTS = 8
"""Least number of landmarks for a pose, which has six unknowns."""

# Factors on the residual variances, iteration by iteration, for convergence from 10 sigma. The lens
# is relinearised between the two parts.
_INFLATIONS = np.array([100.0, 100.0, 25.0, 9.0]), np.array([4.0, 1.0, 1.0, 1.0])
_LARGEST_VARIANCE = 1e12  # of an inverse distance without information


@dataclass(frozen=True, kw_only=True, eq=False)
class Located:
    """A pose from landmarks.

    Attributes
    ----------
    R, p : ndarray, shapes (3, 3), (3,)
        Rotation ``world_from_cam`` and position.
    covariance : ndarray, shape (6, 6)
        Of ``[theta, rho]``: ``R' = Exp(theta) R``, ``p' = p + rho``, with the points fixed.
    ids : ndarray of int64, shape (N,)
        Tracks of the landmarks.
    squares : ndarray, shape (N,)
        Squared residuals over their variances.
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
    observed: TrackObservations,
    last: tuple[np.ndarray, np.ndarray],
    R: np.ndarray,
    start: np.ndarray,
    seconds: float,
) -> Located | None:
    """Maximum-likelihood pose of a frame, Student's t errors.

    Parameters
    ----------
    window : Window
    seen : Sighting
        The frame's tracks.
    R : ndarray, shape (3, 3)
        Initial rotation ``world_from_cam``.
    last : (ndarray, ndarray)
        Rotation and position of the previous frame.
    start : ndarray, shape (3,)
        Initial position.
    seconds : float
        Time since the previous frame.

    Returns
    -------
    Located or None
        None with fewer than 8 landmarks.
    """
    marks = window.landmarks
    rows = marks.rows_of(observed.ids)
    known = rows >= 0
    known[known] = marks.is_reliable[rows[known]]
    if known.sum() < FEWEST_POINTS:
        return None
    points = _Points.of(window, rows[known], observed.select(known))
    return points.pose_from(window, last, R, start, seconds)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Points:
    """Landmarks in a frame, one row each; see `farpoint._kernels.window.locate`."""

    ids: np.ndarray
    homogeneous_points: np.ndarray
    base: np.ndarray
    s: np.ndarray
    s_variance: np.ndarray
    pixels: np.ndarray
    row_phase: np.ndarray
    before: np.ndarray
    before_by_s: np.ndarray
    covariances: np.ndarray

    @classmethod
    def of(cls, window: Window, rows: np.ndarray, observed: TrackObservations) -> _Points:
        """From rows (N,) of the window's landmarks and their tracks in a frame."""
        marks, since = window.landmarks, window.landmarks.latest()[rows]
        homogeneous_points, base = window.homogeneous_points(rows)
        s = marks.s[rows]
        return cls(
            ids=observed.ids,
            homogeneous_points=homogeneous_points,
            base=base,
            s=s,
            s_variance=np.minimum(marks.s_variance[rows], _LARGEST_VARIANCE),
            pixels=observed.pixels,
            row_phase=window.row_phase(observed.pixels),
            before=marks.residuals[since],
            before_by_s=marks.by_s[since],
            covariances=window.variances_since(since, observed.last, observed.accumulated),
        )

    def pose_from(
        self,
        window: Window,
        last: tuple[np.ndarray, np.ndarray],
        R: np.ndarray,
        start: np.ndarray,
        seconds: float,
    ) -> Located | None:
        """Optimised pose from an initial one; None with too few points in the lens' field."""
        R, p, (R0, p0) = R.copy(), start.copy(), last
        H, squares = np.empty((6, 6)), np.empty(len(self.s))
        for inflations in _INFLATIONS:
            rays, offsets, by_ray = self._linearise(window, R, p)
            _, count = locate(
                R, p, R0, p0, seconds, window.lens.readout_s, offsets, self.row_phase, rays, by_ray,
                self.covariances, inflations, self.homogeneous_points, self.s, self.s_variance,
                self.base, self.before_by_s, H, squares,
            )  # fmt: skip
            if count < FEWEST_POINTS:
                return None
        covariance = inverse(H / window.design_effect)
        return Located(R=R, p=p, covariance=covariance, ids=self.ids, squares=squares)

    def _linearise(
        self, window: Window, R: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Expected rays, expected minus observed pixels, and derivatives by the rays."""
        rays = (self.homogeneous_points - self.s[:, None] * p) @ R
        rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-300)
        pixels, by_ray, by_lens = window.lens.pixels_of(rays)
        offsets = pixels + by_lens @ window.lens.change - self.pixels - self.before
        unseen = ~(np.isfinite(offsets).all(axis=1) & np.isfinite(by_ray).all(axis=(1, 2)))
        rays[unseen], offsets[unseen], by_ray[unseen] = 0.0, 0.0, 0.0
        return rays, offsets, by_ray
