"""Keyframes, and the link from the last of them to the frame of now."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.pose import PoseStatus, RelativePose, TrackLabel
from farpoint.tracks import Tracks
from farpoint.trajectory.depths import Depths
from farpoint.trajectory.moved import Moved, MovedUnseen
from farpoint.trajectory.uncertainty import condense

__all__ = ["Keyframe", "Link", "good_tracks", "is_firm", "join_tracks"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Keyframe:
    """A frame that later ones are compared with.

    Attributes
    ----------
    world_from_cam : ndarray, shape (4, 4)
        Its pose.
    covariance : ndarray, shape (26, 26)
        As `farpoint.trajectory.uncertainty` has it.
    depths : Depths
        What is known of the tracks that it sees.
    segment : int
        Of the trajectory.
    """

    world_from_cam: np.ndarray
    covariance: np.ndarray
    depths: Depths
    segment: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """The motion from a keyframe to another frame.

    Attributes
    ----------
    key : Keyframe
        Where it begins.
    tracks : Tracks
        Good matches between the two.
    begun : int
        Tracks that the keyframe had.
    steps : int
        Motions from frame to frame since the keyframe, this one included.
    seconds : float
        Time since the keyframe.
    motion : RelativePose
        Not FAILED.
    moved : Moved or MovedUnseen or None
        None where there was no translation, or none is known to have been.
    world_from_cam : ndarray, shape (4, 4)
        Pose of the other frame.
    covariance : ndarray, shape (26, 26), (29, 29) or (32, 32)
        As that of `Keyframe`; of a moved camera with the errors of the motion.
    segment : int
        That of the keyframe, or the next one where the motion began it.
    """

    key: Keyframe
    tracks: Tracks
    begun: int
    steps: int
    seconds: float
    motion: RelativePose
    moved: Moved | MovedUnseen | None
    world_from_cam: np.ndarray
    covariance: np.ndarray
    segment: int

    @property
    def is_guess(self) -> bool:
        """Whether its length is guessed."""
        return isinstance(self.moved, Moved) and self.moved.fit.is_guess

    def end(self) -> Keyframe:
        """The other frame as the keyframe of what follows."""
        depths, covariance = self.key.depths, self.covariance
        if self.moved is not None:  # turning leaves distances as they are
            depths, axes = self.moved.carry_on(depths).condense()
            covariance = condense(covariance, axes)
        return Keyframe(
            world_from_cam=self.world_from_cam,
            covariance=covariance,
            depths=depths,
            segment=self.segment,
        )


def is_firm(motion: RelativePose, direction_sigma_rad: float) -> bool:
    """Whether a direction is known to this 1-sigma."""
    covariance = motion.covariance
    return (
        motion.status is PoseStatus.OK
        and covariance is not None
        and float(np.linalg.eigvalsh(covariance[3:, 3:])[-1]) <= direction_sigma_rad**2
    )


def good_tracks(tracks: Tracks, motion: RelativePose) -> Tracks:
    """Those that the motion explains."""
    return tracks.select(motion.labels != TrackLabel.OUTLIER)


def join_tracks(first: Tracks, second: Tracks) -> Tracks:
    """Matches over two steps, of tracks in both; the errors of the steps add up."""
    _, row0, row1 = np.intersect1d(first.ids, second.ids, assume_unique=True, return_indices=True)
    return Tracks(
        ids=first.ids[row0],
        points0=first.points0[row0],
        points1=second.points1[row1],
        covariance_px2=first.covariance_px2[row0] + second.covariance_px2[row1],
    )
