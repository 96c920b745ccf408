"""Visual odometry: which frames are compared, and how frames without a motion are handled."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from farpoint._kernels.compile import AnnouncedCompilation
from farpoint.camera import Camera
from farpoint.frames import Frame
from farpoint.frames.deinterlace import Deinterlacer
from farpoint.metrics import SplitHalf, image_cells, split_half
from farpoint.odometry.at_rest import at_rest
from farpoint.odometry.capture_times import CaptureTimes
from farpoint.odometry.constants import FRAMES_PER_SEED, FRAMES_WITH_NEW_KERNELS
from farpoint.odometry.lens_in_use import LensInUse
from farpoint.odometry.mask import checked_mask, tracked_region
from farpoint.odometry.options import OdometryOptions
from farpoint.odometry.result import OdometryResult
from farpoint.odometry.rising_time import RisingTime
from farpoint.odometry.velocities import Velocities
from farpoint.path.lens import LensReport, given_lens
from farpoint.path.path import Pair, PathBuilder
from farpoint.path.perspective import without_perspective
from farpoint.path.point import FinalPose, PathPoint
from farpoint.path.prediction import point_predictor
from farpoint.pose import (
    PoseStatus,
    RelativePose,
    TrackLabel,
    failed_pose,
)
from farpoint.pose.image_parts import parts_of
from farpoint.pose.rolling import Searched
from farpoint.pose.shutter import VelocityPrior
from farpoint.pose.track_errors import NO_EARLIER_PAIRS
from farpoint.pose.views import Views, estimate_views, rough_motion, search_views
from farpoint.tracks import Tracker, Tracks, grey_size

__all__ = ["Odometry"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Reference:
    """The reference frame, to which the next frame is compared, and the last motion."""

    index: int
    timestamp: float
    captured: float
    motion: RelativePose | None
    tracks: Tracks
    direction: np.ndarray | None = None
    """Last known direction, cam1_from_cam0."""

    def predicted(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Rotation and direction, cam1_from_cam0, of the next motion for constant velocity.

        The velocity is assumed to be constant in the axes of the camera.
        """
        if self.motion is None or self.direction is None:
            return None
        R = self.motion.rotation_cam1_from_cam0
        return None if R is None else (R, self.direction)


