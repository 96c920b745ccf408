"""The path of the camera: frames are located by known points, keyframes are solved together."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry import so3
from farpoint.geometry.sphere import tangent_basis
from farpoint.path.history import Sighting, TrackHistory
from farpoint.path.information import inverse
from farpoint.path.keyframe import Keyframe
from farpoint.path.lens import LensEstimate, LensReport
from farpoint.path.options import LensRefinementOptions, PathOptions
from farpoint.path.point import PathPoint, Rest, SettledPose
from farpoint.path.resection import Located, locate_frame
from farpoint.path.selection import least_useful, some_of
from farpoint.path.waiting import WaitingPoses, pose_matrix
from farpoint.path.window import Window
from farpoint.pose import PoseStatus, RelativePose, TrackLabel
from farpoint.tracks import Tracks

__all__ = ["Pair", "PathBuilder"]

Estimate = Callable[[np.ndarray, np.ndarray, np.ndarray, float], RelativePose]

_FIRST_ITERATIONS = 6  # of the first solutions, which start from two views
_ITERATIONS = 1  # afterwards: each keyframe moves the others little
_UNKNOWN_WAY = 2.0  # 1-sigma of a way before the first length, in units of that
_FIRM_FLOW = 0.5  # of what makes a keyframe: the window begins anew with a way of that flow
_FIT_CHI2 = 13.8  # squared residual that 0.999 of right matches stay below (2 degrees of freedom)
_EVIDENCE = 2.0  # log likelihood, by which one of two motions must be likelier to be the right one
_AGREE_CHI2 = 20.5  # squared difference of poses that 0.999 stay below (5 degrees of freedom)
_REST_CHI2 = 11.3  # the same for 0.99 of displacements of a camera at rest (3 of them)


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Which frames a motion is between.

    Attributes
    ----------
    frame0, frame1 : int
        Their indices.
    time0, time1 : float
        Seconds.
    """

    frame0: int
    frame1: int
    time0: float
    time1: float

    @property
    def seconds(self) -> float:
        """Time between the two."""
        return self.time1 - self.time0


class _Step(NamedTuple):
    """A motion, and its tracks in both frames; ``is_good`` marks those that are not outliers."""

    before: Sighting
    now: Sighting
    is_good: np.ndarray
    motion: RelativePose
    pair: Pair

    @property
    def good(self) -> Sighting:
        """The good tracks in the second frame."""
        return self.now.select(self.is_good)


