"""The camera path: resection of frames, and bundle adjustment of keyframes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.geometry import so3
from farpoint.geometry.vectors import median
from farpoint.path.constants import (
    CHI2_P99_OF_3,
    CHI2_P999_OF_2,
    FIRST_ITERATIONS,
    LATER_ITERATIONS,
    NEXT_ATTEMPT_FLOW_RATIO,
    RELIABLE_FLOW_SHARE,
    UNKNOWN_LENGTH_SIGMA,
)
from farpoint.path.first_motion import WindowView, contradicting_motion
from farpoint.path.history import TrackHistory, TrackObservations
from farpoint.path.keyframe import Keyframe
from farpoint.path.lens import LensEstimate, LensReport
from farpoint.path.options import LensRefinementOptions, PathOptions
from farpoint.path.pending import Correction, PendingPoses, pose_matrix
from farpoint.path.point import FinalPose, PathPoint, Rest
from farpoint.path.resection import Located, locate_frame
from farpoint.path.second_order import second_order_variance
from farpoint.path.selection import redundant_keyframe, select_tracks
from farpoint.path.velocities import (
    KeyframeVelocities,
    mean_velocity,
    reset_linear_velocities,
)
from farpoint.path.window import Window
from farpoint.pose import PoseStatus, RelativePose, TrackLabel
from farpoint.tracks import Tracks

__all__ = ["Pair", "PathBuilder"]

Estimate = Callable[[np.ndarray, np.ndarray, np.ndarray, float], RelativePose]


@dataclass(frozen=True, kw_only=True)
class Pair:
    """The two frames of a motion.

    Attributes
    ----------
    frame0, frame1 : int
        Indices of the two frames.
    time0, time1 : float
        Times of the two frames, s.
    """

    frame0: int
    frame1: int
    time0: float
    time1: float

    @property
    def seconds(self) -> float:
        """Time between the two frames."""
        return self.time1 - self.time0


class _Step(NamedTuple):
    """A motion, with tracks in the first frame (``before``) and in the second frame (``now``).

    ``is_inlier`` (N,) marks the tracks that are inliers of the motion.
    """

    before: TrackObservations
    now: TrackObservations
    is_inlier: np.ndarray
    motion: RelativePose
    pair: Pair

    @property
    def inliers(self) -> TrackObservations:
        """Inlier tracks in the second frame."""
        return self.now.select(self.is_inlier)


class PathBuilder:
    """Chains motions of consecutive frames on one scale, with a sliding window of keyframes.

    The unit of the path is the length of the first motion whose direction is observable. The poses
    of later frames come from resection with the window's landmarks. A frame becomes a keyframe if
    the median flow since the last keyframe exceeds `PathOptions.keyframe_flow_px`, or if the share
    of tracks that are still followed is below `PathOptions.keyframe_share`. The window's keyframes,
    landmarks, lens and shutter are then optimised jointly. If the landmarks in view cannot give the
    scale, the length of the next motion is last speed times time, and
    `PathOptions.speed_ratio_sigma` squared is added to the variance of the logarithmic scale.

    Time and memory for a frame do not depend on the number of earlier frames.

    Parameters
    ----------
    estimate : callable
        Function that estimates a two-view motion. The arguments are pixels (N, 2) in each frame,
        covariances (N, 2, 2) of the displacements, px^2, and the time between the frames, s.
    options : PathOptions
        Options of the window.
    lens_options : LensRefinementOptions
        Priors of lens and shutter.
    """

    def __init__(
        self, estimate: Estimate, options: PathOptions, lens_options: LensRefinementOptions
    ) -> None:
        self._estimate, self._options, self._lens_options = estimate, options, lens_options
        self._lens: LensEstimate | None = None
        self._pending = PendingPoses()
        self._segment = 0
        self._R, self._p = np.eye(3), np.zeros(3)
        self._speed: float | None = None  # path units per second
        self._begin_segment()

    def _begin_segment(self) -> None:
        self._history = TrackHistory()
        # Covariance (7, 7) and position of the pose at which the window starts. The covariance
        # includes the variance of an extrapolated scale.
        self._base, self._base_p = np.zeros((7, 7)), self._p
        self._reset_window()

    def _reset_window(self) -> None:
        self._window: Window | None = None
        self._key_tracks: TrackObservations | None = None
        # First keyframe and its tracks, until `_restart` tests the first motion; otherwise None.
        self._first: tuple[Keyframe, TrackObservations] | None = None
        # Flow since the last keyframe, px, when `_since_keyframe` last estimated a motion.
        self._unobservable_flow = 0.0
        self._is_key, self._has_scale = False, False
        self._velocities = KeyframeVelocities()
        # Derivatives (6, D) of the current pose by the unknowns of the window's last solution; None
        # before the first solution.
        self._by_state: np.ndarray | None = None
        self._own = np.zeros((6, 6))  # covariance of the current pose if these unknowns are exact
        self._step = np.zeros((6, 6))  # covariance of the last resection

    @property
    def now(self) -> PathPoint:
        """The last pose, as a `PathPoint` without the length of a motion."""
        return PathPoint(
            world_from_cam=pose_matrix(self._R, self._p),
            covariance=self._covariance(),
            segment=self._segment,
        )

    @property
    def lens(self) -> LensEstimate | None:
        """Estimate of the lens; None before the first motion."""
        return self._lens

    def report(self) -> LensReport | None:
        """Report of the lens; None before the first motion."""
        return None if self._lens is None else self._lens.report()

    def break_off(self) -> PathPoint:
        """Begin a new segment at the last pose. The motion between the two segments is unknown."""
        self._pending.freeze_all()
        self._segment += 1
        self._begin_segment()
        return self.now

    def pass_over(self, frame: int, timestamp: float) -> None:
        """Add a frame whose motion is unknown, with the pose of the frame before."""
        self._add_pending(frame, timestamp)

    def relative_pose(self, frame0: int, frame1: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Motion between two keyframes, with covariance; None if a frame is not in the window.

        Returns
        -------
        cam1_from_cam0 : ndarray, shape (4, 4)
        covariance : ndarray, shape (6, 6)
            Covariance of ``[dtheta, dt]`` in camera 1: ``R_true = Exp(dtheta) R``, ``t_true = t +
            dt``, rad and units of the path. Errors of lens and shutter are included.
        """
        if self._window is None:
            return None
        slots = {frame.frame: slot for slot, frame in enumerate(self._window.frames)}
        if frame0 not in slots or frame1 not in slots:
            return None
        return self._window.relative_pose(slots[frame0], slots[frame1])

    def add(self, camera: Camera, tracks: Tracks, motion: RelativePose, pair: Pair) -> PathPoint:
        """Add the motion from the previous frame to the current frame.

        Parameters
        ----------
        camera : Camera
            The given camera of all frames.
        tracks : Tracks
            Matches of the motion.
        motion : RelativePose
            Two-view estimate with a status other than FAILED.
        pair : Pair
            The two frames.
        """
        before, now = self._history.update(tracks)
        window = self._window_of(camera, pair)
        self._complete_keyframe(window, before)
        is_inlier = (motion.labels != TrackLabel.OUTLIER)[self._history.order]
        step = _Step(before, now, is_inlier, motion, pair)
        return self._track(window, step) if self._has_scale else self._initialise(window, step)

    def final_poses(self) -> list[FinalPose]:
        """Poses that became final since the last call, in the order of their frames."""
        return self._pending.final_poses()

    def remaining(self) -> list[FinalPose]:
        """Current values of all poses that `final_poses` has not returned."""
        self._pending.freeze_all()
        return self._pending.final_poses()

    # Initialisation

    def _window_of(self, camera: Camera, pair: Pair) -> Window:
        if self._window is None:
            if self._lens is None:
                self._lens = LensEstimate(camera, self._lens_options, pair.seconds)
            assert camera.size is not None
            self._window = Window(self._lens, camera.size)
            self._velocities.add_keyframe(
                self._window.add(pair.frame0, pair.time0, self._R, self._p, np.zeros(6))
            )
            self._is_key = True
        return self._window

    def _initialise(self, window: Window, step: _Step) -> PathPoint:
        """Add a frame of a path whose scale is unknown.

        As soon as the direction of the motion since the last keyframe is observable, the length of
        this motion is set to `_unit`, which defines the scale.
        """
        motion, pair, now = step.motion, step.pair, step.now
        assert motion.rotation_cam1_from_cam0 is not None
        key, inliers = window.frames[-1], step.inliers
        seconds = pair.time1 - key.timestamp
        since_key = motion
        if key.frame != pair.frame0:
            since_key = self._since_keyframe(step, seconds)
        R, p = self._R @ motion.rotation_cam1_from_cam0.T, self._p
        last_p = p
        if since_key is not None and since_key.status is PoseStatus.OK:
            assert since_key.rotation_cam1_from_cam0 is not None
            R = key.R @ since_key.rotation_cam1_from_cam0.T
            p = key.p + self._unit(seconds) * (key.R @ since_key.heading_cam0)
            self._has_scale = True
        self._move_to(R, p, pair.seconds)
        rotation = motion.rotation_covariance
        self._own[:3, :3] += R @ (np.zeros((3, 3)) if rotation is None else rotation) @ R.T
        if self._has_scale:
            if not self._has_moved(self._key_tracks, now, RELIABLE_FLOW_SHARE):
                assert self._key_tracks is not None
                self._first = key, self._key_tracks
            self._add_keyframe(window, inliers, pair)
            window.set_unit()
            window.triangulate()
            self._solve(window, motion)
            # Before this solution, no displacement of a frame and thus no velocity was known.
            reset_linear_velocities(window.frames)
            self._velocities.restart(window.frames[-1].twist, window.frames[-1].twist)
        elif motion.status is not PoseStatus.STATIC:
            # The displacement is unknown.
            self._own[3:, 3:] += (UNKNOWN_LENGTH_SIGMA * self._unit(pair.seconds)) ** 2 * np.eye(3)
        if not self._has_scale and self._has_moved(self._key_tracks, now, 2.0):
            self._add_keyframe(window, inliers, pair)
            window.add_rest_prior(UNKNOWN_LENGTH_SIGMA)
        return self._point(pair, motion, None, last_p)

    def _since_keyframe(self, step: _Step, seconds: float) -> RelativePose | None:
        """Two-view motion from the last keyframe to the current frame.

        The estimate is skipped, and the result is None, if two conditions hold: the motion from the
        previous frame has no observable direction, and the flow since the keyframe is less than
        1.25 times the flow at which the last estimate was made.
        """
        before, now = self._key_tracks, step.inliers
        assert before is not None
        flow = self._flow(before, now)
        if (
            step.motion.status is not PoseStatus.OK
            and flow < NEXT_ATTEMPT_FLOW_RATIO * self._unobservable_flow
        ):
            return None
        self._unobservable_flow = flow
        return self._since(before, now, seconds)

    def _unit(self, seconds: float) -> float:
        """Length of a window's first displacement: last speed times ``seconds``; 1 if unknown."""
        return 1.0 if self._speed is None or seconds <= 0.0 else self._speed * seconds

    def _since(
        self, before: TrackObservations, observed: TrackObservations, seconds: float
    ) -> RelativePose:
        """Two-view motion since an earlier frame, from tracks that both frames have."""
        rows = before.rows_of(observed.ids)
        both = observed.select(rows >= 0)
        uu, uv, vv = both.accumulated.T
        covariances = np.stack([uu, uv, uv, vv], axis=1).reshape(-1, 2, 2)
        return self._estimate(before.pixels[rows[rows >= 0]], both.pixels, covariances, seconds)

    def _restart(self, window: Window, step: _Step) -> np.ndarray:
        """Restart the window if a motion with larger flow contradicts the first motion.

        The motion is the two-view motion from the first keyframe to the current frame. If this
        motion contradicts the path, it replaces the pose of the current frame, at the same distance
        from the first keyframe. The change of a pose in between is proportional to the time since
        the first keyframe. All keyframes are then optimised again. The function returns the shift
        (3,) of the position of the previous frame.
        """
        assert self._first is not None
        (first, tracks), self._first, pair = self._first, None, step.pair
        seconds = pair.time1 - first.timestamp
        if window.has_marginalised or not seconds > 0.0:
            return np.zeros(3)

        def lens() -> LensEstimate:
            return LensEstimate(window.lens.given, self._lens_options, pair.seconds)

        other = contradicting_motion(
            WindowView(first.frame, first.timestamp, first.R, first.p, first.twist, tracks),
            WindowView(pair.frame1, pair.time1, *self._pose, self._velocities.last, step.inliers),
            self._since(tracks, step.inliers, seconds),
            lambda: Window(lens(), window.size),
            self._options.max_tracks,
        )
        if other is None:
            return np.zeros(3)
        last = other.frames[-1]
        rate = mean_velocity(self._pose, (last.R, last.p), seconds)
        if not self._is_key:
            self._add_keyframe(window, step.inliers, pair)
        correction, self._lens = Correction(window.frames), lens()
        window.restart(self._lens, other.lens.common, rate, first.timestamp)
        self._velocities.shift(rate)
        self._solve(window, step.motion)
        self._pending.correct(correction)
        return correction.at(pair.time0)[3:]

    # Tracking

    def _track(self, window: Window, step: _Step) -> PathPoint:
        motion, pair, now, is_inlier = step.motion, step.pair, step.now, step.is_inlier
        assert motion.rotation_cam1_from_cam0 is not None
        R = self._R @ motion.rotation_cam1_from_cam0.T
        # With an observable direction, the initial position assumes constant velocity. Resection
        # converges from initial errors of 10 sigma.
        continues = motion.status is PoseStatus.OK
        start = self._p + self._velocities.last[3:] * pair.seconds if continues else self._p
        last = self._pose
        located = locate_frame(window, now, last, R, start, pair.seconds)
        if located is None or not self._carries_scale(window, located, pair.seconds):
            if motion.status is PoseStatus.OK and self._speed is not None and pair.seconds > 0.0:
                return self._extrapolate_scale(window, step)
            located = None
        is_key = self._has_moved(self._key_tracks, now, 1.0)
        p = self._p
        if located is not None:
            R, p = located.R, located.p
        rest = None if located is None else self._rest(window, now, motion, located)
        self._move_to(R, p, pair.seconds)
        if is_key:
            fits = (
                is_inlier
                if located is None
                else is_inlier | np.isin(now.ids, located.fitting(CHI2_P999_OF_2))
            )
            self._add_keyframe(window, now.select(fits), pair)
            if located is None:
                window.add_rest_prior(max((self._speed or 1.0) * max(pair.seconds, 0.0), 1e-3))
            window.triangulate()
            self._solve(window, motion)
        elif located is not None:
            self._own, self._by_state = located.covariance, located.by_state
        else:
            self._own = self._dead_reckoned(motion, pair.seconds)
        last_p = last[1]
        if self._first is not None and self._has_moved(self._first[1], now, RELIABLE_FLOW_SHARE):
            last_p = last_p + self._restart(window, step)
        point = self._point(pair, motion, located, last_p)
        return point if rest is None else replace(point, rest=rest, scale=None, scale_sigma=None)

    def _carries_scale(self, window: Window, located: Located, seconds: float) -> bool:
        """Whether the position from landmarks is accurate enough to keep the scale.

        The 1-sigma of the position, divided by a length, must be below
        `PathOptions.speed_ratio_sigma`. The length is the largest of last speed times ``seconds``
        and the distances of the keyframes from the previous position.
        """
        lengths = [float(np.linalg.norm(frame.p - self._p)) for frame in window.frames]
        known = max(*lengths, (self._speed or 0.0) * seconds)
        sigma = float(np.sqrt(np.trace(located.covariance[3:, 3:]) / 3.0))
        return sigma < self._options.speed_ratio_sigma * known

    def _extrapolate_scale(self, window: Window, step: _Step) -> PathPoint:
        """Start a new window at the previous frame; the last speed gives the window's scale."""
        self._pending.freeze_all()
        self._base, self._base_p = self._covariance(), self._p
        self._base[6, 6] += self._options.speed_ratio_sigma**2
        self._reset_window()
        fresh = self._window_of(window.lens.given, step.pair)
        self._complete_keyframe(fresh, step.before)
        return replace(self._initialise(fresh, step), scale_is_guessed=True)

    def _dead_reckoned(self, motion: RelativePose, seconds: float) -> np.ndarray:
        """Covariance (6, 6) of a pose without resection, if the window's solution is exact.

        The rotation is the last rotation times the two-view rotation. The position is the last
        position, with an error of last speed times ``seconds`` (1-sigma) along each axis.
        """
        own, displacement = self._own.copy(), (self._speed or 0.0) * seconds
        if motion.rotation_covariance is not None:
            own[:3, :3] += self._R @ motion.rotation_covariance @ self._R.T
        own[3:, 3:] += displacement**2 * np.eye(3)
        return own

    def _rest(
        self, window: Window, now: TrackObservations, motion: RelativePose, located: Located
    ) -> Rest | None:
        """Evidence that the camera does not translate; None without such evidence.

        Matches on moving objects can give a two-view translation (NEAR matches) although the camera
        does not translate. The evidence is: the displacement by resection is not significant, at
        least half of the landmarks agree with the resection, and at most half of the NEAR matches
        belong to landmarks that agree.
        """
        if motion.status is not PoseStatus.OK:
            return None
        displacement = located.p - self._p
        # Covariance of the motion between two frames located by resection, without the factor of
        # the design effect. A smaller covariance makes reports of a camera at rest rarer.
        spread = 2.0 / window.design_effect * located.covariance
        if (
            displacement @ np.linalg.pinv(spread[3:, 3:], hermitian=True) @ displacement
            > CHI2_P99_OF_3
        ):
            return None
        near = now.ids[motion.labels[self._history.order] == TrackLabel.NEAR]
        fitting = located.fitting(CHI2_P999_OF_2)
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

    def _has_moved(
        self, before: TrackObservations | None, now: TrackObservations, share: float
    ) -> bool:
        """Whether the median flow exceeds ``share`` times `PathOptions.keyframe_flow_px`.

        The result is also True if the share of tracks ``before`` that are still followed is below
        `PathOptions.keyframe_share`.
        """
        assert before is not None
        return self._flow(before, now) > share * self._options.keyframe_flow_px

    def _flow(self, before: TrackObservations, now: TrackObservations) -> float:
        """Median flow, px; infinite if too many tracks ``before`` are lost (`keyframe_share`)."""
        rows = before.rows_of(now.ids)
        both = rows >= 0
        if not both.any() or both.sum() < self._options.keyframe_share * len(before.ids):
            return math.inf
        flow = np.linalg.norm(now.pixels[both] - before.pixels[rows[both]], axis=1)
        return median(flow)

    def _add_keyframe(self, window: Window, observed: TrackObservations, pair: Pair) -> None:
        while len(window) >= self._options.keyframes:
            alive = self._history.now.ids
            self._pending.freeze(window.remove(redundant_keyframe(window, alive), alive))
        keyframe = window.add(pair.frame1, pair.time1, *self._pose, self._velocities.last)
        window.observe(select_tracks(observed, window.landmarks, self._options.max_tracks))
        self._velocities.add_keyframe(keyframe)
        self._key_tracks, self._is_key = observed, True
        self._unobservable_flow = 0.0

    def _complete_keyframe(self, window: Window, before: TrackObservations) -> None:
        """Add the tracks that begin in the last keyframe to the window.

        These tracks are known only after the match of the keyframe with the next frame. ``before``
        holds all tracks of this match, with positions in the keyframe.
        """
        if not self._is_key:
            return
        self._is_key = False
        key = self._key_tracks
        fresh = before if key is None else before.select(key.rows_of(before.ids) < 0)
        if not len(fresh.ids):
            return
        window.observe(select_tracks(fresh, window.landmarks, self._options.max_tracks))
        if key is not None:
            joined = TrackObservations(
                *(np.concatenate(parts) for parts in zip(key, fresh, strict=True))
            )
            fresh = joined.select(np.argsort(joined.ids))
        self._key_tracks = fresh

    def _solve(self, window: Window, motion: RelativePose) -> None:
        newest = window.frames[-1]
        before = {frame.frame: frame.twist for frame in window.frames}
        window.solve(LATER_ITERATIONS if window.has_marginalised else FIRST_ITERATIONS)
        self._velocities.correct(newest, before)
        seconds = newest.timestamp - window.frames[-2].timestamp
        displacement, is_significant = window.last_length()
        if is_significant and seconds > 0.0 and motion.status is PoseStatus.OK:
            self._speed = displacement / seconds
        self._R, self._p, self._own = newest.R, newest.p, np.zeros((6, 6))
        self._by_state = window.newest_by_state()

    @property
    def _pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation and position of the last frame."""
        return self._R, self._p

    def _move_to(self, R: np.ndarray, p: np.ndarray, seconds: float) -> None:
        self._velocities.add(mean_velocity(self._pose, (R, p), seconds))
        self._R, self._p = R, p

    # Output of a frame

    def _point(
        self,
        pair: Pair,
        motion: RelativePose,
        located: Located | None,
        last_p: np.ndarray,
    ) -> PathPoint:
        before, self._step = self._step, np.zeros((6, 6)) if located is None else located.covariance
        self._add_pending(pair.frame1, pair.time1)
        covariance, scale, sigma = self._covariance(), None, None
        if self._has_scale and motion.status is PoseStatus.OK:
            displacement = self._p - last_p
            scale = float(np.linalg.norm(displacement))
            axis = displacement / max(scale, 1e-300)
            own = float(axis @ (before + self._step)[3:, 3:] @ axis)
            sigma = math.sqrt(own + scale**2 * float(covariance[6, 6]))
        return PathPoint(
            world_from_cam=pose_matrix(self._R, self._p),
            covariance=covariance,
            segment=self._segment,
            scale=scale,
            scale_sigma=sigma,
            fitting=None if located is None else located.fitting(CHI2_P999_OF_2),
        )

    def _covariance(self) -> np.ndarray:
        """Covariance (7, 7) of the pose in the segment.

        The covariance is the propagated covariance of the window's first pose plus the covariance
        within the window. An error of the scale at the first pose causes a position error that is
        proportional to the displacement from the first pose.
        """
        displacement = self._p - self._base_p
        by_base = np.eye(7)
        by_base[3:6, :3], by_base[3:6, 6] = -so3.skew(displacement), displacement
        return self._covariance_within() + by_base @ self._base @ by_base.T

    def _covariance_within(self) -> np.ndarray:
        """Covariance (7, 7) of the pose within its window.

        The covariance is the sum of three terms: the propagated covariance of the window's
        solution, the covariance of the pose if this solution is exact, and `second_order_variance`.
        """
        covariance = np.zeros((7, 7))
        if self._window is not None and self._by_state is not None:
            covariance = self._window.covariance_of(self._by_state, self._p)
        covariance[:6, :6] += self._own
        if self._window is not None:
            displacement = self._p - self._window.origin
            covariance[3:6, 3:6] += second_order_variance(displacement, covariance[3:6, 3:6])
        return covariance

    def _add_pending(self, frame: int, timestamp: float) -> None:
        self._pending.add(
            None if self._window is None else self._window.frames[-1],
            frame=frame,
            timestamp=timestamp,
            segment=self._segment,
            R=self._R,
            p=self._p,
            covariance=self._covariance(),
        )