class Odometry:
    """Motion of a calibrated camera from frame to frame.

    The motion of each frame is estimated relative to the last usable frame. A sliding window
    estimates the poses of the last keyframes together with the distances of points, the lens and
    the shutter. Two-view motions use the window's estimate of lens and shutter. A frame is unusable
    if the frame cannot be decoded, has another size than the first frame, or has no texture. The
    result of an unusable frame has the status FAILED. If a textured frame has no consensus among
    its matches, as at a cut, a new segment of the trajectory begins at this frame. Each segment has
    one scale.

    Parameters
    ----------
    camera : Camera
        Camera of all frames. If the camera has no image size, the first frame sets the size.
    options : OdometryOptions, optional
        Options of each stage.
    mask : ndarray of bool or uint8, shape (H, W), optional
        Mask of the size of the frames. True, or white (128 and above), marks pixels that are used.
        False, or black, marks pixels of objects that move with the camera, such as a bonnet or a
        mount, and of logos in the picture. A track neither begins nor continues at a pixel if the
        window around the pixel (15 px wide by default) contains black pixels of the mask.

    Attributes
    ----------
    camera : Camera
        The given camera, with the size of the frames as soon as the first image is processed.
    seconds : dict
        Computing time so far, s, of the stages ``"tracks"``, ``"pose"`` and ``"path"``.

    Examples
    --------
    >>> odometry = Odometry(Camera.pinhole(1241, 376, 718.9, 718.9, 607.2, 185.2))
    >>> for result in odometry.run(open_frames("drive.mp4")):  # doctest: +SKIP
    ...     print(result.timestamp, result.pose.status if result.pose else "first frame")
    """

    def __init__(
        self,
        camera: Camera,
        options: OdometryOptions | None = None,
        *,
        mask: np.ndarray | None = None,
    ) -> None:
        self.camera = camera
        self._mask = None if mask is None else checked_mask(mask, camera.size)
        self.options = options or OdometryOptions()
        self.seconds = {"tracks": 0.0, "pose": 0.0, "path": 0.0}
        self._tracker = Tracker(self.options.tracker)
        self._reference: _Reference | None = None
        self._track_errors = NO_EARLIER_PAIRS
        self._path = PathBuilder(self._estimate, self.options.path, self.options.lens)
        self._lens = LensInUse(camera, self.options.lens)
        self._velocities = Velocities()
        # Frame and velocity prior of the last estimated pair.
        self._last_prior: tuple[int, VelocityPrior | None] = (-1, None)
        self._time, self._capture, self._fields = RisingTime(), CaptureTimes(), Deinterlacer()
        self._captured = 0.0  # capture time of the current frame, s
        self._timestamps: dict[int, float] = {}  # by frame index, if the pose is not final
        self._next_index = 0
        self._has_size = False  # whether the first image has set the size

    @property
    def notes(self) -> tuple[str, ...]:
        """Properties of the images that affect the results, each as one or two sentences."""
        notes = []
        if self._fields.is_interlaced:
            notes.append("The images are interlaced: only their even lines are used.")
        if self._time.falls:
            notes.append(
                f"Time stamps fell {self._time.falls} times: each time a new segment begins, and "
                "later time stamps are moved to follow the ones before."
            )
        return tuple(notes)

    @property
    def lens(self) -> LensReport:
        """Current estimate of lens and shutter."""
        return self._path.report() or given_lens(self.camera)

    def final_poses(self) -> list[FinalPose]:
        """Poses that became final since the last call, in the order of their frames.

        Later frames do not change a final pose. A pose is attached to the last keyframe, and is
        final as soon as this keyframe has left the window, or after about 150 further frames. In
        contrast, `OdometryResult.world_from_cam` is the estimate at the time when the frame was
        processed.
        """
        return self._stamped(self._path.final_poses())

    def remaining(self) -> list[FinalPose]:
        """Poses that `final_poses` has not returned yet, at the end of a run."""
        return self._stamped(self._path.remaining())

    def _stamped(self, poses: list[FinalPose]) -> list[FinalPose]:
        """Poses with the time stamps of their frames in place of the capture times."""
        return [
            replace(pose, timestamp=self._timestamps.pop(pose.frame1, pose.timestamp))
            for pose in poses
        ]

    def relative_pose(self, frame0: int, frame1: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Motion between two keyframes that are in the window, for a pose graph.

        Parameters
        ----------
        frame0, frame1 : int
            Frame indices of the two keyframes.

        Returns
        -------
        (ndarray, ndarray) or None
            ``cam1_from_cam0`` (4, 4), and the covariance (6, 6) of ``[dtheta, dt]`` in camera 1:
            ``R_true = Exp(dtheta) R``, ``t_true = t + dt``, rad and units of the path. None if one
            of the two frames is not a keyframe of the window.
        """
        return self._path.relative_pose(frame0, frame1)

    def run(self, frames: Iterable[Frame]) -> Iterator[OdometryResult]:
        """Yield the result of each frame as soon as the frame is processed."""
        for frame in frames:
            yield self.process(frame.image, frame.timestamp, fault=frame.fault)

    def process(
        self, image: np.ndarray | None, timestamp: float, *, fault: str | None = None
    ) -> OdometryResult:
        """Estimate the motion from the last usable frame to this image.

        Parameters
        ----------
        image : ndarray of uint8, shape (H, W), or None
            Grey values; None for a frame that could not be decoded. Interlaced images are
            recognised, and only their even lines are used.
        timestamp : float
            Time stamp, s. If the time stamp is before the previous time stamp, a new segment
            begins. All time stamps from this frame on are then shifted, so that the time stamps of
            results never decrease.
        fault : str, optional
            Reason why ``image`` is None.

        Raises
        ------
        InputError
            If the image does not have grey uint8 values, or if the size of the first image differs
            from the size of the calibration or of the mask.
        """
        index, self._next_index = self._next_index, self._next_index + 1
        with AnnouncedCompilation(f"frame {min(index, FRAMES_WITH_NEW_KERNELS)}"):
            return self._process(image, timestamp, fault, index)

    def _process(
        self, image: np.ndarray | None, timestamp: float, fault: str | None, index: int
    ) -> OdometryResult:
        timestamp, fell = self._time.update(timestamp)
        if fell:  # another recording begins
            self._capture.restart()
            self._reference = None
            self._path.break_off()
        self._captured = self._capture.update(timestamp)
        self._timestamps[index] = timestamp
        if image is None:
            return self._pass_over(index, timestamp, f"The frame cannot be decoded: {fault}.")
        width, height = grey_size(image)
        image = self._fields(image)
        if not self._has_size:
            self.camera = self.camera.with_size(width, height)
            self._lens = LensInUse(self.camera, self.options.lens)
            region = tracked_region(self.camera, self._mask, self.options.tracker)
            self._tracker = Tracker(self.options.tracker, mask=region)
            self._has_size = True
        assert self.camera.size is not None
        if self.camera.size != (width, height):
            return self._pass_over(
                index,
                timestamp,
                f"The frame is {width}x{height}, the sequence "
                f"{self.camera.size[0]}x{self.camera.size[1]}.",
            )
        if self._reference is None:
            if not self._tracker.sees_texture(image):
                return self._pass_over(index, timestamp, "The frame shows nothing to track.")
            return self._begin(image, index, timestamp)
        return self._compare(self._reference, image, index, timestamp)

    def split_half(self, result: OdometryResult, *, cell_px: float | None = None) -> SplitHalf:
        """Estimate the motion of a pair from two halves of its tracks, and compare the two motions.

        From the differences of many pairs, `farpoint.metrics.evaluate_halves` tests the covariances
        without ground truth.

        Parameters
        ----------
        result : OdometryResult
            Result of this odometry. The frame index of the result is part of the random seed of the
            split.
        cell_px : float, optional
            Width of square image cells, px. All tracks of a cell go to the same half, so that
            errors that are correlated within a cell do not cancel in the difference. By default the
            image is divided into 16 parts with about the same number of tracks.
        """
        tracks, points = result.tracks, result.tracks.points0
        # Errors of lens and shutter, and errors common to all tracks, are equal in both halves and
        # cancel in the difference. They are therefore left out of the covariances. Changes of the
        # velocity are estimated from each half by itself.
        camera = replace(self._lens.camera.with_uncertainty(), readout_sigma_s=None)
        options = replace(self.options.pose, shared_error_px=0.0)
        groups = (
            parts_of(camera.unproject(points)) if cell_px is None else image_cells(points, cell_px)
        )
        seconds, seed = result.timestamp - result.timestamp0, self.options.seed
        frame, prior = self._last_prior
        if frame != result.frame1:
            prior = Velocities().prior(seconds)

        def estimate_half(
            points0: np.ndarray, points1: np.ndarray, covariance_px2: np.ndarray
        ) -> RelativePose:
            views = self._views_of(camera, points0, points1, covariance_px2, seconds)
            return estimate_views(views._replace(velocity_prior=prior), options, seed)

        return split_half(
            (points, tracks.points1, tracks.covariance_px2),
            estimate_half,
            seed=result.frame1 + FRAMES_PER_SEED * seed,
            groups=groups,
        )

    def _compare(
        self, reference: _Reference, image: np.ndarray, index: int, timestamp: float
    ) -> OdometryResult:
        start = time.perf_counter()
        tracks = self._tracker.match(image, self._prediction(reference))
        matched = time.perf_counter()
        seconds = self._captured - reference.captured
        self._lens.begin(seconds)
        tracks, searched = self._without_perspective(tracks, seconds, reference)
        views = self._views(self._lens.camera, tracks, seconds)
        self._last_prior = index, views.velocity_prior
        pose = estimate_views(views, self.options.pose, self.options.seed, searched)
        self._track_errors = self._track_errors.with_pair(
            pose.stats.half_ratio, pose.stats.residual_correlation
        )
        estimated = time.perf_counter()
        if pose.status is not PoseStatus.FAILED:
            pair = Pair(
                frame0=reference.index,
                frame1=index,
                time0=reference.captured,
                time1=self._captured,
            )
            point = self._path.add(self.camera, tracks, pose, pair)
            self._lens.update(self._path.lens)
            solved = time.perf_counter()
            pose = at_rest(pose, point.rest)
            is_good, direction = pose.labels != TrackLabel.OUTLIER, pose.direction_cam1_from_cam0
            self._reference = _Reference(
                index=index,
                timestamp=timestamp,
                captured=self._captured,
                motion=pose,
                tracks=tracks.select(is_good),
                direction=reference.direction if direction is None else direction,
            )
            if point.fitting is not None:  # points of known distance are inliers
                is_good |= np.isin(tracks.ids, point.fitting)
            self._velocities.add(pose, seconds)
            self._tracker.advance(image, tracks.select(is_good))
        elif self._tracker.sees_texture(image):
            # A cut, or a motion too large to track: restart from this frame.
            solved = time.perf_counter()
            self._restart(image, index, timestamp)
            point = self._path.break_off()
            self._path.pass_over(index, self._captured)
        else:
            return self._pass_over(index, timestamp, "The frame shows nothing to track.")
        advanced = time.perf_counter()
        self.seconds["tracks"] += matched - start + advanced - solved
        self.seconds["pose"] += estimated - matched
        self.seconds["path"] += solved - estimated
        return self._result(reference, index, timestamp, pose, tracks, point)

    def _without_perspective(
        self, tracks: Tracks, seconds: float, reference: _Reference
    ) -> tuple[Tracks, Searched | None]:
        """Tracks corrected for perspective, and the two-view search that gave the motion for it."""
        options = self.options.pose
        if not options.refine:
            return tracks, None
        views = self._views(self._lens.camera, tracks, seconds)
        searched = search_views(views, options, self.options.seed, reference.predicted())
        if searched is None:
            return tracks, None
        motion = rough_motion(searched, options)
        return without_perspective(tracks, self._lens.camera, *motion), searched

    def _estimate(
        self, points0: np.ndarray, points1: np.ndarray, covariance_px2: np.ndarray, seconds: float
    ) -> RelativePose:
        """The motion between two views that the path chooses."""
        views = self._views_of(self._lens.camera, points0, points1, covariance_px2, seconds)
        return estimate_views(views, replace(self.options.pose, half_splits=0), self.options.seed)

    def _views(self, camera: Camera, tracks: Tracks, seconds: float) -> Views:
        """Two views through a camera: the reference frame and the current frame."""
        points = tracks.points0, tracks.points1, tracks.covariance_px2
        views = self._views_of(camera, *points, seconds)
        return views._replace(velocity_prior=self._velocities.prior(seconds))

    def _views_of(
        self,
        camera: Camera,
        points0: np.ndarray,
        points1: np.ndarray,
        covariance_px2: np.ndarray,
        seconds: float,
    ) -> Views:
        # Half of the covariance of a displacement is assigned to each of the two points.
        half_px2 = 0.5 * covariance_px2
        interval_s = self._lens.interval_s(seconds)
        views = Views(points0, points1, camera, camera, half_px2, half_px2, None, interval_s)
        return views._replace(track_errors=self._track_errors)

    def _prediction(self, reference: _Reference) -> Callable[[np.ndarray], np.ndarray] | None:
        """Prediction of the reference's tracks in the next frame, if the last motion repeats."""
        motion = reference.motion
        if motion is None:
            return None
        tracker = self._tracker
        return point_predictor(
            self._lens.camera, motion, reference.tracks, tracker.ids, tracker.points
        )

    def _begin(self, image: np.ndarray, index: int, timestamp: float) -> OdometryResult:
        self._restart(image, index, timestamp)
        return self._without_motion(index, timestamp, None)

    def _restart(self, image: np.ndarray, index: int, timestamp: float) -> None:
        self._tracker.restart(image)
        self._velocities.break_off()
        self._reference = _Reference(
            index=index,
            timestamp=timestamp,
            captured=self._captured,
            motion=None,
            tracks=Tracks.empty(),
        )

    def _pass_over(self, index: int, timestamp: float, reason: str) -> OdometryResult:
        return self._without_motion(index, timestamp, failed_pose(reason))

    def _without_motion(
        self, index: int, timestamp: float, pose: RelativePose | None
    ) -> OdometryResult:
        tracks, point = Tracks.empty(), self._path.now
        self._path.pass_over(index, self._captured)
        return self._result(self._reference, index, timestamp, pose, tracks, point)

    @staticmethod
    def _result(
        reference: _Reference | None,
        index: int,
        timestamp: float,
        pose: RelativePose | None,
        tracks: Tracks,
        point: PathPoint,
    ) -> OdometryResult:
        return OdometryResult(
            frame0=index if reference is None else reference.index,
            frame1=index,
            timestamp0=timestamp if reference is None else reference.timestamp,
            timestamp=timestamp,
            pose=pose,
            tracks=tracks,
            world_from_cam=point.world_from_cam.copy(),
            world_covariance=point.covariance.copy(),
            segment=point.segment,
            scale=point.scale,
            scale_sigma=point.scale_sigma,
            scale_is_guessed=point.scale_is_guessed,
        )