class PathBuilder:
    """Strings motions of consecutive frames together, on one scale.

    The first observable motion sets the unit. From then on a frame is located by the points whose
    distances the window knows; where tracks have moved far, or are lost, it becomes a keyframe, and
    all keyframes of the window, the distances, lens and shutter are solved together. Where nothing
    known is in view the camera's last speed carries the scale, which is then as unsure as that.

    Cost and memory for a frame do not depend on the number of frames.

    Parameters
    ----------
    estimate : callable
        Motion of the camera from matches of two frames: pixels (N, 2) in each, and covariances
        (N, 2, 2), px^2, of their displacements; and seconds between the two.
    options : PathOptions
        Of the window.
    lens_options : LensRefinementOptions
        How far the lens may be off.
    """

    def __init__(
        self, estimate: Estimate, options: PathOptions, lens_options: LensRefinementOptions
    ) -> None:
        self._estimate, self._options, self._lens_options = estimate, options, lens_options
        self._lens: LensEstimate | None = None
        self._waiting = WaitingPoses()
        self._segment = 0
        self._R, self._p = np.eye(3), np.zeros(3)
        self._speed: float | None = None  # units a second
        self._begin_segment()

    def _begin_segment(self) -> None:
        self._history = TrackHistory()
        # Covariance (7, 7) of where the window begins, the scale that is guessed there included.
        self._base, self._base_p = np.zeros((7, 7)), self._p
        self._forget_window()

    def _forget_window(self) -> None:
        self._window: Window | None = None
        self._key_sighting: Sighting | None = None
        self._first: Sighting | None = None  # by the first keyframe, until a long way from it
        self._new_keyframe: Keyframe | None = None
        self._is_key, self._has_scale = False, False
        self._twist = self._twist_before = np.zeros(6)
        self._turned: tuple[Keyframe, np.ndarray, np.ndarray, np.ndarray] | None = None
        self._key_covariance = np.zeros((7, 7))  # of the newest keyframe, as last solved
        self._key_p = self._p  # where it was then
        self._own = np.zeros((6, 6))  # of the pose now, the window's points as they are
        self._step = np.zeros((6, 6))  # of the last step, which a solution has not changed

    @property
    def now(self) -> PathPoint:
        """Where the camera was last seen; without a motion."""
        return PathPoint(
            world_from_cam=pose_matrix(self._R, self._p),
            covariance=self._covariance(),
            segment=self._segment,
        )

    @property
    def lens(self) -> LensEstimate | None:
        """What was found of the lens; None before the first motion."""
        return self._lens

    def report(self) -> LensReport | None:
        """The same, for a person; None before the first motion."""
        return None if self._lens is None else self._lens.report()

    def break_off(self) -> PathPoint:
        """Begin a new segment where the last one ended: nothing connects the two."""
        self._waiting.settle_all()
        self._segment += 1
        self._begin_segment()
        return self.now

    def pass_over(self, frame: int, timestamp: float) -> None:
        """A frame of which nothing is known: the camera is where it was."""
        self._wait(frame, timestamp)

    def relative_pose(self, frame0: int, frame1: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Motion between two keyframes of the window and its covariance; None where one is not.

        Returns
        -------
        cam1_from_cam0 : ndarray, shape (4, 4)
        covariance : ndarray, shape (6, 6)
            Of ``[dtheta, dt]`` in camera 1: ``R_true = Exp(dtheta) R``, ``t_true = t + dt``, in rad
            and units of the path, the errors of lens and shutter included.
        """
        if self._window is None:
            return None
        slots = {frame.frame: slot for slot, frame in enumerate(self._window.frames)}
        if frame0 not in slots or frame1 not in slots:
            return None
        return self._window.relative_pose(slots[frame0], slots[frame1])

    def add(self, camera: Camera, tracks: Tracks, motion: RelativePose, pair: Pair) -> PathPoint:
        """Add a motion from the last frame to the next, of any status but FAILED.

        Parameters
        ----------
        camera : Camera
            As given, of all frames.
        tracks : Tracks
            The matches behind the motion.
        motion : RelativePose
            What they say.
        pair : Pair
            The two frames.
        """
        before, now = self._history.follow(tracks)
        window = self._window_of(camera, pair)
        self._complete_keyframe(window, before)
        is_good = (motion.labels != TrackLabel.OUTLIER)[self._history.order]
        step = _Step(before, now, is_good, motion, pair)
        return self._go_on(window, step) if self._has_scale else self._start(window, step)

    def settled(self) -> list[SettledPose]:
        """Poses that change no more, in the order of their frames, each given once."""
        return self._waiting.settled()

    def remaining(self) -> list[SettledPose]:
        """All poses that have not been given yet, as they are now."""
        self._waiting.settle_all()
        return self._waiting.settled()

    # The beginning

    def _window_of(self, camera: Camera, pair: Pair) -> Window:
        if self._window is None:
            if self._lens is None:
                self._lens = LensEstimate(camera, self._lens_options, pair.seconds)
            assert camera.size is not None
            self._window = Window(self._lens, camera.size)
            self._new_keyframe = self._window.add(
                pair.frame0, pair.time0, self._R, self._p, np.zeros(6)
            )
            self._is_key = True
        return self._window

    def _start(self, window: Window, step: _Step) -> PathPoint:
        """Until a motion since the last keyframe is observable: its length is the unit."""
        motion, pair, now = step.motion, step.pair, step.now
        assert motion.rotation_cam1_from_cam0 is not None
        key, good = window.frames[-1], step.good
        seconds = pair.time1 - key.timestamp
        since_key = motion
        if key.frame != pair.frame0:
            assert self._key_sighting is not None
            since_key = self._since(self._key_sighting, good, seconds)
        R, p = self._R @ motion.rotation_cam1_from_cam0.T, self._p
        last_p = p
        if since_key.status is PoseStatus.OK:
            assert since_key.rotation_cam1_from_cam0 is not None
            R = key.R @ since_key.rotation_cam1_from_cam0.T
            p = key.p + self._unit(seconds) * (key.R @ since_key.heading_cam0)
            self._has_scale = True
        self._move_to(R, p, pair.seconds)
        rotation = motion.rotation_covariance
        self._own[:3, :3] += R @ (np.zeros((3, 3)) if rotation is None else rotation) @ R.T
        if self._has_scale:
            if not self._has_moved(self._key_sighting, now, _FIRM_FLOW):
                self._first = self._key_sighting
            self._add_keyframe(window, good, pair)
            window.set_unit()
            window.triangulate()
            self._solve(window, motion)
            # The unit itself has no error.
            self._key_covariance[6], self._key_covariance[:, 6] = 0.0, 0.0
        elif motion.status is not PoseStatus.STATIC:
            # Nobody knows how far the camera went.
            self._own[3:, 3:] += (_UNKNOWN_WAY * self._unit(pair.seconds)) ** 2 * np.eye(3)
        if not self._has_scale and self._has_moved(self._key_sighting, now, 2.0):
            self._add_keyframe(window, good, pair)
            window.expect_rest(_UNKNOWN_WAY)
            while len(window) > self._options.keyframes:
                self._waiting.settle(window.remove(0, good.ids))
        return self._point(pair, motion, None, last_p)

    def _unit(self, seconds: float) -> float:
        """Length of a segment's first way: the unit, or what the last segment's speed suggests."""
        return 1.0 if self._speed is None or seconds <= 0.0 else self._speed * seconds

    def _since(self, before: Sighting, seen: Sighting, seconds: float) -> RelativePose:
        """Motion since tracks were seen, by those that are still seen."""
        rows = before.rows_of(seen.ids)
        both = seen.select(rows >= 0)
        uu, uv, vv = both.travelled.T
        covariances = np.stack([uu, uv, uv, vv], axis=1).reshape(-1, 2, 2)
        return self._estimate(before.pixels[rows[rows >= 0]], both.pixels, covariances, seconds)

    def _begin_firmly(self, window: Window, step: _Step) -> None:
        """Begin the window anew with two views of firm flow, where these deny the path so far.

        The first motion that seems observable may be a wrong one of two that short flow allows.
        Both are tried on these views, with the lens and the shutter free: if the later one is not
        the less likely, and is another than the path's, it counts.
        The length stays as found, and its error is one of the scale.
        """
        before, self._first = self._first, None
        first = window.frames[0]
        assert before is not None
        since = self._since(before, step.good, step.pair.time1 - first.timestamp)
        way = self._p - first.p
        length = float(np.linalg.norm(way))
        if window.has_forgotten or length == 0.0 or since.status is not PoseStatus.OK:
            return
        assert since.rotation_cam1_from_cam0 is not None
        R = first.R @ since.rotation_cam1_from_cam0.T
        p = first.p + length * (first.R @ since.heading_cam0)
        so_far, anew = (
            self._two_views(window, before, step, pose) for pose in ((self._R, self._p), (R, p))
        )
        if anew.cost > so_far.cost + _EVIDENCE or self._agrees(anew):
            return
        self._base[6, 6] += way @ self._covariance_within()[3:6, 3:6] @ way / length**4
        self._waiting.settle_all()
        self._window, self._lens = anew, anew.lens
        self._key_sighting, self._new_keyframe, self._is_key = step.good, anew.frames[-1], True
        self._solve(anew, step.motion)
        self._key_covariance[6], self._key_covariance[:, 6] = 0.0, 0.0

    def _agrees(self, views: Window) -> bool:
        """Whether the motion of two views, whose length is held, is that of the path."""
        motion, covariance = views.relative_pose(0, 1)
        first, length = views.frames[0], float(np.linalg.norm(motion[:3, 3]))
        turn = so3.log(self._R.T @ first.R @ motion[:3, :3].T)
        away = self._R.T @ (first.p - self._p) - motion[:3, 3]
        across = np.zeros((5, 6))
        across[:3, :3], across[3:, 3:] = np.eye(3), tangent_basis(motion[:3, 3] / length).T
        off = across @ np.concatenate([turn, away])
        return bool(off @ inverse(across @ covariance @ across.T) @ off < _AGREE_CHI2)

    def _two_views(
        self, window: Window, before: Sighting, step: _Step, pose: tuple[np.ndarray, np.ndarray]
    ) -> Window:
        """A window of the first keyframe and this frame alone, solved from a pose of the latter."""
        first, pair, most = window.frames[0], step.pair, self._options.max_tracks
        lens = LensEstimate(window.lens.given, self._lens_options, pair.seconds)
        views = Window(lens, window.size)
        for frame, time, at, twist, seen in (
            (first.frame, first.timestamp, (first.R, first.p), first.twist, before),
            (pair.frame1, pair.time1, pose, self._twist, step.good),
        ):
            views.add(frame, time, *at, twist)
            views.see(some_of(seen, views.landmarks, most))
        views.set_unit()
        views.triangulate()
        views.solve(_FIRST_ITERATIONS)
        return views

    # Afterwards

    def _go_on(self, window: Window, step: _Step) -> PathPoint:
        motion, pair, now, is_good = step.motion, step.pair, step.now, step.is_good
        assert motion.rotation_cam1_from_cam0 is not None
        R = self._R @ motion.rotation_cam1_from_cam0.T
        # From where the last motion leads: ten sigma of doubt reach back to where it began.
        goes_on = motion.status is PoseStatus.OK
        start = self._p + self._twist[3:] * pair.seconds if goes_on else self._p
        last = self._R, self._p
        located = locate_frame(window, now, last, R, start, pair.seconds)
        if located is None or not self._carries_scale(window, located, pair.seconds):
            if motion.status is PoseStatus.OK and self._speed is not None and pair.seconds > 0.0:
                return self._guess(window, step)
            located = None
        is_key = self._has_moved(self._key_sighting, now, 1.0)
        p = self._p
        if located is not None:
            R, p = located.R, located.p
        rest = None if located is None else self._rest(window, now, motion, located)
        self._move_to(R, p, pair.seconds)
        if is_key:
            fits = (
                is_good
                if located is None
                else is_good | np.isin(now.ids, located.fitting(_FIT_CHI2))
            )
            self._add_keyframe(window, now.select(fits), pair)
            if located is None:
                window.expect_rest(max((self._speed or 1.0) * max(pair.seconds, 0.0), 1e-3))
            window.triangulate()
            self._solve(window, motion)
        elif located is not None:
            self._own = located.covariance
        else:
            self._own = self._lost(motion, pair.seconds)
        if self._first is not None and self._has_moved(self._first, now, _FIRM_FLOW):
            self._begin_firmly(window, step)
        point = self._point(pair, motion, located, last[1])
        return point if rest is None else replace(point, rest=rest, scale=None, scale_sigma=None)

    def _carries_scale(self, window: Window, located: Located, seconds: float) -> bool:
        """Whether known points tell a way better than the last speed would."""
        ways = [float(np.linalg.norm(frame.p - self._p)) for frame in window.frames]
        known = max(*ways, (self._speed or 0.0) * seconds)
        sigma = float(np.sqrt(np.trace(located.covariance[3:, 3:]) / 3.0))
        return sigma < self._options.speed_ratio_sigma * known

    def _guess(self, window: Window, step: _Step) -> PathPoint:
        """Go on from the last frame in a window of its own, whose unit the last speed suggests."""
        self._waiting.settle_all()
        self._base, self._base_p = self._covariance(), self._p
        self._base[6, 6] += self._options.speed_ratio_sigma**2
        self._forget_window()
        fresh = self._window_of(window.lens.given, step.pair)
        self._complete_keyframe(fresh, step.before)
        return replace(self._start(fresh, step), scale_is_guessed=True)

    def _lost(self, motion: RelativePose, seconds: float) -> np.ndarray:
        """Covariance (6, 6) of the pose since the keyframe, where the last step is not known."""
        own, way = self._own.copy(), (self._speed or 0.0) * seconds
        if motion.rotation_covariance is not None:
            own[:3, :3] += self._R @ motion.rotation_covariance @ self._R.T
        own[3:, 3:] += way**2 * np.eye(3)
        return own

    def _rest(
        self, window: Window, now: Sighting, motion: RelativePose, located: Located
    ) -> Rest | None:
        """What known points tell where they deny a way that other matches make up.

        Most of the matches with a parallax are then of things that move by themselves: they have no
        known place, or do not fit it.
        """
        if motion.status is not PoseStatus.OK:
            return None
        way = located.p - self._p
        # Of this frame and the last one, as if no errors were alike: a doubt is no rest.
        spread = 2.0 / window.design_effect * located.covariance
        if way @ np.linalg.pinv(spread[3:, 3:], hermitian=True) @ way > _REST_CHI2:
            return None
        near = now.ids[motion.labels[self._history.order] == TrackLabel.NEAR]
        fitting = located.fitting(_FIT_CHI2)
        if (
            not len(near)
            or np.isin(near, fitting).mean() > 0.5
            or 2 * len(fitting) < len(located.ids)
        ):
            return None
        return Rest(
            rotation_cam1_from_cam0=located.R.T @ self._R,
            rotation_covariance=located.R.T @ spread[:3, :3] @ located.R,
            points=len(fitting),
        )

    # Keyframes

    def _has_moved(self, before: Sighting | None, now: Sighting, share: float) -> bool:
        """Whether tracks have moved by a share of what makes a keyframe, or too many are lost."""
        assert before is not None
        rows = before.rows_of(now.ids)
        both = rows >= 0
        if not both.any() or both.sum() < self._options.keyframe_share * len(before.ids):
            return True
        flow = np.linalg.norm(now.pixels[both] - before.pixels[rows[both]], axis=1)
        return bool(np.median(flow) > share * self._options.keyframe_flow_px)

    def _add_keyframe(self, window: Window, seen: Sighting, pair: Pair) -> None:
        keyframe = window.add(pair.frame1, pair.time1, self._R, self._p, self._twist)
        window.see(some_of(seen, window.landmarks, self._options.max_tracks))
        self._key_sighting, self._new_keyframe, self._is_key = seen, keyframe, True

    def _complete_keyframe(self, window: Window, before: Sighting) -> None:
        """Give the last keyframe the tracks that begin there: its next match tells them."""
        if not self._is_key:
            return
        self._is_key = False
        key = self._key_sighting
        fresh = before if key is None else before.select(key.rows_of(before.ids) < 0)
        if not len(fresh.ids):
            return
        window.see(some_of(fresh, window.landmarks, self._options.max_tracks))
        if key is not None:
            joined = Sighting(*(np.concatenate(parts) for parts in zip(key, fresh, strict=True)))
            fresh = joined.select(np.argsort(joined.ids))
        self._key_sighting = fresh

    def _solve(self, window: Window, motion: RelativePose) -> None:
        window.solve(_ITERATIONS if window.has_forgotten else _FIRST_ITERATIONS)
        self._key_covariance = window.pose_covariance()
        while len(window) > self._options.keyframes:
            alive = self._history.now.ids
            self._waiting.settle(window.remove(least_useful(window, alive), alive))
        newest = window.frames[-1]
        seconds = newest.timestamp - window.frames[-2].timestamp
        way, is_seen = window.last_way()
        if is_seen and seconds > 0.0 and motion.status is PoseStatus.OK:
            self._speed = way / seconds
        self._R, self._p, self._own = newest.R, newest.p, np.zeros((6, 6))
        self._key_p = newest.p

    def _move_to(self, R: np.ndarray, p: np.ndarray, seconds: float) -> None:
        twist = np.zeros(6)
        if seconds > 0.0:
            twist = np.concatenate([so3.log(R @ self._R.T), p - self._p]) / seconds
        keyframe, self._new_keyframe = self._new_keyframe, None
        if self._turned is not None:
            turned, before2, before, after = self._turned
            turned.twist, self._turned = _between(before2, before, after, twist), None
        if keyframe is not None:
            # Its velocity is the mean of those before and after it; the first one has none before.
            is_first, last = not keyframe.twist.any(), self._twist
            keyframe.twist = twist if is_first else 0.5 * (last + twist)
            if self._twist_before.any():
                self._turned = keyframe, self._twist_before, last, twist
        self._R, self._p, self._twist, self._twist_before = R, p, twist, self._twist

    # What is told of a frame

    def _point(
        self,
        pair: Pair,
        motion: RelativePose,
        located: Located | None,
        last_p: np.ndarray,
    ) -> PathPoint:
        before, self._step = self._step, np.zeros((6, 6)) if located is None else located.covariance
        self._wait(pair.frame1, pair.time1)
        covariance, scale, sigma = self._covariance(), None, None
        if self._has_scale and motion.status is PoseStatus.OK:
            way = self._p - last_p
            scale = float(np.linalg.norm(way))
            axis = way / max(scale, 1e-300)
            own = float(axis @ (before + self._step)[3:, 3:] @ axis)
            sigma = math.sqrt(own + scale**2 * float(covariance[6, 6]))
        return PathPoint(
            world_from_cam=pose_matrix(self._R, self._p),
            covariance=covariance,
            segment=self._segment,
            scale=scale,
            scale_sigma=sigma,
            fitting=None if located is None else located.fitting(_FIT_CHI2),
        )

    def _covariance(self) -> np.ndarray:
        """Covariance (7, 7) of the pose: of the window's beginning, and within the window.

        The way since the window began errs by what its unit does.
        """
        way = self._p - self._base_p
        by_base = np.eye(7)
        by_base[3:6, :3], by_base[3:6, 6] = -so3.skew(way), way
        return self._covariance_within() + by_base @ self._base @ by_base.T

    def _covariance_within(self) -> np.ndarray:
        """Covariance (7, 7) of the pose in its window: of the newest keyframe, and its own."""
        by_key = np.eye(7)
        by_key[3:6, :3] = -so3.skew(self._p - self._key_p)
        covariance = by_key @ self._key_covariance @ by_key.T
        covariance[:6, :6] += self._own
        return covariance

    def _wait(self, frame: int, timestamp: float) -> None:
        self._waiting.add(
            None if self._window is None else self._window.frames[-1],
            frame=frame,
            timestamp=timestamp,
            segment=self._segment,
            R=self._R,
            p=self._p,
            covariance=self._covariance(),
        )


def _between(
    before2: np.ndarray, before: np.ndarray, after: np.ndarray, after2: np.ndarray
) -> np.ndarray:
    """Velocity at a time from its means over the two intervals before and the two after it.

    Exact for polynomials of third degree. The mean of the inner two alone is smaller than what
    oscillates; a read-out that explains the same shear by less velocity would be larger.
    """
    return (7.0 * (before + after) - (before2 + after2)) / 12.0
