"""Frame poses that move with the keyframes of the window until the poses are final."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from farpoint.geometry import so3
from farpoint.path.constants import MAX_PENDING_FRAMES
from farpoint.path.keyframe import Keyframe
from farpoint.path.point import FinalPose

__all__ = ["Correction", "PendingPoses", "pose_matrix"]


@dataclass(kw_only=True, eq=False)
class _Pending:
    """Pose of a frame, relative to a keyframe of the window or, if final, in the world."""

    frame: int
    timestamp: float
    segment: int
    keyframe: Keyframe | None
    R: np.ndarray  # from frame axes to keyframe axes; if final, to world axes
    p: np.ndarray
    covariance: np.ndarray

    def freeze(self) -> None:
        """Convert the pose to world axes with the current pose of the keyframe."""
        if self.keyframe is not None:
            R, p = self.keyframe.R, self.keyframe.p
            self.R, self.p, self.keyframe = R @ self.R, R @ self.p + p, None


class Correction:
    """Changes of keyframe poses, interpolated in time for the poses between the keyframes.

    Parameters
    ----------
    keyframes : sequence of Keyframe
        Keyframes before the change, in ascending order of time.
    """

    def __init__(self, keyframes: Sequence[Keyframe]) -> None:
        self._keyframes = list(keyframes)
        self._before = {id(key): (key.R, key.p) for key in keyframes}

    def at(self, timestamp: float) -> np.ndarray:
        """Change (6,) at a time, as rotation vector and shift: linear between the keyframes."""
        changes = []
        for key in self._keyframes:
            R, p = self._before[id(key)]
            changes.append(np.concatenate([so3.log(key.R @ R.T), key.p - p]))
        times = [key.timestamp for key in self._keyframes]
        return np.array([np.interp(timestamp, times, each) for each in np.transpose(changes)])

    def move(self, pose: _Pending) -> None:
        """Apply the change at the time of a pose that is attached to one of the keyframes."""
        key = pose.keyframe
        if key is None or id(key) not in self._before:
            return
        R, p = self._before[id(key)]
        change = self.at(pose.timestamp)
        moved, at = so3.exp(change[:3]) @ R @ pose.R, R @ pose.p + p + change[3:]
        pose.R, pose.p = key.R.T @ moved, key.R.T @ (at - key.p)


class PendingPoses:
    """Queue of frame poses. Each pose is returned once, when it is final.

    A pose is final when its keyframe leaves the window (`freeze`), when it is the oldest of more
    than 150 poses in the queue, or after `freeze_all`.
    """

    def __init__(self) -> None:
        self._poses: deque[_Pending] = deque()

    def add(
        self,
        keyframe: Keyframe | None,
        *,
        frame: int,
        timestamp: float,
        segment: int,
        R: np.ndarray,
        p: np.ndarray,
        covariance: np.ndarray,
    ) -> None:
        """Add a pose in the world, attached to a keyframe. A pose without a keyframe is final."""
        if keyframe is not None:
            R, p = keyframe.R.T @ R, keyframe.R.T @ (p - keyframe.p)
        pose = _Pending(
            frame=frame,
            timestamp=timestamp,
            segment=segment,
            keyframe=keyframe,
            R=R,
            p=p,
            covariance=covariance,
        )
        self._poses.append(pose)

    def freeze(self, keyframe: Keyframe) -> None:
        """Make the poses attached to a keyframe final."""
        for pose in self._poses:
            if pose.keyframe is keyframe:
                pose.freeze()

    def correct(self, correction: Correction) -> None:
        """Apply a correction to all poses that are attached to keyframes of the correction."""
        for pose in self._poses:
            correction.move(pose)

    def freeze_all(self) -> None:
        """Make all poses final."""
        for pose in self._poses:
            pose.freeze()

    def final_poses(self) -> list[FinalPose]:
        """Poses that became final since the last call, in the order of their frames."""
        found = []
        while self._poses and (
            self._poses[0].keyframe is None or len(self._poses) > MAX_PENDING_FRAMES
        ):
            pose = self._poses.popleft()
            pose.freeze()
            found.append(
                FinalPose(
                    frame1=pose.frame,
                    timestamp=pose.timestamp,
                    segment=pose.segment,
                    world_from_cam=pose_matrix(pose.R, pose.p),
                    world_covariance=pose.covariance,
                )
            )
        return found


def pose_matrix(R: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) and position (3,) as one matrix (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, p
    return pose
