"""Motions strung together on one scale: the camera's path, with how sure it is."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from farpoint.camera import Camera
from farpoint.pose import PoseStatus, RelativePose, TrackLabel
from farpoint.tracks import Tracks
from farpoint.trajectory.chain import chain
from farpoint.trajectory.depths import Depths
from farpoint.trajectory.links import Keyframe, Link, good_tracks, is_firm, join_tracks
from farpoint.trajectory.moved import Moved, MovedUnseen
from farpoint.trajectory.options import PathOptions
from farpoint.trajectory.parallax import Parallax, measure_parallax
from farpoint.trajectory.point import PathPoint
from farpoint.trajectory.resection import resect
from farpoint.trajectory.scale import ScaleFit, can_fit, fit_scale
from farpoint.trajectory.uncertainty import (
    SharedErrors,
    advance_moving,
    advance_turning,
    advance_unseen,
    covariance_at_rest,
    length_variance_shared,
)

__all__ = ["PathBuilder"]

Estimate = Callable[[np.ndarray, np.ndarray, np.ndarray], RelativePose]


class PathBuilder:
    """Strings motions of consecutive frames together.

    Motions well observed are strung as they are. Where the camera moves little from frame to frame,
    each frame is compared with a keyframe some frames back, until the direction of travel since
    then is known well: slow motion gets a baseline worth measuring, and a camera at rest does not
    wander. The length of a motion is that which fits the distances of points seen before, and where
    two views leave its direction open, so is the motion. Where that does not help either, the
    camera stays where it was, and may be anywhere that its last speed takes it to.

    Cost and memory for a frame do not depend on the number of frames.

    Parameters
    ----------
    estimate : callable
        Motion of the camera from matches of two frames: pixels (N, 2) in each, and covariances
        (N, 2, 2), px^2, of their displacements.
    options : PathOptions
        When a frame becomes a keyframe.
    """

    def __init__(self, estimate: Estimate, options: PathOptions) -> None:
        self._estimate = estimate
        self._options = options
        self._shared = SharedErrors(
            persistent_motion=options.persistent_motion_share,
            persistent_length=options.persistent_length_share,
            fading_motion=options.fading_motion_share,
            fading_motions=options.fading_motions,
        )
        self._key = _keyframe_at(np.eye(4), 0)
        self._last: Link | None = None
        self._now = PathPoint(world_from_cam=np.eye(4), covariance=np.zeros((7, 7)), segment=0)
        self._has_scale = False
        self._speed: float | None = None  # units a second

    @property
    def now(self) -> PathPoint:
        """Where the camera was last seen; without a motion."""
        return PathPoint(
            world_from_cam=self._now.world_from_cam,
            covariance=self._now.covariance,
            segment=self._now.segment,
        )

    def break_off(self) -> PathPoint:
        """Begin a new segment where the last one ended: nothing connects the two."""
        self._key = _keyframe_at(self._now.world_from_cam, self._now.segment + 1)
        self._last = None
        self._has_scale = False
        self._now = PathPoint(
            world_from_cam=self._key.world_from_cam,
            covariance=self._key.covariance[:7, :7],
            segment=self._key.segment,
        )
        return self._now

    def add(
        self, camera: Camera, tracks: Tracks, motion: RelativePose, seconds: float
    ) -> PathPoint:
        """Add a motion from the last frame to the next, of any status but FAILED.

        Parameters
        ----------
        camera : Camera
            Of both frames.
        tracks : Tracks
            The matches behind the motion.
        motion : RelativePose
            What they say.
        seconds : float
            Time between the frames.
        """
        if self._last is not None and self._makes_keyframe(self._last):
            self._advance_key()
        link = None if self._last is None else self._link_back(camera, tracks, motion, seconds)
        if link is None:
            self._advance_key()
            link = self._link(camera, tracks, motion, len(tracks), 1, seconds)
        point = self._point(link, motion, seconds)
        self._last, self._now = link, point
        return point

    def _makes_keyframe(self, link: Link) -> bool:
        moved = link.moved if isinstance(link.moved, Moved) else None
        if moved is not None and not moved.fit.points:
            return True  # it has set the scale
        if len(link.tracks) < self._options.keyframe_share * link.begun:
            return True
        # What follows from distances says nothing new of them.
        is_resected = moved is not None and moved.is_resected
        return self._is_firm(link.motion) and not is_resected

    def _is_firm(self, motion: RelativePose) -> bool:
        return is_firm(motion, math.radians(self._options.keyframe_direction_deg))

    def _advance_key(self) -> None:
        if self._last is not None:
            self._key, self._last = self._last.end(), None

    def _link_back(
        self, camera: Camera, tracks: Tracks, motion: RelativePose, seconds: float
    ) -> Link | None:
        """The link from an earlier keyframe; None where the last frame serves better."""
        last = self._last
        assert last is not None
        joined = join_tracks(last.tracks, good_tracks(tracks, motion))
        since_key = self._estimate(joined.points0, joined.points1, joined.covariance_px2)
        if since_key.status is PoseStatus.FAILED:
            return None
        if motion.status is PoseStatus.OK and since_key.status is not PoseStatus.OK:
            return None
        since_s = last.seconds + seconds
        link = self._link(camera, joined, since_key, last.begun, last.steps + 1, since_s)
        if link.is_guess and self._is_firm(motion):
            return (
                None  # the keyframe may lie within the turn: a guess for the last motion is better
            )
        return None if link.segment != self._key.segment else link

    def _link(
        self,
        camera: Camera,
        tracks: Tracks,
        motion: RelativePose,
        begun: int,
        steps: int,
        seconds: float,
    ) -> Link:
        key, moved = self._key, None
        if motion.status is PoseStatus.OK:
            key, moved = self._measured(camera, tracks, motion, seconds)
        if moved is None and (placed := resect(camera, tracks, motion, key.depths)) is not None:
            motion, fit = placed
            parallax = measure_parallax(camera, tracks, motion)
            moved = Moved.by(fit, motion, parallax, key.depths, is_resected=True)
        if moved is None:
            moved = self._unseen(camera, good_tracks(tracks, motion), motion, seconds)
        pose, covariance = self._end_of(key, motion, moved)
        return Link(
            key=key,
            tracks=good_tracks(tracks, motion),
            begun=begun,
            steps=steps,
            seconds=seconds,
            motion=motion,
            moved=moved,
            world_from_cam=pose,
            covariance=covariance,
            segment=key.segment,
        )

    def _measured(
        self, camera: Camera, tracks: Tracks, motion: RelativePose, seconds: float
    ) -> tuple[Keyframe, Moved | None]:
        """The motion with its length, from the keyframe or from the one that begins a segment."""
        assert motion.covariance is not None
        key, parallax = self._key, measure_parallax(camera, tracks, motion)
        fit = fit_scale(key.depths, parallax, motion.covariance)
        if fit is not None:
            return key, Moved.by(fit, motion, parallax, key.depths)
        if can_fit(key.depths, parallax.ids):
            return key, None
        moved = self._set_scale(parallax, motion, seconds)
        if self._has_scale and moved is not None and not moved.fit.is_guess:
            key = _keyframe_at(key.world_from_cam, key.segment + 1)
        return key, moved

    def _set_scale(self, parallax: Parallax, motion: RelativePose, seconds: float) -> Moved | None:
        """The scale begins with this motion, or the last speed carries it on.

        None where it goes on, but this motion is hardly one: a false alarm would be taken for a
        motion at full speed.
        """
        assert motion.covariance is not None
        if self._has_scale and not self._is_firm(motion):
            return None
        length = 0.0 if self._speed is None else self._speed * seconds
        if self._has_scale and length > 0.0:
            sigma = self._options.speed_ratio_sigma
            fit = ScaleFit.guess(length, sigma, motion.covariance)
        else:
            fit = ScaleFit.unit(length if length > 0.0 else 1.0, motion.covariance)
        return Moved.by(fit, motion, parallax, self._key.depths)

    def _unseen(
        self, camera: Camera, tracks: Tracks, motion: RelativePose, seconds: float
    ) -> MovedUnseen | None:
        """As fast as it came, anywhere; None if it has not moved, for all that is known."""
        if self._speed is None or not np.any(motion.labels == TrackLabel.NEAR):
            return None
        tracks = tracks.select(np.argsort(tracks.ids))
        rays = camera.unproject(tracks.points1)
        return MovedUnseen(ids=tracks.ids, rays=rays, sigma=self._speed * seconds)

    def _end_of(
        self, key: Keyframe, motion: RelativePose, moved: Moved | MovedUnseen | None
    ) -> tuple[np.ndarray, np.ndarray]:
        before = key.covariance, key.world_from_cam, motion
        if isinstance(moved, Moved):
            pose = chain(key.world_from_cam, motion, moved.fit.scale)
            return pose, advance_moving(*before, moved, self._shared)
        # The camera stays where it was last seen; small motions since the keyframe stay in.
        pose = chain(key.world_from_cam, motion, None)
        pose[:3, 3] = self._now.world_from_cam[:3, 3]
        if moved is None:
            return pose, advance_turning(*before, self._shared)
        return pose, advance_unseen(*before, moved, self._shared)

    def _point(self, link: Link, motion: RelativePose, seconds: float) -> PathPoint:
        scale = sigma = None
        if isinstance(link.moved, Moved):
            self._has_scale = True
            if motion.status is PoseStatus.OK:
                scale, sigma = self._length(link, link.moved)
                if seconds > 0.0 and scale > 0.0:
                    self._speed = scale / seconds
        return PathPoint(
            world_from_cam=link.world_from_cam,
            covariance=link.covariance[:7, :7],
            segment=link.segment,
            scale=scale,
            scale_sigma=sigma,
            scale_is_guessed=link.is_guess,
        )

    def _length(self, link: Link, moved: Moved) -> tuple[float, float]:
        """Length of the last step, from frame to frame, and its 1-sigma."""
        fit, last = moved.fit, self._last
        shared = length_variance_shared(link.key.covariance, moved)
        own = fit.scale**2 * float(fit.covariance[0, 0])
        if last is None:
            return fit.scale, math.sqrt(own + fit.scale**2 * shared)
        scale = float(np.linalg.norm(link.world_from_cam[:3, 3] - self._now.world_from_cam[:3, 3]))
        # Both ends hang on one keyframe: an error of its distances changes all lengths since by the
        # same ratio; only the noise of the last of the steps is this one's alone.
        alone = own * (1.0 - fit.gain) / link.steps
        return scale, math.sqrt(alone + scale**2 * (shared + float(fit.covariance[0, 0])))


def _keyframe_at(world_from_cam: np.ndarray, segment: int) -> Keyframe:
    """A keyframe of which nothing is known but where it is said to be."""
    return Keyframe(
        world_from_cam=world_from_cam,
        covariance=covariance_at_rest(),
        depths=Depths.empty(),
        segment=segment,
    )
