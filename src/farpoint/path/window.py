"""A window over keyframes: their poses, the distances of points, lens and shutter, all together.

Residuals are in pixels. Errors of a track add up from match to match, so that what is compared is
the change of its residual from keyframe to keyframe, by Student's t with the covariances of its
matches. Distances are eliminated; keyframes that leave become a prior for those that stay.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy  # its parts load on first use

from farpoint._kernels.window import (
    UNSEEN_PX,
    expected_rays,
    gather_information,
    pixel_residuals,
    point_steps,
    robust_cost,
)
from farpoint.geometry import so3
from farpoint.path.keyframe import Keyframe
from farpoint.path.landmarks import Landmarks
from farpoint.path.lens import LensEstimate
from farpoint.path.prior import Prior, System, by_position_change
from farpoint.path.vectors import cross

__all__ = ["LEAST_INVERSE_DEPTH", "NOISE", "Window", "WindowNoise"]

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
_PATCHES = 4  # across the longer side of an image
_MEMORY = 0.8  # share of either that stays from keyframe to keyframe
_FEWEST_RESIDUALS = 50  # which tell it
_RIDGE = 1e-12  # relative, of a diagonal: what rounding makes of zero
_FIRST_DAMPING, _DAMPING_STEP, _TRIES = 1e-6, 100.0, 3
_DEPTH_DAMPING = 1e-3  # of a point's information, over that of the median distance squared
# New points whose parallax does not tell: about as far as others, 1-sigma in units of that.
_DEPTH_SIGMA = 2.0
_FIRM_PARALLAX = 5.0  # sigma
_SEEN_SIGMAS = 3.0  # a way that is not longer may be none
_PLACED_SIGMA = 0.25  # relative, of the distance of a point that others are measured by: 4 sigma
_FAR_SIGMA = 0.1  # of the inverse distance of a far one, in units of the median


class WindowNoise(NamedTuple):
    """What residuals are made of.

    Attributes
    ----------
    last, travelled : float
        Shares of the covariance of the last match, and of those since the last keyframe, summed.
    floor_px2 : float
        Added to both variances: repeated frames match without an error.
    """

    last: float = 0.5
    travelled: float = 0.5
    floor_px2: float = 0.03**2


NOISE = WindowNoise()


class _Linear(NamedTuple):
    """Residuals of all observations with their derivatives."""

    residuals: np.ndarray
    by_pose: np.ndarray
    by_common: np.ndarray
    by_s: np.ndarray


class _Normal(NamedTuple):
    """Normal equations of the observations: of poses and common unknowns, and of the points.

    ``squares`` is the sum of the weighted ones of so many ``residuals``, and ``likeness`` how many
    times larger sums of residuals over patches of images, and over tracks, vary than independent
    ones would.
    """

    H: np.ndarray
    g: np.ndarray
    coupling: np.ndarray
    point_h: np.ndarray
    point_g: np.ndarray
    squares: float
    residuals: int
    likeness: float

    def reduced(self, damping: float) -> System:
        """Of poses and common unknowns alone, the points eliminated."""
        total = self.point_h + damping
        seen = total > 0.0
        scaled = self.coupling[seen] / np.sqrt(total[seen])[:, None]
        shift = self.coupling[seen].T @ (self.point_g[seen] / total[seen])
        return System(self.H - scaled.T @ scaled, self.g - shift)


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
    origin : ndarray, shape (3,)
        Where the first keyframe is, which is taken as true.
    variance_factor : float
        Of the residuals' variances, as found.
    design_effect : float
        How many observations count as one, for their errors are alike: neighbours lie on the same
        things, and a track errs the same way again and again.
    """

    def __init__(self, lens: LensEstimate, size: tuple[int, int]) -> None:
        self.lens, self._size = lens, size
        self.frames: list[Keyframe] = []
        self.landmarks = Landmarks(lens)
        self.variance_factor = 1.0
        self.design_effect = _LINEARISATION_EFFECT * _FIRST_EFFECT
        self._prior = Prior(lens.common, lens.covariance)
        # Keyframes between which the unit lies, until the prior holds the scale.
        self._unit: tuple[int, int] | None = None
        self._unit_variance = self._scale_variance = 0.0
        self._has_forgotten = False
        self._next_serial = 0
        self.origin = np.zeros(3)
        self.covariance = lens.covariance
        self._linear: _Linear | None = None

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
        keyframe = Keyframe(
            serial=self._next_serial, frame=frame, timestamp=timestamp, R=R, p=p, twist=twist
        )
        self._next_serial += 1
        self.frames.append(keyframe)
        self._prior.add_pose(keyframe)
        if self._next_serial == 1:
            self._prior.fix_first(_POSE_SIGMA)
            self.origin = p
        self._linear = None
        return keyframe

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
        return self._prior.deviation(self.frames, self.lens.common)

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
        marks, R, p, twist = self.landmarks, *self._arrays()
        at = marks.anchor[rows]
        slot = self._slots()[at]
        rays = marks.rays[at] + marks.ray_by_lens[at] @ self.lens.change
        world = np.einsum("nij,nj->ni", R[slot], rays)
        late = (self.row_phase(marks.pixels[at]) * self.lens.readout_s)[:, None]
        base = p[slot] + late * twist[slot, 3:]
        world = world + late * cross(twist[slot, :3], world)
        return world + marks.s[rows, None] * base, base

    def row_phase(self, pixels: np.ndarray) -> np.ndarray:
        """When the rows of pixels (N, 2) are read: from -1/2 to 1/2 of the read-out time."""
        return pixels[:, 1] / max(self._size[1] - 1, 1) - 0.5

    def triangulate(self) -> None:
        """Distances of points that the newest keyframe sees a second time."""
        marks, frame = self.landmarks, self.frames[-1]
        seen = marks.seen_from(frame.serial)
        rows = marks.point[seen]
        new = ~marks.has_depth[rows] & (marks.anchor[rows] != seen)
        if not new.any():
            return
        seen, rows = seen[new], rows[new]
        far, base = self.places(rows)  # without a distance they are rays
        late = (self.row_phase(marks.pixels[seen]) * self.lens.readout_s)[:, None]
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
        floor = NOISE.floor_px2 * np.array([1.0, 0.0, 1.0])
        return self.variance_factor * (NOISE.last * last + NOISE.travelled * travelled + floor)

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
        offsets = self._offsets()
        linear = self._linearised(offsets)
        damping = _FIRST_DAMPING
        normal = system = None
        for _ in range(iterations):
            normal, cost = self._normal(linear, self.landmarks.has_depth), self._cost(linear)
            system = self._whole(normal.reduced(self._depth_damping()), self._baseline())
            for _ in range(_TRIES):
                step = _solution(system, damping)
                before = self._state()
                self._move(step, normal)
                moved = self._linearised(offsets)
                if self._cost(moved) <= cost:
                    linear, damping = moved, 0.1 * damping
                    break
                self._restore(before)
                damping *= _DAMPING_STEP
        self._remember(linear, normal, system)

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
        way = self.frames[self._unit[1]].p - self.frames[self._unit[0]].p
        square = float(way @ way)
        row = by_position_change(self.frames, *self._unit, way / square, len(self.covariance))
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

    def _remember(self, linear: _Linear, normal: _Normal | None, system: System | None) -> None:
        """Covariances and residuals as they are after a solution."""
        marks = self.landmarks
        self._linear = linear
        unseen = linear.residuals[:, :1] == UNSEEN_PX
        marks.residuals = np.where(unseen, 0.0, linear.residuals)
        marks.by_s = linear.by_s
        if normal is None or system is None:
            return
        self.covariance = _inverse(system.H)
        common = 1 + self.lens.size
        self.lens.covariance = self.covariance[-common:, -common:]
        with np.errstate(divide="ignore"):
            marks.s_variance = np.where(marks.has_depth, 1.0 / normal.point_h, np.inf)
        marks.is_placed = self._placed(system, normal)
        free = 2 * normal.residuals - len(normal.g) - int(marks.has_depth.sum())
        if normal.residuals > _FEWEST_RESIDUALS:
            ratio = normal.squares / max(free, _FEWEST_RESIDUALS)
            factor = self.variance_factor * (_MEMORY + (1.0 - _MEMORY) * ratio)
            self.variance_factor = float(np.clip(factor, *_FACTOR_RANGE))
            seen = _LINEARISATION_EFFECT * normal.likeness
            effect = _MEMORY * self.design_effect + (1.0 - _MEMORY) * seen
            self.design_effect = float(np.clip(effect, *_EFFECT_RANGE))

    def _placed(self, system: System, normal: _Normal) -> np.ndarray:
        """Points (M,) whose distances stand out of their errors, or that are far for certain.

        With the errors of the poses, but for that of the scale: it may be a guess, by which
        distances are measured alike.
        """
        marks, newest = self.landmarks, len(self.frames) - 1
        ways = [float(np.linalg.norm(f.p - self.frames[-1].p)) for f in self.frames]
        held = (int(np.argmax(ways)), newest) if max(ways) > 0.0 else None
        spread = _inverse(system.H + self._gauge(held))
        with np.errstate(divide="ignore", invalid="ignore"):
            rows = normal.coupling / normal.point_h[:, None]
            by_poses = np.sum((rows @ spread) * rows, axis=1)
            variance = (1.0 / normal.point_h + by_poses) / self.design_effect
        known = marks.s[marks.has_depth]
        typical = float(np.median(known)) if len(known) else 0.0
        largest = np.maximum(_PLACED_SIGMA * marks.s, _FAR_SIGMA * typical)
        return marks.has_depth & (variance < largest**2)

    def _offsets(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """The lens where points are expected: rays, pixels less the found ones, derivatives."""
        marks = self.landmarks
        rays = np.empty((len(marks.point), 3))
        R, p, twist = self._arrays()
        expected_rays(
            R, p, twist, self.lens.readout_s, self.lens.change, self._slots(), marks.point,
            self.row_phase(marks.pixels), marks.rays, marks.ray_by_lens, marks.anchor, marks.s,
            rays,
        )  # fmt: skip
        pixels, by_ray, by_lens = self.lens.pixels_of(rays)
        offsets = pixels - marks.pixels
        unseen = ~(
            np.isfinite(offsets).all(axis=1)
            & np.isfinite(by_ray).all(axis=(1, 2))
            & np.isfinite(by_lens).all(axis=(1, 2))
        )
        rays[unseen], offsets[unseen], by_ray[unseen], by_lens[unseen] = 0.0, 0.0, 0.0, 0.0
        return rays, offsets, by_ray, by_lens

    def _linearised(self, at: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]) -> _Linear:
        marks, count, common = self.landmarks, len(self.landmarks.point), self.lens.size + 1
        linear = _Linear(
            np.empty((count, 2)), np.empty((count, 2, 6)), np.empty((count, 2, common)),
            np.zeros((count, 2)),
        )  # fmt: skip
        R, p, twist = self._arrays()
        pixel_residuals(
            R, p, twist, self.lens.readout_s, self.lens.change, self._slots(), marks.point,
            self.row_phase(marks.pixels), marks.rays, marks.ray_by_lens, *at, marks.anchor, marks.s,
            marks.has_depth, *linear,
        )  # fmt: skip
        return linear

    def _noise(self) -> np.ndarray:
        return np.array([NOISE.last, NOISE.travelled, NOISE.floor_px2, self.variance_factor])

    def _normal(self, linear: _Linear, used: np.ndarray) -> _Normal:
        """Normal equations of the observations of the points that a mask (M,) marks."""
        marks = self.landmarks
        count, points = 6 * len(self.frames) + self.lens.size + 1, len(marks.ids)
        H, g, coupling = np.zeros((count, count)), np.zeros(count), np.zeros((points, count))
        point_h, point_g = np.zeros(points), np.zeros(points)
        patches, patch = self._patches()
        patch_sums, point_sums = np.zeros((patches, 2)), np.zeros((points, 2))
        squares, influence, taken = gather_information(
            self._slots(), marks.point, marks.last, marks.travelled, marks.anchor, used,
            self._noise(), *linear, patch, np.empty(points, np.int64), H, g, coupling, point_h,
            point_g, patch_sums, point_sums,
        )  # fmt: skip
        for array in (H, g, coupling, point_h, point_g):
            array /= self.design_effect
        likeness = 1.0
        if influence > 0.0:
            along = max(float(np.sum(point_sums**2)) / influence, 1.0)
            likeness = along * max(float(np.sum(patch_sums**2)) / influence, 1.0)
        return _Normal(H, g, coupling, point_h, point_g, squares, taken, likeness)

    def _patches(self) -> tuple[int, np.ndarray]:
        """How many patches all images have, and in which the observations (N,) are."""
        width, height = self._size
        side = max(width, height) / _PATCHES
        across, down = math.ceil(width / side), math.ceil(height / side)
        column, row = (self.landmarks.pixels // side).astype(np.int64).T
        place = row.clip(0, down - 1) * across + column.clip(0, across - 1)
        return len(self.frames) * across * down, self._slots() * (across * down) + place

    def _whole(self, system: System, held: tuple[int, int] | None) -> System:
        """With the prior, and a way between two keyframes held."""
        known = self._prior.at(self._deviation())
        return System(system.H + known.H + self._gauge(held), system.g + known.g)

    def _gauge(self, held: tuple[int, int] | None) -> np.ndarray:
        """Information (D, D) that holds the way between two keyframes: the scale is free else."""
        count = 6 * len(self.frames) + self.lens.size + 1
        if held is None:
            return np.zeros((count, count))
        way = self.frames[held[1]].p - self.frames[held[0]].p
        length = float(np.linalg.norm(way))
        row = by_position_change(self.frames, *held, way / length, count)
        return np.outer(row, row) / (_GAUGE_SIGMA * length) ** 2

    def _cost(self, linear: _Linear) -> float:
        marks = self.landmarks
        cost = robust_cost(
            marks.point, marks.last, marks.travelled, marks.anchor, marks.has_depth, self._noise(),
            linear.residuals, np.empty(len(marks.ids), np.int64),
        )  # fmt: skip
        return cost / self.design_effect + self._prior.cost(self._deviation())

    def _depth_damping(self) -> float:
        known = self.landmarks.s[self.landmarks.has_depth]
        return _DEPTH_DAMPING / float(np.median(known)) ** 2 if len(known) else 1.0

    def _move(self, step: np.ndarray, normal: _Normal) -> None:
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

    def _arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return (
            np.array([frame.R for frame in self.frames]),
            np.array([frame.p for frame in self.frames]),
            np.array([frame.twist for frame in self.frames]),
        )

    def _slots(self) -> np.ndarray:
        serials = np.array([frame.serial for frame in self.frames])
        return np.searchsorted(serials, self.landmarks.serial)

    # What leaves

    def remove(self, slot: int, alive: np.ndarray) -> Keyframe:
        """Take a keyframe out; what it tells of the others stays as a prior.

        With it go the points that have their rays there and are not ``alive`` (ids, ascending);
        those that are get their rays from the next keyframe that sees them.
        """
        marks, frame = self.landmarks, self.frames[slot]
        if self._unit is not None:
            self._unit_variance = self._variance_of_unit()
        linear = self._linear or self._linearised(self._offsets())
        is_anchored = marks.serial[marks.anchor] == frame.serial
        ended = is_anchored & ~np.isin(marks.ids, alive)
        used = ended & marks.has_depth
        system = self._whole(self._normal(linear, used).reduced(0.0), self._baseline())
        gone = ended.copy()
        gone[self._change_anchors(np.flatnonzero(is_anchored & ~ended), frame.serial)] = True
        marks.keep(~gone, marks.serial != frame.serial)
        del self.frames[slot]
        out = slice(6 * slot, 6 * slot + 6)
        self.covariance = np.delete(np.delete(self.covariance, out, axis=0), out, axis=1)
        self._prior.replace(system, slot, self.frames, self.lens.common)
        self._has_forgotten, self._unit, self._linear = True, None, None
        return frame

    def forget_lonely(self, alive: np.ndarray) -> None:
        """Drop points that were seen once and are not ``alive``."""
        marks = self.landmarks
        lonely = np.bincount(marks.point, minlength=len(marks.ids)) < 2
        marks.keep(~lonely | np.isin(marks.ids, alive))
        self._linear = None

    def _change_anchors(self, rows: np.ndarray, serial: int) -> np.ndarray:
        """Give points their rays from another keyframe; those (rows) that no other one sees."""
        marks = self.landmarks
        new = marks.next_anchors(rows, serial)
        rest, rows, new = rows[new < 0], rows[new >= 0], new[new >= 0]
        X, _ = self.places(rows)
        _, p, twist = self._arrays()
        slot = self._slots()[new]
        late = (self.row_phase(marks.pixels[new]) * self.lens.readout_s)[:, None]
        away = X - marks.s[rows, None] * (p[slot] + late * twist[slot, 3:])
        length = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        marks.s[rows] = np.maximum(marks.s[rows] / length, LEAST_INVERSE_DEPTH)
        marks.s_variance[rows] /= length**2
        marks.anchor[rows] = new
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


def _solution(system: System, damping: float) -> np.ndarray:
    """Step (D,) of a damped system; zero where there is none."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(system.H), 1e-300))
    scaled = system.H * np.outer(unit, unit)
    scaled[np.diag_indices(len(unit))] += damping
    try:
        factor = scipy.linalg.cho_factor(scaled)
    except (np.linalg.LinAlgError, ValueError):  # not positive, or not finite
        return np.zeros(len(unit))
    return -unit * scipy.linalg.cho_solve(factor, unit * system.g)


def _inverse(H: np.ndarray) -> np.ndarray:
    """Of an information matrix whose diagonal spans many orders."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    scaled = H * np.outer(unit, unit)
    scaled[np.diag_indices(len(unit))] += _RIDGE
    try:
        factor = scipy.linalg.cho_factor(scaled)
    except (np.linalg.LinAlgError, ValueError):  # not positive, or not finite
        return np.linalg.pinv(np.nan_to_num(scaled), hermitian=True) * np.outer(unit, unit)
    return scipy.linalg.cho_solve(factor, np.eye(len(unit))) * np.outer(unit, unit)
