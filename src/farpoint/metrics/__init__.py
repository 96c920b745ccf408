"""Errors of estimates, and tests of their covariances.

The functions take arrays and return records; `farpoint.evaluate` reads files.
"""

from farpoint.metrics.alignment import Similarity, align_se3, align_sim3, sim3_misfit
from farpoint.metrics.association import AssociationOptions, poses_at_frames, poses_at_times
from farpoint.metrics.evaluation import (
    Evaluation,
    MotionEvaluation,
    SegmentFigures,
    TrajectoryEvaluation,
    evaluate_motions,
    evaluate_trajectory,
)
from farpoint.metrics.halves import (
    ConsistencyRatio,
    HalvesEvaluation,
    SplitHalf,
    consistency_ratio,
    evaluate_halves,
    image_cells,
    pose_difference,
    split_half,
)
from farpoint.metrics.pairs import (
    PairErrors,
    direction_error,
    pair_errors,
    relative_motions,
    rotation_error,
)
from farpoint.metrics.path_consistency import (
    PathConsistency,
    PathFigure,
    PathSamples,
    evaluate_path,
)
from farpoint.metrics.report import PAIR_COLUMNS, pair_rows, to_json, to_text
from farpoint.metrics.statistics import (
    Consistency,
    Coverage,
    Summary,
    binomial_interval,
    chi2_quantile,
    consistency,
    coverage,
    nees,
    summarize,
    total_sigma,
)
from farpoint.metrics.stretches import STRETCH_SHARES, StretchFigure, evaluate_stretches
from farpoint.metrics.trajectories import (
    KITTI_LENGTHS_M,
    RelativeErrors,
    SegmentErrors,
    absolute_errors,
    kitti_segment_errors,
    path_length,
    relative_errors,
    scale_drift,
)

__all__ = [
    "KITTI_LENGTHS_M",
    "PAIR_COLUMNS",
    "STRETCH_SHARES",
    "AssociationOptions",
    "Consistency",
    "ConsistencyRatio",
    "Coverage",
    "Evaluation",
    "HalvesEvaluation",
    "MotionEvaluation",
    "PairErrors",
    "PathConsistency",
    "PathFigure",
    "PathSamples",
    "RelativeErrors",
    "SegmentErrors",
    "SegmentFigures",
    "Similarity",
    "SplitHalf",
    "StretchFigure",
    "Summary",
    "TrajectoryEvaluation",
    "absolute_errors",
    "align_se3",
    "align_sim3",
    "binomial_interval",
    "chi2_quantile",
    "consistency",
    "consistency_ratio",
    "coverage",
    "direction_error",
    "evaluate_halves",
    "evaluate_motions",
    "evaluate_path",
    "evaluate_stretches",
    "evaluate_trajectory",
    "image_cells",
    "kitti_segment_errors",
    "nees",
    "pair_errors",
    "pair_rows",
    "path_length",
    "pose_difference",
    "poses_at_frames",
    "poses_at_times",
    "relative_errors",
    "relative_motions",
    "rotation_error",
    "scale_drift",
    "sim3_misfit",
    "split_half",
    "summarize",
    "to_json",
    "to_text",
    "total_sigma",
]
