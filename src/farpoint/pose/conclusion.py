"""Functions that build the result for each status, with the reason of the status."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np

from farpoint._kernels.vectors import tangent_columns
from farpoint.pose.certainty import direction_sigma
from farpoint.pose.matches import Matches
from farpoint.pose.result import PoseStats, PoseStatus, RelativePose, TrackLabel

__all__ = [
    "Diagnostics",
    "failed_pose",
    "full_labels",
    "label_matches",
    "no_consensus",
    "observed",
    "undetermined_rotation",
    "with_covariance",
    "without_direction",
]


@dataclass
class Diagnostics:
    """Diagnostics of an estimate, collected stage by stage.

    The stages follow each other without gaps: a stage begins when the previous stage ends. Notes
    are sentences that are appended to the ``reason`` of the result.
    """

    notes: tuple[str, ...] = ()
    iterations: int = 0
    cost: float | None = None
    sign_probability: float | None = None
    design_effect: float = 1.0
    split_half_ratio: float | None = None
    residual_correlation: float | None = None
    search_s: float = 0.0
    refinement_s: float = 0.0
    covariance_s: float = 0.0
    _since: float = field(default_factory=time.perf_counter)

    def note(self, sentence: str) -> None:
        """Append a sentence to the reason."""
        self.notes += (sentence,)

    def time_stage(self, stage: str) -> None:
        """Add the time since the last call, or since the creation, to the time of ``stage``."""
        now = time.perf_counter()
        setattr(self, stage, getattr(self, stage) + now - self._since)
        self._since = now


def label_matches(
    matches: Matches, inlier: np.ndarray, near: np.ndarray | None = None
) -> np.ndarray:
    """Labels (total,) of all given matches, from two masks (N,) of the matches that are used."""
    labels = inlier.astype(np.uint8)  # TrackLabel.FAR is 1, NEAR 2
    if near is not None:
        labels += inlier & near
    return full_labels(matches, labels)


def full_labels(matches: Matches, labels: np.ndarray) -> np.ndarray:
    """Labels (total,) of all given matches, from the labels (N,) of the matches that are used."""
    if len(labels) == matches.total:
        return labels
    full = np.full(matches.total, TrackLabel.OUTLIER, np.uint8)
    full[matches.index] = labels
    return full


def no_consensus(matches: Matches, agreeing: int, diagnostics: Diagnostics) -> RelativePose:
    """FAILED pose: so few matches agree with the best motion that chance may be the reason."""
    return failed_pose(
        f"No consensus: the best motion has {agreeing} inliers of {len(matches)} matches, "
        "no more than chance.",
        matches.total,
        diagnostics,
    )


def undetermined_rotation(matches: Matches, diagnostics: Diagnostics) -> RelativePose:
    """FAILED pose: the inliers are too few or too close together to fix the rotation."""
    return failed_pose(
        f"Rotation not observable: the inliers among {len(matches)} matches are too few or too "
        "close together in the image.",
        matches.total,
        diagnostics,
    )


def observed(
    R: np.ndarray,
    direction: np.ndarray,
    covariance: np.ndarray,
    largest_direction_sigma: float,
    labels: np.ndarray,
    noise: float,
    diagnostics: Diagnostics,
    detail: str = "",
) -> RelativePose:
    """OK pose with rotation, direction and covariance.

    ``largest_direction_sigma`` is the largest 1-sigma of the direction, rad. ``detail`` is a
    further sentence of the reason.
    """
    stats = _stats(labels, diagnostics)
    first, second = tangent_columns(tuple(direction.tolist()))
    return RelativePose(
        status=PoseStatus.OK,
        reason=_joined(
            f"General motion: {stats.near} near and {stats.far} far matches agree on one motion; "
            f"its direction has a {_sigma_text(largest_direction_sigma)}.",
            detail,
            *diagnostics.notes,
        ),
        rotation_cam1_from_cam0=R,
        rotation_covariance=covariance[:3, :3].copy(),
        direction_cam1_from_cam0=direction,
        direction_basis=np.array([*zip(first, second, strict=True)]),
        covariance=covariance,
        labels=labels,
        noise_px=noise,
        stats=stats,
    )


def with_covariance(pose: RelativePose, covariance: np.ndarray) -> RelativePose:
    """The OK pose with a new covariance (5, 5), rad^2; the reason states the new 1-sigma."""
    assert pose.covariance is not None
    before, after = (_sigma_text(direction_sigma(C)) for C in (pose.covariance, covariance))
    return replace(
        pose,
        reason=pose.reason.replace(before, after, 1),
        rotation_covariance=covariance[:3, :3].copy(),
        covariance=covariance,
    )


def _sigma_text(sigma_rad: float) -> str:
    return f"1-sigma of {math.degrees(sigma_rad):.2g} deg"


def without_direction(
    status: PoseStatus,
    reason: str,
    R: np.ndarray,
    rotation_covariance: np.ndarray,
    labels: np.ndarray,
    noise: float,
    diagnostics: Diagnostics,
) -> RelativePose:
    """ROTATION_ONLY or STATIC pose, which has a rotation with covariance but no direction."""
    return RelativePose(
        status=status,
        reason=_joined(reason, *diagnostics.notes),
        rotation_cam1_from_cam0=R,
        rotation_covariance=rotation_covariance,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
        labels=labels,
        noise_px=noise,
        stats=_stats(labels, diagnostics),
    )


def failed_pose(
    reason: str, total: int = 0, diagnostics: Diagnostics | None = None
) -> RelativePose:
    """FAILED pose without rotation and direction. All ``total`` given matches are OUTLIER."""
    labels = np.full(total, TrackLabel.OUTLIER, np.uint8)
    return RelativePose(
        status=PoseStatus.FAILED,
        reason=reason,
        rotation_cam1_from_cam0=None,
        rotation_covariance=None,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
        labels=labels,
        noise_px=None,
        stats=_stats(labels, diagnostics or Diagnostics()),
    )


def _joined(*sentences: str) -> str:
    """All non-empty sentences in one line."""
    return " ".join(filter(None, sentences))


def _stats(labels: np.ndarray, diagnostics: Diagnostics) -> PoseStats:
    each = labels.tobytes()
    return PoseStats(
        matches=len(each),
        far=each.count(TrackLabel.FAR),
        near=each.count(TrackLabel.NEAR),
        outliers=each.count(TrackLabel.OUTLIER),
        iterations=diagnostics.iterations,
        cost=diagnostics.cost,
        sign_probability=diagnostics.sign_probability,
        sharing=diagnostics.design_effect,
        half_ratio=diagnostics.split_half_ratio,
        residual_correlation=diagnostics.residual_correlation,
        search_s=diagnostics.search_s,
        refinement_s=diagnostics.refinement_s,
        covariance_s=diagnostics.covariance_s,
    )
