"""Sliding-window bundle adjustment over keyframe poses, inverse distances, lens and shutter.

Inverse distances are eliminated from the equations. Keyframes that leave the window are
marginalised into a prior.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.constants import GATE_SIGMA
from farpoint.geometry import so3
from farpoint.geometry.vectors import cross, median, products
from farpoint.path.constants import (
    DAMPING_FACTOR,
    DEPTH_DAMPING,
    DESIGN_EFFECT_BOUNDS,
    FAR_DEPTH_SIGMA,
    FIRST_DAMPING,
    FIRST_DESIGN_EFFECT,
    LINEARISATION_EFFECT,
    MAX_DEPTH_STEP_RATIO,
    MAX_TRIES,
    MIN_INVERSE_DEPTH,
    MIN_RESIDUALS,
    NEW_DEPTH_SIGMA,
    POSE_GAUGE_SIGMA,
    RELIABLE_DEPTH_SIGMA,
    SCALE_GAUGE_SIGMA,
    SIGNIFICANT_PARALLAX_SIGMA,
    SMOOTHING,
    UNSEEN_PX,
    VARIANCE_FACTOR_BOUNDS,
)
from farpoint.path.history import TrackObservations
from farpoint.path.information import System, inverse, solution
from farpoint.path.kernels.cholesky import point_variances
from farpoint.path.kernels.information import point_steps
from farpoint.path.keyframe import Keyframe
from farpoint.path.landmarks import Landmarks
from farpoint.path.lens import LensEstimate
from farpoint.path.prior import Prior, by_position_change
from farpoint.path.residuals import NOISE, Linear, Normal, Poses, Residuals, row_phase
from farpoint.path.scale import Scale, by_log_length
from farpoint.path.velocities import correct_velocities

__all__ = ["Window"]


class Window:
    """Joint estimate of keyframe poses, landmarks, lens and shutter.

    Parameters
    ----------
    lens : LensEstimate
        Estimate of lens and shutter, which is updated in place.
    size : (int, int)
        Width and height of the images, px.

    Attributes
    ----------
    frames : list of Keyframe
        Keyframes in ascending order of time.
    landmarks : Landmarks
        Landmarks and observations.
    covariance : ndarray, shape (D, D)
        Covariance of all unknowns at the last solution: 6 for each pose, as in `Prior`, then lens
        and read-out time.
    size : (int, int)
        Size of the images.
    origin : ndarray, shape (3,)
        Position of the first keyframe, which defines the gauge.
    cost : float
        Negative log likelihood up to a constant, at the last solution.
    variance_factor : float
        Estimated factor on the residual variances.
    design_effect : float
        Number of observations divided by the effective number of independent observations. Errors
        are correlated between neighbouring points and along a track.
    """

    def __init__(self, lens: LensEstimate, size: tuple[int, int]) -> None:
        self.size = size
        self._scale = Scale(len(lens.covariance))
        # ``sigma`` of each `add_rest_prior`, by the slot of the later of the two keyframes; empty
        # as soon as a keyframe is marginalised.
        self._rests: dict[int, float] = {}
        self._has_marginalised = False
        self._begin(lens)

    def _begin(self, lens: LensEstimate) -> None:
        """Reset to a window without keyframes and landmarks, with the prior of the lens only."""
        self.lens, self.landmarks = lens, Landmarks(lens)
        self.frames: list[Keyframe] = []
        self.variance_factor = 1.0
        self.design_effect = LINEARISATION_EFFECT * FIRST_DESIGN_EFFECT
        self._prior = Prior(lens.common, lens.covariance)
        self.origin = np.zeros(3)
        self.covariance = lens.covariance
        self.cost = 0.0
        self._linear: Linear | None = None

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def has_marginalised(self) -> bool:
        """Whether a keyframe has been marginalised."""
        return self._has_marginalised

    # Keyframes and priors

    def add(
        self, frame: int, timestamp: float, R: np.ndarray, p: np.ndarray, twist: np.ndarray
    ) -> Keyframe:
        """Append a keyframe with an initial pose."""
        keyframe = Keyframe(frame=frame, timestamp=timestamp, R=R, p=p, twist=twist)
        self._append(keyframe)
        return keyframe

    def _append(self, keyframe: Keyframe) -> None:
        self._prior.add_pose(keyframe)
        if not self.frames:  # the first keyframe of the window fixes the gauge
            self._prior.fix_first(POSE_GAUGE_SIGMA)
            self.origin = keyframe.p
        self.frames.append(keyframe)
        self._linear = None

    def restart(
        self, lens: LensEstimate, common: np.ndarray, rate: np.ndarray, since: float
    ) -> None:
        """Start again from other poses and another lens, with the same observations.

        A restart is possible only before the first keyframe is marginalised. Lens and read-out time
        start at ``common``. Each pose after the time ``since`` is changed by the velocity ``rate``
        (6,), in the format of `Keyframe.twist`, times the time that has passed since ``since``.
        """
        marks, frames = self.landmarks, self.frames
        self._begin(lens)
        lens.z, lens.readout_s = common[:-1], float(common[-1])
        for slot, frame in enumerate(frames):
            if frame.timestamp >= since:
                change = rate * (frame.timestamp - since)
                frame.R, frame.p = so3.exp(change[:3]) @ frame.R, frame.p + change[3:]
                frame.twist = frame.twist + rate
            self._append(frame)
            self.landmarks.observe(slot, *marks.tracks_of(slot))
            if slot in self._rests:
                self._measure_rest(self._rests[slot])
            if slot:
                self.triangulate()

    def observe(self, tracks: TrackObservations) -> None:
        """Add the newest keyframe's observations."""
        self.landmarks.observe(len(self.frames) - 1, *tracks)

    def add_rest_prior(self, sigma: float) -> None:
        """Add the prior that the last two keyframes have the same position.

        ``sigma`` is the 1-sigma of each coordinate, in units of the path.
        """
        self._rests[len(self.frames) - 1] = sigma
        self._measure_rest(sigma)

    def _measure_rest(self, sigma: float) -> None:
        displacement = self.frames[-1].p - self.frames[-2].p
        for axis in np.eye(3):
            self._add_measurement(axis, float(axis @ displacement), sigma)

    def _add_measurement(self, axis: np.ndarray, residual: float, sigma: float) -> None:
        deviation = self._deviation()
        last = len(self.frames) - 1
        row = by_position_change(self.frames, last - 1, last, axis, len(deviation))
        self._prior.add(row, residual, sigma, deviation)

    def _deviation(self) -> np.ndarray:
        return self._prior.deviation(Poses.of(self.frames), self.lens.common)

    def set_unit(self) -> None:
        """Fix the scale by the current distance between the last two keyframes."""
        self._scale.set_unit((len(self.frames) - 2, len(self.frames) - 1))

    # Points

    def homogeneous_points(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Homogeneous points ``X = R b + s p`` (N, 3), and the derivatives (N, 3) of X by s.

        R and p are the pose of the anchor's keyframe when the row of the anchor is read, b is the
        ray of the anchor, and s is the inverse distance.
        """
        marks, poses = self.landmarks, Poses.of(self.frames)
        at = marks.anchor[rows]
        slot = marks.slot[at]
        rays = marks.rays[rows] + marks.ray_by_lens[rows] @ self.lens.change
        world = np.einsum("nij,nj->ni", poses.R[slot], rays)
        delay_s, twist = self._row_delay_s(at)[:, None], poses.twist[slot]
        base = poses.p[slot] + delay_s * twist[:, 3:]
        world = world + delay_s * cross(twist[:, :3], world)
        return world + marks.s[rows, None] * base, base

    def anchor_derivatives(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of homogeneous points by lens (N, 3, r) and read-out time (N, 3)."""
        marks, poses = self.landmarks, Poses.of(self.frames)
        at = marks.anchor[rows]
        slot = marks.slot[at]
        by_lens, twist = products(poses.R[slot], marks.ray_by_lens[rows]), poses.twist[slot]
        world = np.einsum("nij,nj->ni", poses.R[slot], marks.rays[rows])
        lag = cross(twist[:, :3], world) + marks.s[rows, None] * twist[:, 3:]
        return by_lens, self.row_phase(marks.pixels[at])[:, None] * lag

    def row_phase(self, pixels: np.ndarray) -> np.ndarray:
        """Times (N,) at which pixels (N, 2) are read, from -1/2 to 1/2 of the read-out time."""
        return row_phase(pixels, self.size)

    def _row_delay_s(self, observations: np.ndarray) -> np.ndarray:
        """Times (N,) at which the rows of observations are read, s after the middle row."""
        return self.row_phase(self.landmarks.pixels[observations]) * self.lens.readout_s

    def triangulate(self) -> None:
        """Initialise the distances of points with a second observation in the newest keyframe."""
        marks, frame = self.landmarks, self.frames[-1]
        seen = marks.observations_of(len(self.frames) - 1)
        rows = marks.point[seen]
        new = ~marks.has_depth[rows] & (marks.anchor[rows] != seen)
        if not new.any():
            return
        seen, rows = seen[new], rows[new]
        far, base = self.homogeneous_points(rows)  # rays, since the inverse distances are zero
        delay_s = self._row_delay_s(seen)[:, None]
        rays = (far - delay_s * cross(np.broadcast_to(frame.twist[:3], far.shape), far)) @ frame.R
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        by_s = (base - frame.p - delay_s * frame.twist[3:]) @ frame.R
        pixels, by_ray, by_lens = self.lens.pixels_of(rays)
        residual = pixels + by_lens @ self.lens.change - marks.pixels[seen]
        slope = np.einsum("nqi,ni->nq", by_ray, by_s)
        usable = np.isfinite(residual).all(axis=1) & np.isfinite(slope).all(axis=1)
        residual, slope = np.where(usable[:, None], (residual, slope), 0.0)
        variance = self._variances(
            marks.last[seen], marks.accumulated[seen] - marks.accumulated[marks.anchor[rows]]
        )
        information = np.sum(slope**2, axis=1) / (0.5 * (variance[:, 0] + variance[:, 2]))
        with np.errstate(divide="ignore", invalid="ignore"):
            estimate = -np.sum(slope * residual, axis=1) / np.sum(slope**2, axis=1)
        estimate = np.where(information > 0.0, estimate, 0.0)
        typical = self._typical_inverse_depth(estimate, information)
        ridge = 1.0 / (NEW_DEPTH_SIGMA * typical) ** 2
        found = (information * estimate + ridge * typical) / (information + ridge)
        marks.s[rows] = np.maximum(found, MIN_INVERSE_DEPTH)
        marks.s_variance[rows] = 1.0 / (information + ridge)
        marks.has_depth[rows] = True

    def _typical_inverse_depth(self, estimate: np.ndarray, information: np.ndarray) -> float:
        marks = self.landmarks
        known = marks.s[marks.has_depth & (marks.s > MIN_INVERSE_DEPTH)]
        if len(known) < 20:
            known = estimate[
                (estimate > 0.0) & (estimate**2 * information > SIGNIFICANT_PARALLAX_SIGMA**2)
            ]
        if len(known) >= 8:
            return median(known)
        return 0.05 / max(float(np.linalg.norm(self.frames[-1].p - self.frames[-2].p)), 1e-9)

    def _variances(self, last: np.ndarray, accumulated: np.ndarray) -> np.ndarray:
        """Covariances (N, 3), px^2, of residual changes, times `variance_factor`."""
        return self.variance_factor * NOISE.covariances(last, accumulated)

    def variances_since(
        self, observations: np.ndarray, last: np.ndarray, accumulated: np.ndarray
    ) -> np.ndarray:
        """Covariances (N, 3), px^2, of residual changes since earlier observations (N,)."""
        return self._variances(last, accumulated - self.landmarks.accumulated[observations])

    # The solution

    def solve(self, iterations: int) -> None:
        """Minimise the negative log likelihood by Levenberg-Marquardt."""
        if self.lens.is_stale():
            self.lens.relinearise()
            self.landmarks.update_rays()
        poses = start = Poses.of(self.frames)
        residuals = self._residuals(poses)
        linear, deviation = residuals.linear(poses), self._prior.deviation(poses, self.lens.common)
        cost = residuals.cost(linear) + self._prior.cost(deviation)
        normal, system = self._equations(residuals, linear, deviation)
        damping = FIRST_DAMPING
        for iteration in range(iterations):
            if iteration:
                normal, system = self._equations(residuals, linear, deviation)
            for _ in range(MAX_TRIES):
                before = self._state()
                self._move(solution(system, damping), normal)
                poses = Poses.of(self.frames)
                updated = residuals.linear(poses)
                updated_deviation = self._prior.deviation(poses, self.lens.common)
                updated_cost = residuals.cost(updated) + self._prior.cost(updated_deviation)
                if updated_cost <= cost:
                    linear, deviation, cost, damping = (
                        updated,
                        updated_deviation,
                        updated_cost,
                        0.1 * damping,
                    )
                    break
                self._restore(before)
                damping *= DAMPING_FACTOR
        self.cost = cost
        self._store_solution(linear, normal, system)
        correct_velocities(self.frames, start)
        self._scale.update(self.frames, self.covariance)

    def _equations(
        self, residuals: Residuals, linear: Linear, deviation: np.ndarray
    ) -> tuple[Normal, System]:
        """Normal equations of the observations, and a system with the prior and without points.

        The points are eliminated from the system by the Schur complement.
        """
        normal = residuals.normal(linear, self.landmarks.has_depth)
        reduced = normal.reduced(self._depth_damping())
        return normal, self._with_prior(reduced, deviation, self._scale.gauge(self.frames))

    def _residuals(self, poses: Poses) -> Residuals:
        return Residuals(
            self.landmarks, self.lens, self.size, poses, self.variance_factor, self.design_effect
        )

    def newest_by_state(self) -> np.ndarray:
        """Derivatives (6, D), by all unknowns, of ``[dtheta, dp]`` of the newest keyframe.

        ``dtheta`` is the perturbation of the rotation, and ``p' = p + dp``.
        """
        at, rows = 6 * (len(self.frames) - 1), np.zeros((6, len(self.covariance)))
        rows[:, at : at + 6] = np.eye(6)
        rows[3:, at : at + 3] = -so3.skew(self.frames[-1].p)
        return rows

    def covariance_of(self, by_state: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Covariance (7, 7) of ``[dtheta, dp, dlog_scale]`` of a pose, in the world.

        The error of the position is defined by ``p_true = p + dp``. ``by_state`` (6, D) holds the
        derivatives of the pose by all unknowns of the last solution. ``dlog_scale`` is the error of
        the scale at the newest keyframe (`Scale`).
        """
        rows = np.vstack([by_state, self._scale.by_state])
        by_unit = np.array([0.0, 0.0, 0.0, *(p - self.origin), 1.0])
        unit = self._scale.unit_variance(self.frames, self.covariance)
        covariance = rows @ self.covariance @ rows.T + unit * np.outer(by_unit, by_unit)
        if self._scale.ends_unit(len(self.frames) - 1):  # the unit has no error by definition
            covariance[6], covariance[:, 6] = 0.0, 0.0
        else:
            covariance[6, 6] += self._scale.unmeasured_variance()
        return covariance

    def last_length(self) -> tuple[float, bool]:
        """Distance between the last two keyframes, and whether the distance exceeds 3 sigma."""
        displacement = self.frames[-1].p - self.frames[-2].p
        length, last = float(np.linalg.norm(displacement)), len(self.frames) - 1
        if length == 0.0:
            return 0.0, False
        row = by_position_change(
            self.frames, last - 1, last, displacement / length, len(self.covariance)
        )
        return length, length**2 > GATE_SIGMA**2 * float(row @ self.covariance @ row)

    def relative_pose(self, slot0: int, slot1: int) -> tuple[np.ndarray, np.ndarray]:
        """Motion ``cam1_from_cam0`` (4, 4) between two keyframes, and its covariance (6, 6).

        The covariance is that of ``[dtheta, dt]`` in camera 1: ``R_true = Exp(dtheta) R``, ``t_true
        = t + dt``.
        """
        first, second = self.frames[slot0], self.frames[slot1]
        motion = np.eye(4)
        motion[:3, :3] = second.R.T @ first.R
        motion[:3, 3] = second.R.T @ (first.p - second.p)
        rows = np.zeros((6, len(self.covariance)))
        for slot, sign in ((slot0, 1.0), (slot1, -1.0)):
            rows[:, 6 * slot : 6 * slot + 6] += sign * np.eye(6)
            rows[3:, 6 * slot : 6 * slot + 3] -= sign * so3.skew(first.p)
        rotated = np.kron(np.eye(2), second.R.T) @ rows
        return motion, rotated @ self.covariance @ rotated.T

    def _store_solution(self, linear: Linear, normal: Normal, system: System) -> None:
        """Store the residuals at the solution, and the covariances of the last iteration."""
        marks, self._linear = self.landmarks, linear
        unseen = linear.residuals[:, :1] == UNSEEN_PX
        marks.residuals = np.where(unseen, 0.0, linear.residuals)
        marks.by_s, marks.by_pose, marks.by_common = linear.by_s, linear.by_pose, linear.by_common
        self.covariance = inverse(system.H)
        common = 1 + self.lens.size
        self.lens.covariance = self.covariance[-common:, -common:]
        with np.errstate(divide="ignore"):
            marks.s_variance = np.where(marks.has_depth, 1.0 / normal.point_h, np.inf)
        marks.s_by_state = -normal.coupling / np.maximum(normal.point_h, 1e-300)[:, None]
        self._mark_reliable(normal)
        free = 2 * normal.residuals - len(normal.g) - int(marks.has_depth.sum())
        if normal.residuals > MIN_RESIDUALS:
            ratio = normal.squares / max(free, MIN_RESIDUALS)
            factor = self.variance_factor * (SMOOTHING + (1.0 - SMOOTHING) * ratio)
            self.variance_factor = float(np.clip(factor, *VARIANCE_FACTOR_BOUNDS))
            seen = LINEARISATION_EFFECT * normal.design_effect
            effect = SMOOTHING * self.design_effect + (1.0 - SMOOTHING) * seen
            self.design_effect = float(np.clip(effect, *DESIGN_EFFECT_BOUNDS))

    def _mark_reliable(self, normal: Normal) -> None:
        """Mark the points in the newest keyframe whose inverse distance is accurate.

        The 1-sigma of the inverse distance must be below `RELIABLE_DEPTH_SIGMA` times the inverse
        distance, or below `FAR_DEPTH_SIGMA` times the median of all known inverse distances. The
        variance includes errors of the poses, but neither the error of the scale, which is common
        to all distances, nor the factor `design_effect` for correlated errors.
        """
        marks, newest = self.landmarks, len(self.frames) - 1
        spread = self.covariance
        lengths = [float(np.linalg.norm(f.p - self.frames[-1].p)) for f in self.frames]
        if max(lengths) > 0.0:
            # Covariance if the longest baseline to the newest keyframe has a known length.
            row = by_log_length(self.frames, (int(np.argmax(lengths)), newest), len(spread))
            by_length = spread @ row
            spread = spread - np.outer(by_length, by_length) / (
                SCALE_GAUGE_SIGMA**2 + row @ by_length
            )
        rows = marks.point[marks.observations_of(newest)]
        rows = rows[normal.point_h[rows] > 0.0]
        variances = np.empty(len(rows))
        point_variances(rows, normal.coupling, normal.point_h, spread, variances)
        known = marks.s[marks.has_depth]
        typical = median(known) if len(known) else 0.0
        largest = np.maximum(RELIABLE_DEPTH_SIGMA * marks.s[rows], FAR_DEPTH_SIGMA * typical)
        marks.is_reliable[:] = False
        marks.is_reliable[rows] = variances / self.design_effect < largest**2

    def _with_prior(
        self, system: System, deviation: np.ndarray, gauge: tuple[int, int] | None
    ) -> System:
        """Add the prior to a system, and fix the distance between keyframes ``gauge`` (slots)."""
        known = self._prior.at(deviation)
        H = system.H + known.H
        if gauge is not None:
            row = by_log_length(self.frames, gauge, len(H)) / SCALE_GAUGE_SIGMA
            H += np.outer(row, row)
        return System(H, system.g + known.g)

    def _depth_damping(self) -> float:
        known = self.landmarks.s[self.landmarks.has_depth]
        return DEPTH_DAMPING / median(known) ** 2 if len(known) else 1.0

    def _move(self, step: np.ndarray, normal: Normal) -> None:
        marks, poses = self.landmarks, step[: 6 * len(self.frames)].reshape(-1, 6)
        for frame, turn, shift in zip(
            self.frames, so3.exp(poses[:, :3]), poses[:, 3:], strict=True
        ):
            frame.R, frame.p = turn @ frame.R, turn @ frame.p + shift
        self.lens.step(step[6 * len(self.frames) :])
        if not marks.has_depth.any():
            return
        changes = np.empty(len(marks.s))
        point_steps(
            normal.coupling, normal.point_h, normal.point_g, step, self._depth_damping(), changes
        )
        typical = median(marks.s[marks.has_depth])
        largest = MAX_DEPTH_STEP_RATIO * np.maximum(marks.s, typical)
        updated = np.clip(marks.s + changes, MIN_INVERSE_DEPTH, largest)
        marks.s = np.where(marks.has_depth, updated, marks.s)

    def _state(self) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray, np.ndarray, float]:
        poses = [(frame.R, frame.p) for frame in self.frames]
        return poses, self.landmarks.s, self.lens.z, self.lens.readout_s

    def _restore(
        self, state: tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray, np.ndarray, float]
    ) -> None:
        for frame, (R, p) in zip(self.frames, state[0], strict=True):
            frame.R, frame.p = R, p
        self.landmarks.s, self.lens.z, self.lens.readout_s = state[1:]

    # Marginalisation

    def remove(self, slot: int, alive: np.ndarray) -> Keyframe:
        """Marginalise a keyframe into the prior.

        ``alive`` holds the ids, ascending, of the tracks in view. A point whose anchor is in the
        removed keyframe is marginalised, too, if its track is not in view. If the track is in view,
        the next observation of the point becomes the anchor. A point with a single observation is
        removed if its track is not in view, because such a point carries no information.
        """
        marks, frame = self.landmarks, self.frames[slot]
        poses = Poses.of(self.frames)
        is_anchored = marks.slot[marks.anchor] == slot
        is_alive = np.isin(marks.ids, alive)
        ended = is_anchored & ~is_alive
        used, residuals = ended & marks.has_depth, self._residuals(poses)
        linear = self._linear
        # The residuals of the last solution lack the observations that were added later.
        if linear is None or used[marks.point[len(linear.residuals) :]].any():
            linear = residuals.linear(poses)
        reduced = residuals.normal(linear, used).reduced(0.0)
        gauge = self._scale.gauge(self.frames)
        system = self._with_prior(reduced, self._deviation(), gauge)
        self._scale.forget_unit(self.frames, self.covariance)
        gone = ended | ~is_alive & (np.bincount(marks.point, minlength=len(marks.ids)) < 2)
        gone[self._change_anchors(np.flatnonzero(is_anchored & ~ended), slot)] = True
        marks.remove(gone, slot)
        del self.frames[slot]
        out = slice(6 * slot, 6 * slot + 6)
        self.covariance = np.delete(np.delete(self.covariance, out, axis=0), out, axis=1)
        self._prior.replace(system, slot, Poses.of(self.frames), self.lens.common)
        self._has_marginalised, self._linear = True, None
        self._rests.clear()
        return frame

    def _change_anchors(self, rows: np.ndarray, slot: int) -> np.ndarray:
        """Move the anchors of points from keyframe ``slot`` to another keyframe.

        The function returns the rows of the points that have no valid observation in another
        keyframe.
        """
        marks = self.landmarks
        new = marks.next_anchors(rows, slot)
        rays, by_lens, seen = marks.rays_at(marks.pixels[new])
        seen &= new >= 0
        rest, rows, new = rows[~seen], rows[seen], new[seen]
        X, _ = self.homogeneous_points(rows)
        poses, at = Poses.of(self.frames), marks.slot[new]
        base = poses.p[at] + self._row_delay_s(new)[:, None] * poses.twist[at, 3:]
        away = X - marks.s[rows, None] * base
        length = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        marks.s[rows] = np.maximum(marks.s[rows] / length, MIN_INVERSE_DEPTH)
        marks.s_variance[rows] /= length**2
        marks.anchor[rows], marks.rays[rows], marks.ray_by_lens[rows] = (
            new,
            rays[seen],
            by_lens[seen],
        )
        # Residuals are relative to the new anchor.
        updated = np.full(len(marks.ids), -1)
        updated[rows] = np.arange(len(rows))
        which = updated[marks.point]
        is_reanchored = which >= 0
        first = new[which[is_reanchored]]
        marks.residuals[is_reanchored] -= marks.residuals[first]
        marks.by_s[is_reanchored] = (marks.by_s[is_reanchored] - marks.by_s[first]) * length[
            which[is_reanchored], None
        ]
        return rest
