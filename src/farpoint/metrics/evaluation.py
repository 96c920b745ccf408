"""The figures of a whole run: its motions and its trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.metrics.alignment import align_se3, align_sim3
from farpoint.metrics.halves import HalvesEvaluation
from farpoint.metrics.pairs import PairErrors
from farpoint.metrics.path_consistency import PathConsistency
from farpoint.metrics.statistics import (
    Consistency,
    Summary,
    consistency,
    summarize,
    total_sigma,
)
from farpoint.metrics.stretches import StretchFigure
from farpoint.metrics.trajectories import (
    SegmentErrors,
    absolute_errors,
    kitti_segment_errors,
    path_length,
    relative_errors,
    scale_drift,
)
from farpoint.pose import PoseStatus

__all__ = [
    "Evaluation",
    "MotionEvaluation",
    "SegmentFigures",
    "TrajectoryEvaluation",
    "evaluate_motions",
    "evaluate_trajectory",
]


@dataclass(frozen=True, kw_only=True)
class MotionEvaluation:
    """Motions of frame pairs against the truth.

    Attributes
    ----------
    pairs, pairs_with_truth : int
        Number of all pairs, and of the pairs whose true motion is known.
    statuses : dict of str to int
        Number of pairs with each status, with or without truth.
    min_translation : float
        Shortest true translation whose direction is compared, in the unit of the truth.
    directions_not_counted : int
        Number of directions that were not compared, because the true translation is shorter than
        ``min_translation``.
    directions_opposed : int
        Number of directions with an error of 90 degrees or more.
    rotation_rad, direction_rad : Summary
        Sizes of the errors, rad.
    rotation_sigma_rad, direction_sigma_rad : Summary
        Sharpness, rad, which is ``sqrt(trace)`` of each covariance, for all pairs with or without
        truth.
    rotation, direction, pose : Consistency
        Comparison of the errors with their covariances, for 3, 2 and 5 degrees of freedom, rad.
    """

    pairs: int
    pairs_with_truth: int
    statuses: dict[str, int]
    min_translation: float
    directions_not_counted: int
    directions_opposed: int
    rotation_rad: Summary
    direction_rad: Summary
    rotation_sigma_rad: Summary
    direction_sigma_rad: Summary
    rotation: Consistency
    direction: Consistency
    pose: Consistency


@dataclass(frozen=True, kw_only=True)
class SegmentFigures:
    """KITTI's segment errors, averaged over the segments of one length or over all segments.

    Attributes
    ----------
    length : float or None
        Length of the segments, in the unit of the truth; None for all lengths together.
    count : int
        Number of segments.
    translation_ratio : float
        Mean error of translation per length.
    rotation_rad_per_length : float
        Mean error of rotation per length, rad per unit of the truth.
    """

    length: float | None
    count: int
    translation_ratio: float
    rotation_rad_per_length: float


@dataclass(frozen=True, kw_only=True)
class TrajectoryEvaluation:
    """A trajectory against the truth; lengths are in the unit of the truth.

    Attributes
    ----------
    poses : int
        Number of compared poses.
    path_length : float
        Length of the true path through the compared poses.
    scale : float
        Factor from the unit of the estimate to the unit of the truth, from the Sim(3) alignment.
    scale_drift : float
        Relative change of the scale of the estimate from the first 20 % of the true path to the
        last 20 %.
    ate_sim3, ate_se3 : Summary
        Distances of positions after alignment with and without scale. The ``rmse`` is the ATE.
    delta_frames : int
        Number of frames over which relative errors are computed.
    rpe_translation, rpe_rotation_rad : Summary
        Relative pose errors after the Sim(3) alignment; rotations in rad.
    segments : tuple of SegmentFigures
        KITTI's segment errors after the Sim(3) alignment, first for each length, then for all
        lengths together. Empty if the true path is shorter than 100 units of the truth.
    """

    poses: int
    path_length: float
    scale: float
    scale_drift: float
    ate_sim3: Summary
    ate_se3: Summary
    delta_frames: int
    rpe_translation: Summary
    rpe_rotation_rad: Summary
    segments: tuple[SegmentFigures, ...]


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """All figures of a run.

    Attributes
    ----------
    motions : MotionEvaluation
        Figures of the motions of all frame pairs.
    trajectory : TrajectoryEvaluation or None
        Figures of the trajectory; None if the trajectory cannot be compared.
    trajectory_fault : str or None
        Reason why `trajectory` is None.
    path : PathConsistency or None
        Errors of the poses against their covariances; None without covariances.
    stretches : tuple of StretchFigure
        Errors of the length and the rotation of stretches of the path. Empty without truth or
        without covariances.
    halves : HalvesEvaluation or None
        Figures of the split-half test; None if the run made no test.
    """

    motions: MotionEvaluation
    trajectory: TrajectoryEvaluation | None
    trajectory_fault: str | None = None
    path: PathConsistency | None = None
    stretches: tuple[StretchFigure, ...] = ()
    halves: HalvesEvaluation | None = None


def evaluate_motions(errors: PairErrors) -> MotionEvaluation:
    """Figures of the motions of a run from its `pair_errors`."""
    given = [status.value for status in errors.statuses]
    return MotionEvaluation(
        pairs=len(errors),
        pairs_with_truth=int(np.count_nonzero(errors.has_truth)),
        statuses={status.value: given.count(status.value) for status in PoseStatus},
        min_translation=errors.min_translation,
        directions_not_counted=errors.directions_not_counted,
        directions_opposed=errors.directions_opposed,
        rotation_rad=summarize(errors.rotation_angle_rad),
        direction_rad=summarize(errors.direction_angle_rad),
        rotation_sigma_rad=summarize(total_sigma(errors.covariances[:, :3, :3])),
        direction_sigma_rad=summarize(total_sigma(errors.covariances[:, 3:, 3:])),
        rotation=consistency(errors.errors[:, :3], errors.covariances[:, :3, :3]),
        direction=consistency(errors.errors[:, 3:], errors.covariances[:, 3:, 3:]),
        pose=consistency(errors.errors, errors.covariances),
    )


def evaluate_trajectory(
    estimate: np.ndarray, truth: np.ndarray, *, delta_frames: int = 1
) -> TrajectoryEvaluation:
    """Figures of a trajectory against the truth, both given as ``world_from_cam`` (N, 4, 4).

    The estimate and the truth may have different worlds and different scales.

    Raises
    ------
    InputError
        If shapes differ, or if the positions lie on one line, so that the alignment is not unique.
    """
    similarity = align_sim3(estimate[:, :3, 3], truth[:, :3, 3])
    scaled = similarity.apply_to_poses(estimate)
    rigid = align_se3(estimate[:, :3, 3], truth[:, :3, 3]).apply_to_poses(estimate)
    relative = relative_errors(scaled, truth, delta_frames=delta_frames)
    return TrajectoryEvaluation(
        poses=len(truth),
        path_length=path_length(truth),
        scale=similarity.scale,
        scale_drift=scale_drift(estimate, truth),
        ate_sim3=summarize(absolute_errors(scaled, truth)),
        ate_se3=summarize(absolute_errors(rigid, truth)),
        delta_frames=delta_frames,
        rpe_translation=summarize(relative.translation),
        rpe_rotation_rad=summarize(relative.rotation_rad),
        segments=_segment_figures(kitti_segment_errors(scaled, truth)),
    )


def _segment_figures(errors: SegmentErrors) -> tuple[SegmentFigures, ...]:
    lengths: list[float | None] = [float(length) for length in np.unique(errors.length)]
    if not lengths:
        return ()
    figures = []
    for length in [*lengths, None]:
        chosen = errors.length == length if length is not None else errors.length > 0.0
        figures.append(
            SegmentFigures(
                length=length,
                count=int(np.count_nonzero(chosen)),
                translation_ratio=float(np.mean(errors.translation_ratio[chosen])),
                rotation_rad_per_length=float(np.mean(errors.rotation_rad_per_length[chosen])),
            )
        )
    return tuple(figures)
