"""Resection: the pose of a frame from the window's landmarks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import MIN_MATCHES, NO_INFORMATION_VARIANCE, STUDENT_FREEDOM
from farpoint.geometry import so3
from farpoint.geometry.vectors import cross
from farpoint.path.constants import RESIDUAL_INFLATIONS
from farpoint.path.history import TrackObservations
from farpoint.path.information import inverse
from farpoint.path.kernels.resection import locate
from farpoint.path.residuals import clear_unseen
from farpoint.path.window import Window

__all__ = ["Located", "locate_frame"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Located:
    """A pose from landmarks.

    Attributes
    ----------
    R, p : ndarray, shapes (3, 3), (3,)
        Rotation ``world_from_cam`` and position.
    covariance : ndarray, shape (6, 6)
        Covariance of ``[theta, rho]`` if the window's keyframes, lens and shutter are exact, with
        ``R' = Exp(theta) R`` and ``p' = p + rho``.
    by_state : ndarray, shape (6, D)
        Derivatives of the estimated ``[theta, rho]`` by the unknowns of the window.
    ids : ndarray of int64, shape (N,)
        Track ids of the landmarks.
    squares : ndarray, shape (N,)
        Squared residuals divided by their variances.
    """

    R: np.ndarray
    p: np.ndarray
    covariance: np.ndarray
    by_state: np.ndarray
    ids: np.ndarray
    squares: np.ndarray

    def fitting(self, limit: float) -> np.ndarray:
        """Ids of the tracks whose squared residuals are below a limit."""
        return self.ids[self.squares < limit]


def locate_frame(
    window: Window,
    observed: TrackObservations,
    last: tuple[np.ndarray, np.ndarray],
    R: np.ndarray,
    start: np.ndarray,
    seconds: float,
) -> Located | None:
    """Maximum-likelihood pose of a frame, with errors of Student's t distribution.

    Parameters
    ----------
    window : Window
    observed : TrackObservations
        The frame's tracks.
    last : (ndarray, ndarray)
        Rotation ``world_from_cam`` (3, 3) and position (3,) of the previous frame.
    R : ndarray, shape (3, 3)
        Initial rotation ``world_from_cam``.
    start : ndarray, shape (3,)
        Initial position.
    seconds : float
        Time since the previous frame.

    Returns
    -------
    Located or None
        None with fewer than 8 reliable landmarks in view, or if the equations are singular.
    """
    marks = window.landmarks
    rows = marks.rows_of(observed.ids)
    known = rows >= 0
    known[known] = marks.is_reliable[rows[known]]
    if known.sum() < MIN_MATCHES:
        return None
    points = _Points.of(window, rows[known], observed.select(known))
    return points.pose_from(window, last, R, start, seconds)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Points:
    """Landmarks in a frame, one row for each; see `farpoint.path.kernels.resection.locate`.

    ``rows`` are the rows of the points in the window's landmarks. ``since`` is the index of the
    last observation of each landmark by a keyframe.
    """

    ids: np.ndarray
    rows: np.ndarray
    since: np.ndarray
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
        """Points of the given ``rows`` (N,) of the window's landmarks, with tracks in a frame."""
        marks, since = window.landmarks, window.landmarks.latest()[rows]
        homogeneous_points, base = window.homogeneous_points(rows)
        s = marks.s[rows]
        return cls(
            ids=observed.ids,
            rows=rows,
            since=since,
            homogeneous_points=homogeneous_points,
            base=base,
            s=s,
            s_variance=np.minimum(marks.s_variance[rows], NO_INFORMATION_VARIANCE),
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
        """Pose optimised from an initial pose; None as in `locate_frame`."""
        R, p, (R0, p0) = R.copy(), start.copy(), last
        H, squares = np.empty((6, 6)), np.empty(len(self.s))
        expected = self._linearise(window, R, p)
        for inflations, relinearises in RESIDUAL_INFLATIONS:
            if relinearises:
                expected = self._linearise(window, R, p)
            _, count = locate(
                R, p, R0, p0, seconds, window.lens.readout_s, expected.offsets, self.row_phase,
                expected.rays, expected.by_ray, self.covariances, inflations,
                self.homogeneous_points, self.s, self.s_variance, self.base, self.before_by_s,
                H, squares,
            )  # fmt: skip
            if count < MIN_MATCHES:
                return None
        twist = np.zeros(6)
        if seconds > 0.0:
            twist = np.concatenate([so3.log(R @ R0.T), p - p0]) / seconds
        covariance = inverse(H)
        return Located(
            R=R,
            p=p,
            covariance=window.design_effect * covariance,
            by_state=-covariance @ self._gradient_by_state(window, expected, R, p, twist, squares),
            ids=self.ids,
            squares=squares,
        )

    def _linearise(self, window: Window, R: np.ndarray, p: np.ndarray) -> _Expected:
        """Expected rays and pixels of the points at a pose."""
        rays = (self.homogeneous_points - self.s[:, None] * p) @ R
        rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-300)
        pixels, by_ray, by_lens = window.lens.pixels_of(rays)
        offsets = pixels + by_lens @ window.lens.change - self.pixels - self.before
        clear_unseen(rays, offsets, by_ray, by_lens)
        return _Expected(rays, offsets, by_ray, by_lens)

    def _gradient_by_state(
        self,
        window: Window,
        expected: _Expected,
        R: np.ndarray,
        p: np.ndarray,
        twist: np.ndarray,
        squares: np.ndarray,
    ) -> np.ndarray:
        """Derivatives (6, D) of the gradient of the cost by the unknowns of the window.

        The gradient (6,) is the derivative of the cost by the pose of this frame. A term of the
        cost contains the residual of a point in this frame minus the residual in the last keyframe
        that observes the point. Both residuals depend on the pose of the anchor's keyframe, on lens
        and read-out time, and on the inverse distance, which is itself a function of all unknowns
        of the window. The residual in the last keyframe also depends on the pose of the last
        keyframe. A residual does not change if the anchor's keyframe and the observing frame move
        together. The derivatives by these two poses are therefore opposite.
        """
        marks, s = window.landmarks, self.s[:, None]
        anchors = marks.anchor[self.rows]
        away = self.homogeneous_points - s * p
        by_point = expected.by_ray @ R.T
        by_point /= np.maximum(np.linalg.norm(away, axis=1), 1e-300)[:, None, None]
        by_turn = cross(by_point, away[:, None])
        by_pose = np.concatenate([by_turn, -s[:, :, None] * by_point], axis=2)
        # In the window p' = Exp(theta) p + rho: a rotation also moves the position.
        by_observer = by_pose.copy()
        by_observer[:, :, :3] -= by_pose[:, :, 3:] @ so3.skew(p)
        before, columns = marks.by_pose[self.since], np.zeros((len(s), 2, len(window.covariance)))
        _add_poses(columns, marks.slot[anchors], before - by_observer)
        _add_poses(columns, marks.slot[self.since], -before)
        common = columns[:, :, 6 * len(window.frames) :]
        common -= marks.by_common[self.since]
        lens_derivative, moved = window.anchor_derivatives(self.rows)
        common[:, :, :-1] += expected.by_lens + by_point @ lens_derivative
        lag = cross(np.broadcast_to(twist[:3], away.shape), away) + s * twist[3:]
        by_readout = moved - self.row_phase[:, None] * lag
        common[:, :, -1] += np.einsum("nqi,ni->nq", by_point, by_readout)
        by_s = np.einsum("nqi,ni->nq", by_point, self.base - p) - self.before_by_s
        columns += by_s[:, :, None] * marks.s_by_state[self.rows][:, None]
        weighted = self._precision(by_s, squares) @ by_pose
        return weighted.reshape(-1, 6).T @ columns.reshape(len(s) * 2, -1)

    def _precision(self, by_s: np.ndarray, squares: np.ndarray) -> np.ndarray:
        """Inverse covariances (N, 2, 2) of the residuals, times robust weights."""
        uu, uv, vv = self.covariances.T
        u, v = by_s.T
        # Determinant of C + s_variance b b^T with b = by_s, in a form without cancellation.
        determinant = uu * vv - uv * uv
        determinant += self.s_variance * (uu * v * v - 2.0 * uv * u * v + vv * u * u)
        used = np.isfinite(squares)
        weight = np.zeros(len(squares))
        weight[used] = (STUDENT_FREEDOM + 2.0) / (
            (STUDENT_FREEDOM + squares[used]) * determinant[used]
        )
        uu, uv, vv = (
            uu + self.s_variance * u * u,
            uv + self.s_variance * u * v,
            vv + self.s_variance * v * v,
        )
        entries = [weight * vv, -weight * uv, -weight * uv, weight * uu]
        return np.stack(entries, axis=1).reshape(-1, 2, 2)


class _Expected(NamedTuple):
    """Expected unit rays (N, 3) to points, expected minus observed pixels, and derivatives."""

    rays: np.ndarray
    offsets: np.ndarray
    by_ray: np.ndarray
    by_lens: np.ndarray


def _add_poses(columns: np.ndarray, slots: np.ndarray, values: np.ndarray) -> None:
    """Add derivatives (N, 2, 6) by the poses in ``slots`` to their columns of (N, 2, D)."""
    rows = np.arange(len(slots))[:, None, None]
    columns[rows, np.arange(2)[:, None], 6 * slots[:, None, None] + np.arange(6)] += values
