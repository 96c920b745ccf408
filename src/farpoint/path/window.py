"""A window over keyframes: their poses, the distances of points, lens and shutter, all together.

Distances are eliminated; keyframes that leave become a prior for those that stay.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.positive import point_variances
from farpoint._kernels.window import UNSEEN_PX, point_steps
from farpoint.geometry import so3
from farpoint.path.history import Sighting
from farpoint.path.information import System, inverse, solution
from farpoint.path.keyframe import Keyframe
from farpoint.path.landmarks import Landmarks
from farpoint.path.lens import LensEstimate
from farpoint.path.prior import Prior, by_position_change
from farpoint.path.residuals import NOISE, Linear, Normal, Poses, Residuals, row_phase
from farpoint.path.vectors import cross

__all__ = ["Window"]

LEAST_INVERSE_DEPTH = 1e-6
"""Of points that are as good as infinitely far, in units of the path."""

_GAUGE_SIGMA = 1e-4  # relative, of the length that is the unit: small against all that is measured
_POSE_SIGMA = 1e-6  # of the first pose, which is the world
_FARTHEST_GROWTH = 10.0  # of an inverse distance in one step
_FACTOR_RANGE = (0.1, 100.0)  # of the variance
_EFFECT_RANGE = (1.0, 50.0)  # of the design effect
_FIRST_EFFECT = 4.0  # before any was seen: of handheld and driving recordings 3 to 6
# Information that noise makes: derivatives are taken where noisy estimates are. Of tracks with
# independent errors, squared errors of lens and shutter are so many times their variances.
_LINEARISATION_EFFECT = 3.0
_MEMORY = 0.8  # share of either that stays from keyframe to keyframe
_FEWEST_RESIDUALS = 50  # which tell it
_FIRST_DAMPING, _DAMPING_STEP, _TRIES = 1e-6, 100.0, 3
_DEPTH_DAMPING = 1e-3  # of a point's information, over that of the median distance squared
# New points whose parallax does not tell: about as far as others, 1-sigma in units of that.
_DEPTH_SIGMA = 2.0
_FIRM_PARALLAX = 5.0  # sigma
_SEEN_SIGMAS = 3.0  # a way that is not longer may be none
_PLACED_SIGMA = 0.25  # relative, of the distance of a point that others are measured by: 4 sigma
_FAR_SIGMA = 0.1  # of the inverse distance of a far one, in units of the median


class Window:
    """Poses of keyframes, points, lens and shutter.

    Parameters
    ----------
    lens : LensEstimate
        Changed as it is found.
    size : (int, int)
        Width and height of the images, px.

    Attributes
    ----------
    frames : list of Keyframe
        In their order.
    landmarks : Landmarks
        What they see.
    covariance : ndarray, shape (D, D)
        Of all poses, 6 each as in `Prior`, and the common unknowns, as last solved.
    size : (int, int)
        Of the images.
    origin : ndarray, shape (3,)
        Where the first keyframe is, which is taken as true.
    cost : float
        Negative log likelihood, but for a constant, as last solved.
    variance_factor : float
        Of the residuals' variances, as found.
    design_effect : float
        How many observations count as one, for their errors are alike: neighbours lie on the same
        things, and a track errs the same way again and again.
    """

    def __init__(self, lens: LensEstimate, size: tuple[int, int]) -> None:
        self.lens, self.size = lens, size
        self.frames: list[Keyframe] = []
        self.landmarks = Landmarks(lens)
        self.variance_factor = 1.0
        self.design_effect = _LINEARISATION_EFFECT * _FIRST_EFFECT
        self._prior = Prior(lens.common, lens.covariance)
        # Keyframes between which the unit lies, until the prior holds the scale.
        self._unit: tuple[int, int] | None = None
        self._unit_variance = self._scale_variance = 0.0
        self._has_forgotten = False
        self.origin = np.zeros(3)
        self.covariance = lens.covariance
        self.cost = 0.0
        self._linear: Linear | None = None

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def has_forgotten(self) -> bool:
        """Whether a keyframe has left."""
        return self._has_forgotten

    # Keyframes and what is known of them

    def add(
        self, frame: int, timestamp: float, R: np.ndarray, p: np.ndarray, twist: np.ndarray
    ) -> Keyframe:
        """A new keyframe at a pose that is about right."""
        keyframe = Keyframe(frame=frame, timestamp=timestamp, R=R, p=p, twist=twist)
        self._prior.add_pose(keyframe)
        if not self.frames:  # the first one: a window always keeps its newest
            self._prior.fix_first(_POSE_SIGMA)
            self.origin = p
        self.frames.append(keyframe)
        self._linear = None
        return keyframe

    def see(self, sighting: Sighting) -> None:
        """What the newest keyframe sees."""
        self.landmarks.observe(len(self.frames) - 1, *sighting)

    def expect_rest(self, sigma: float) -> None:
        """The last two keyframes are at one place, to a 1-sigma in the unit of the path."""
        way = self.frames[-1].p - self.frames[-2].p
        for axis in np.eye(3):
            self._measure(axis, float(axis @ way), sigma)

    def _measure(self, axis: np.ndarray, residual: float, sigma: float) -> None:
        deviation = self._deviation()
        last = len(self.frames) - 1
        row = by_position_change(self.frames, last - 1, last, axis, len(deviation))
        self._prior.add(row, residual, sigma, deviation)

    def _deviation(self) -> np.ndarray:
        return self._prior.deviation(Poses.of(self.frames), self.lens.common)

    def set_unit(self) -> None:
        """The way between the last two keyframes is the unit of the path."""
        self._unit = (len(self.frames) - 2, len(self.frames) - 1)

    def _baseline(self) -> tuple[int, int] | None:
        """The longest way from the first keyframe: holding it fixed keeps steps small.

        None once the prior holds the scale, and as long as nothing has moved.
        """
        if self._unit is None:
            return None
        ways = [float(np.linalg.norm(frame.p - self.frames[0].p)) for frame in self.frames]
        return (0, int(np.argmax(ways))) if max(ways) > 0.0 else None

    # Points

    def places(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Homogeneous points ``X = R b + s p`` (N, 3), and their derivatives by s (N, 3)."""
        marks, poses = self.landmarks, Poses.of(self.frames)
        at = marks.anchor[rows]
        slot = marks.slot[at]
        rays = marks.rays[rows] + marks.ray_by_lens[rows] @ self.lens.change
        world = np.einsum("nij,nj->ni", poses.R[slot], rays)
        late, twist = self._late(at)[:, None], poses.twist[slot]
        base = poses.p[slot] + late * twist[:, 3:]
        world = world + late * cross(twist[:, :3], world)
        return world + marks.s[rows, None] * base, base

    def row_phase(self, pixels: np.ndarray) -> np.ndarray:
        """When the rows of pixels (N, 2) are read: from -1/2 to 1/2 of the read-out time."""
        return row_phase(pixels, self.size)

    def _late(self, observations: np.ndarray) -> np.ndarray:
        """When the rows of observations (N,) were read, s from the middle one."""
        return self.row_phase(self.landmarks.pixels[observations]) * self.lens.readout_s

    def triangulate(self) -> None:
        """Distances of points that the newest keyframe sees a second time."""
        marks, frame = self.landmarks, self.frames[-1]
        seen = marks.seen_from(len(self.frames) - 1)
        rows = marks.point[seen]
        new = ~marks.has_depth[rows] & (marks.anchor[rows] != seen)
        if not new.any():
            return
        seen, rows = seen[new], rows[new]
        far, base = self.places(rows)  # without a distance they are rays
        late = self._late(seen)[:, None]
        rays = (far - late * cross(np.broadcast_to(frame.twist[:3], far.shape), far)) @ frame.R
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        by_s = (base - frame.p - late * frame.twist[3:]) @ frame.R
        pixels, by_ray, by_lens = self.lens.pixels_of(rays)
        residual = pixels + by_lens @ self.lens.change - marks.pixels[seen]
        slope = np.einsum("nqi,ni->nq", by_ray, by_s)
        usable = np.isfinite(residual).all(axis=1) & np.isfinite(slope).all(axis=1)
        residual, slope = np.where(usable[:, None], (residual, slope), 0.0)
        variance = self._variances(
            marks.last[seen], marks.travelled[seen] - marks.travelled[marks.anchor[rows]]
        )
        information = np.sum(slope**2, axis=1) / (0.5 * (variance[:, 0] + variance[:, 2]))
        with np.errstate(divide="ignore", invalid="ignore"):
            likely = -np.sum(slope * residual, axis=1) / np.sum(slope**2, axis=1)
        likely = np.where(information > 0.0, likely, 0.0)
        typical = self._typical_inverse_depth(likely, information)
        ridge = 1.0 / (_DEPTH_SIGMA * typical) ** 2
        found = (information * likely + ridge * typical) / (information + ridge)
        marks.s[rows] = np.maximum(found, LEAST_INVERSE_DEPTH)
        marks.s_variance[rows] = 1.0 / (information + ridge)
        marks.has_depth[rows] = True

    def _typical_inverse_depth(self, likely: np.ndarray, information: np.ndarray) -> float:
        marks = self.landmarks
        known = marks.s[marks.has_depth & (marks.s > LEAST_INVERSE_DEPTH)]
        if len(known) < 20:
            known = likely[(likely > 0.0) & (likely**2 * information > _FIRM_PARALLAX**2)]
        if len(known) >= 8:
            return float(np.median(known))
        return 0.05 / max(float(np.linalg.norm(self.frames[-1].p - self.frames[-2].p)), 1e-9)

    def _variances(self, last: np.ndarray, travelled: np.ndarray) -> np.ndarray:
        """Covariances (N, 3) of residuals."""
        return self.variance_factor * NOISE.covariances(last, travelled)

    def variances_since(
        self, observations: np.ndarray, last: np.ndarray, travelled: np.ndarray
    ) -> np.ndarray:
        """Covariances (N, 3), px^2, of what residuals change by since earlier observations (N,)."""
        return self._variances(last, travelled - self.landmarks.travelled[observations])

    # The solution

    def solve(self, iterations: int) -> None:
        """Move everything to where it is likelier, by steps of Gauss and Newton."""
        if self.lens.is_stale():
            self.lens.relinearise()
            self.landmarks.take_rays()
        poses = Poses.of(self.frames)
        residuals = self._residuals(poses)
        linear, deviation = residuals.linear(poses), self._prior.deviation(poses, self.lens.common)
        cost = residuals.cost(linear) + self._prior.cost(deviation)
        normal, system = self._equations(residuals, linear, deviation)
        damping = _FIRST_DAMPING
        for iteration in range(iterations):
            if iteration:
                normal, system = self._equations(residuals, linear, deviation)
            for _ in range(_TRIES):
                before = self._state()
                self._move(solution(system, damping), normal)
                poses = Poses.of(self.frames)
                moved = residuals.linear(poses)
                moved_by = self._prior.deviation(poses, self.lens.common)
                moved_cost = residuals.cost(moved) + self._prior.cost(moved_by)
                if moved_cost <= cost:
                    linear, deviation, cost, damping = moved, moved_by, moved_cost, 0.1 * damping
                    break
                self._restore(before)
                damping *= _DAMPING_STEP
        self.cost = cost
        self._remember(linear, normal, system)

    def _equations(
        self, residuals: Residuals, linear: Linear, deviation: np.ndarray
    ) -> tuple[Normal, System]:
        """Of the observations, and of all that is known with the points eliminated."""
        normal = residuals.normal(linear, self.landmarks.has_depth)
        reduced = normal.reduced(self._depth_damping())
        return normal, self._whole(reduced, deviation, self._baseline())

    def _residuals(self, poses: Poses) -> Residuals:
        return Residuals(
            self.landmarks, self.lens, self.size, poses, self.variance_factor, self.design_effect
        )

    def pose_covariance(self) -> np.ndarray:
        """Covariance (7, 7) of ``[dtheta, dp, dlog_scale]`` of the newest keyframe, in the world.

        ``p_true = p + dp``; the scale is that of the baseline to it which is known best, or, where
        none stands out of its errors, as after a turn on the spot, of the last one that did.
        """
        count, newest = len(self.covariance), len(self.frames) - 1
        frame, at = self.frames[newest], 6 * newest
        unit = self._unit_variance if self._unit is None else self._variance_of_unit()
        rows = np.zeros((7, count))
        rows[:6, at : at + 6] = np.eye(6)
        rows[3:6, at : at + 3] = -so3.skew(frame.p)
        least = np.inf
        for slot, other in enumerate(self.frames[:-1]):
            way = frame.p - other.p
            length = float(np.linalg.norm(way))
            if length > 0.0:
                row = by_position_change(self.frames, slot, newest, way / length**2, count)
                variance = float(row @ self.covariance @ row)
                if variance < least:
                    least, rows[6] = variance, row
        is_measured = least < 1.0 / _SEEN_SIGMAS**2
        if is_measured:
            self._scale_variance = least
        else:
            rows[6] = 0.0
        by_unit = np.array([0.0, 0.0, 0.0, *(frame.p - self.origin), 1.0])
        covariance = rows @ self.covariance @ rows.T + unit * np.outer(by_unit, by_unit)
        if not is_measured:
            covariance[6, 6] += self._scale_variance
        return covariance

    def last_way(self) -> tuple[float, bool]:
        """Length between the last two keyframes, and whether it stands out of its errors."""
        way = self.frames[-1].p - self.frames[-2].p
        length, last = float(np.linalg.norm(way)), len(self.frames) - 1
        if length == 0.0:
            return 0.0, False
        row = by_position_change(self.frames, last - 1, last, way / length, len(self.covariance))
        return length, length**2 > _SEEN_SIGMAS**2 * float(row @ self.covariance @ row)

    def _variance_of_unit(self) -> float:
        """Variance of the logarithm of the way that is the unit, another one held fixed."""
        if self._unit is None:
            return 0.0
        row = self._by_way(self._unit)
        return float(row @ self.covariance @ row)

    def relative_pose(self, slot0: int, slot1: int) -> tuple[np.ndarray, np.ndarray]:
        """Motion ``cam1_from_cam0`` (4, 4) between two keyframes, and its covariance (6, 6).

        Of ``[dtheta, dt]`` in camera 1: ``R_true = Exp(dtheta) R``, ``t_true = t + dt``.
        """
        first, second = self.frames[slot0], self.frames[slot1]
        motion = np.eye(4)
        motion[:3, :3] = second.R.T @ first.R
        motion[:3, 3] = second.R.T @ (first.p - second.p)
        rows = np.zeros((6, len(self.covariance)))
        for slot, sign in ((slot0, 1.0), (slot1, -1.0)):
            rows[:, 6 * slot : 6 * slot + 6] += sign * np.eye(6)
            rows[3:, 6 * slot : 6 * slot + 3] -= sign * so3.skew(first.p)
        turned = np.kron(np.eye(2), second.R.T) @ rows
        return motion, turned @ self.covariance @ turned.T

    def _remember(self, linear: Linear, normal: Normal, system: System) -> None:
        """Residuals as they are after a solution, and covariances as in its last step."""
        marks, self._linear = self.landmarks, linear
        unseen = linear.residuals[:, :1] == UNSEEN_PX
        marks.residuals = np.where(unseen, 0.0, linear.residuals)
        marks.by_s = linear.by_s
        self.covariance = inverse(system.H)
        common = 1 + self.lens.size
        self.lens.covariance = self.covariance[-common:, -common:]
        with np.errstate(divide="ignore"):
            marks.s_variance = np.where(marks.has_depth, 1.0 / normal.point_h, np.inf)
        self._place_points(normal)
        free = 2 * normal.residuals - len(normal.g) - int(marks.has_depth.sum())
        if normal.residuals > _FEWEST_RESIDUALS:
            ratio = normal.squares / max(free, _FEWEST_RESIDUALS)
            factor = self.variance_factor * (_MEMORY + (1.0 - _MEMORY) * ratio)
            self.variance_factor = float(np.clip(factor, *_FACTOR_RANGE))
            seen = _LINEARISATION_EFFECT * normal.likeness
            effect = _MEMORY * self.design_effect + (1.0 - _MEMORY) * seen
            self.design_effect = float(np.clip(effect, *_EFFECT_RANGE))

    def _place_points(self, normal: Normal) -> None:
        """Tell of the points in view whether their distances stand out of their errors, or are far.

        With the errors of the poses, but for that of the scale: it may be a guess, by which
        distances are measured alike.
        """
        marks, newest = self.landmarks, len(self.frames) - 1
        spread = self.covariance
        ways = [float(np.linalg.norm(f.p - self.frames[-1].p)) for f in self.frames]
        if max(ways) > 0.0:
            # As if the longest way to the newest keyframe were known.
            row = self._by_way((int(np.argmax(ways)), newest))
            by_way = spread @ row
            spread = spread - np.outer(by_way, by_way) / (_GAUGE_SIGMA**2 + row @ by_way)
        rows = marks.point[marks.seen_from(newest)]
        rows = rows[normal.point_h[rows] > 0.0]
        variances = np.empty(len(rows))
        point_variances(rows, normal.coupling, normal.point_h, spread, variances)
        known = marks.s[marks.has_depth]
        typical = float(np.median(known)) if len(known) else 0.0
        largest = np.maximum(_PLACED_SIGMA * marks.s[rows], _FAR_SIGMA * typical)
        marks.is_placed[:] = False
        marks.is_placed[rows] = variances / self.design_effect < largest**2

    def _whole(self, system: System, deviation: np.ndarray, held: tuple[int, int] | None) -> System:
        """With the prior, and a way between two keyframes held: the scale is free else."""
        known = self._prior.at(deviation)
        H = system.H + known.H
        if held is not None:
            row = self._by_way(held) / _GAUGE_SIGMA
            H += np.outer(row, row)
        return System(H, system.g + known.g)

    def _by_way(self, slots: tuple[int, int]) -> np.ndarray:
        """Derivatives (D,) of the logarithm of the way between two keyframes."""
        way = self.frames[slots[1]].p - self.frames[slots[0]].p
        count = 6 * len(self.frames) + self.lens.size + 1
        return by_position_change(self.frames, *slots, way / float(way @ way), count)

    def _depth_damping(self) -> float:
        known = self.landmarks.s[self.landmarks.has_depth]
        return _DEPTH_DAMPING / float(np.median(known)) ** 2 if len(known) else 1.0

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
        typical = float(np.median(marks.s[marks.has_depth]))
        largest = _FARTHEST_GROWTH * np.maximum(marks.s, typical)
        moved = np.clip(marks.s + changes, LEAST_INVERSE_DEPTH, largest)
        marks.s = np.where(marks.has_depth, moved, marks.s)

    def _state(self) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray, np.ndarray, float]:
        poses = [(frame.R, frame.p) for frame in self.frames]
        return poses, self.landmarks.s, self.lens.z, self.lens.readout_s

    def _restore(
        self, state: tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray, np.ndarray, float]
    ) -> None:
        for frame, (R, p) in zip(self.frames, state[0], strict=True):
            frame.R, frame.p = R, p
        self.landmarks.s, self.lens.z, self.lens.readout_s = state[1:]

    # What leaves

    def remove(self, slot: int, alive: np.ndarray) -> Keyframe:
        """Take a keyframe out; what it tells of the others stays as a prior.

        With it go the points that have their rays there and are not ``alive`` (ids, ascending);
        those that are get their rays from the next keyframe that sees them. So do those that were
        seen once and are not alive: they tell nothing.
        """
        marks, frame = self.landmarks, self.frames[slot]
        if self._unit is not None:
            self._unit_variance = self._variance_of_unit()
        poses = Poses.of(self.frames)
        residuals = self._residuals(poses)
        linear = self._linear or residuals.linear(poses)
        is_anchored = marks.slot[marks.anchor] == slot
        is_alive = np.isin(marks.ids, alive)
        ended = is_anchored & ~is_alive
        reduced = residuals.normal(linear, ended & marks.has_depth).reduced(0.0)
        system = self._whole(reduced, self._deviation(), self._baseline())
        gone = ended | ~is_alive & (np.bincount(marks.point, minlength=len(marks.ids)) < 2)
        gone[self._change_anchors(np.flatnonzero(is_anchored & ~ended), slot)] = True
        marks.leave_out(gone, slot)
        del self.frames[slot]
        out = slice(6 * slot, 6 * slot + 6)
        self.covariance = np.delete(np.delete(self.covariance, out, axis=0), out, axis=1)
        self._prior.replace(system, slot, Poses.of(self.frames), self.lens.common)
        self._has_forgotten, self._unit, self._linear = True, None, None
        return frame

    def _change_anchors(self, rows: np.ndarray, slot: int) -> np.ndarray:
        """Give points their rays from another keyframe; those (rows) that get none."""
        marks = self.landmarks
        new = marks.next_anchors(rows, slot)
        rays, by_lens, seen = marks.seen_along(marks.pixels[new])
        seen &= new >= 0
        rest, rows, new = rows[~seen], rows[seen], new[seen]
        X, _ = self.places(rows)
        poses, at = Poses.of(self.frames), marks.slot[new]
        base = poses.p[at] + self._late(new)[:, None] * poses.twist[at, 3:]
        away = X - marks.s[rows, None] * base
        length = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        marks.s[rows] = np.maximum(marks.s[rows] / length, LEAST_INVERSE_DEPTH)
        marks.s_variance[rows] /= length**2
        marks.anchor[rows], marks.rays[rows], marks.ray_by_lens[rows] = (
            new,
            rays[seen],
            by_lens[seen],
        )
        # Residuals are counted from the new ray on.
        moved = np.full(len(marks.ids), -1)
        moved[rows] = np.arange(len(rows))
        which = moved[marks.point]
        of_moved = which >= 0
        first = new[which[of_moved]]
        marks.residuals[of_moved] -= marks.residuals[first]
        marks.by_s[of_moved] = (marks.by_s[of_moved] - marks.by_s[first]) * length[
            which[of_moved], None
        ]
        return rest
