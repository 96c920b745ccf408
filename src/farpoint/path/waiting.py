"""Frames whose poses still move with their keyframes."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from farpoint.path.keyframe import Keyframe
from farpoint.path.point import SettledPose

__all__ = ["WaitingPoses", "pose_matrix"]

_LONGEST_WAIT = 150  # frames whose poses are kept for their keyframes to settle


@dataclass(kw_only=True, eq=False)
class _Waiting:
    """A frame's pose, relative to a keyframe that may still move, or as it was settled with it."""

    frame: int
    timestamp: float
    segment: int
    keyframe: Keyframe | None
    R: np.ndarray  # of the frame in the keyframe's axes, or in the world
    p: np.ndarray
    covariance: np.ndarray

    def settle(self) -> None:
        """Put it where its keyframe is now."""
        if self.keyframe is not None:
            R, p = self.keyframe.R, self.keyframe.p
            self.R, self.p, self.keyframe = R @ self.R, R @ self.p + p, None


class WaitingPoses:
    """Poses in the order of their frames, each given once, when it moves no more."""

    def __init__(self) -> None:
        self._poses: deque[_Waiting] = deque()

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
        """A pose in the world, which moves with a keyframe; without one it is settled."""
        if keyframe is not None:
            R, p = keyframe.R.T @ R, keyframe.R.T @ (p - keyframe.p)
        pose = _Waiting(
            frame=frame,
            timestamp=timestamp,
            segment=segment,
            keyframe=keyframe,
            R=R,
            p=p,
            covariance=covariance,
        )
        self._poses.append(pose)

    def settle(self, keyframe: Keyframe) -> None:
        """A keyframe moves no more."""
        for pose in self._poses:
            if pose.keyframe is keyframe:
                pose.settle()

    def settle_all(self) -> None:
        """No keyframe does."""
        for pose in self._poses:
            pose.settle()

    def settled(self) -> list[SettledPose]:
        """Poses that change no more, each given once."""
        found = []
        while self._poses and (self._poses[0].keyframe is None or len(self._poses) > _LONGEST_WAIT):
            pose = self._poses.popleft()
            pose.settle()
            found.append(
                SettledPose(
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
