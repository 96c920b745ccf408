"""Paths with true poses, in the form that the metrics take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from farpoint.metrics import PathSamples
from farpoint.odometry import OdometryResult
from farpoint.path.point import FinalPose, PathPoint

__all__ = ["joined", "samples_of"]


def samples_of(
    poses: Sequence[FinalPose],
    truth: np.ndarray,
    motions: Sequence[OdometryResult] | Sequence[PathPoint] | None = None,
    length_from: Sequence[int] | None = None,
) -> PathSamples:
    """Samples of the final poses of a run, with the true poses (N, 4, 4) of all frames.

    ``motions`` are the results at each frame, from which the lengths of the motions are taken.
    ``length_from`` are the frames at which these lengths begin. Without ``motions`` all lengths are
    missing.
    """
    frames = [pose.frame1 for pose in poses]
    lengths, sigmas = np.full((2, len(frames)), np.nan)
    if motions is not None:
        for row, frame in enumerate(frames):
            scale, sigma = motions[frame].scale, motions[frame].scale_sigma
            if scale is not None and sigma is not None:
                lengths[row], sigmas[row] = scale, sigma
    return PathSamples(
        segments=np.array([pose.segment for pose in poses]),
        world_from_cam=np.array([pose.world_from_cam for pose in poses]),
        covariances=np.array([pose.world_covariance for pose in poses]),
        truth=truth[frames],
        lengths=lengths,
        length_sigmas=sigmas,
        length_from=np.zeros(len(frames), int) if length_from is None else np.array(length_from),
    )


def joined(drives: Sequence[PathSamples]) -> PathSamples:
    """Several drives as segments of one path."""
    counts = [len(drive.segments) for drive in drives]
    rows = np.cumsum([0, *counts[:-1]])
    numbers = np.cumsum([0, *(int(drive.segments[-1]) + 1 for drive in drives[:-1])])
    same = ("world_from_cam", "covariances", "truth", "lengths", "length_sigmas")
    return PathSamples(
        segments=np.concatenate([d.segments + n for d, n in zip(drives, numbers, strict=True)]),
        length_from=np.concatenate([d.length_from + n for d, n in zip(drives, rows, strict=True)]),
        **{name: np.concatenate([getattr(drive, name) for drive in drives]) for name in same},
    )
