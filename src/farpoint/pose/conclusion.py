"""Every way an estimate can end: the record for each status, with its words."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np

from farpoint._kernels.vectors import tangent_columns
from farpoint.pose.matches import Matches
from farpoint.pose.result import PoseStats, PoseStatus, RelativePose, TrackLabel

__all__ = [
    "Course",
    "failed_pose",
    "given_labels",
    "label_matches",
    "no_consensus",
    "observed",
    "turned",
    "unfixed_rotation",
]


@dataclass
class Course:
    """How an estimate went, written down along the way.

    A stage's seconds end when the next stage begins. Remarks are for whoever reads the reason.
    """

    remarks: tuple[str, ...] = ()
    iterations: int = 0
    cost: float | None = None
    sign_probability: float | None = None
    sharing: float = 1.0
    half_ratio: float | None = None
    search_s: float = 0.0
    refinement_s: float = 0.0
    covariance_s: float = 0.0
    _since: float = field(default_factory=time.perf_counter)

    def remark(self, sentence: str) -> None:
        """Add a sentence to the reason."""
        self.remarks += (sentence,)

    def lap(self, stage: str) -> None:
        """Book the time since the last lap on ``stage``."""
        now = time.perf_counter()
        setattr(self, stage, getattr(self, stage) + now - self._since)
        self._since = now


def label_matches(
    matches: Matches, right: np.ndarray, near: np.ndarray | None = None
) -> np.ndarray:
    """Labels (total,) of what the user gave, from masks (N,) over the matches used."""
    labels = right.astype(np.uint8)  # TrackLabel.FAR is 1, NEAR 2
    if near is not None:
        labels += right & near
    return given_labels(matches, labels)


def given_labels(matches: Matches, labels: np.ndarray) -> np.ndarray:
    """Labels (total,) of what the user gave, from those (N,) of the matches used."""
    if len(labels) == matches.total:
        return labels
    given = np.full(matches.total, TrackLabel.OUTLIER, np.uint8)
    given[matches.index] = labels
    return given


def no_consensus(matches: Matches, agreeing: int, course: Course) -> RelativePose:
    """The best motion found is one that chance alone could have made."""
    return failed_pose(
        f"No consensus: the best motion explains {agreeing} of {len(matches)} matches, "
        "which chance alone could do.",
        matches.total,
        course,
    )


def unfixed_rotation(matches: Matches, course: Course) -> RelativePose:
    """Matches at one point, or on a line, or of which hardly any is backed by others."""
    return failed_pose(
        f"Those of the {len(matches)} matches that agree are too few, or lie too close together, "
        "to fix a rotation.",
        matches.total,
        course,
    )


def observed(
    R: np.ndarray,
    direction: np.ndarray,
    covariance: np.ndarray,
    direction_sigma: float,
    labels: np.ndarray,
    noise: float,
    course: Course,
    because: str = "",
) -> RelativePose:
    """Rotation and direction, each with covariance; the worst 1-sigma of the direction, rad.

    ``because`` is a sentence of what makes it so.
    """
    stats = _stats(labels, course)
    sigma_deg = math.degrees(direction_sigma)
    first, second = tangent_columns(tuple(direction.tolist()))
    return RelativePose(
        status=PoseStatus.OK,
        reason=_said(
            f"{stats.near} near and {stats.far} far matches agree on one motion; "
            f"its direction is known to {sigma_deg:.2g} deg.",
            because,
            *course.remarks,
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


def turned(
    status: PoseStatus,
    reason: str,
    R: np.ndarray,
    rotation_covariance: np.ndarray,
    labels: np.ndarray,
    noise: float,
    course: Course,
) -> RelativePose:
    """Rotation alone: the camera only turned, stood still, or its direction is not observable."""
    return RelativePose(
        status=status,
        reason=_said(reason, *course.remarks),
        rotation_cam1_from_cam0=R,
        rotation_covariance=rotation_covariance,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
        labels=labels,
        noise_px=noise,
        stats=_stats(labels, course),
    )


def failed_pose(reason: str, total: int = 0, course: Course | None = None) -> RelativePose:
    """No rotation can be trusted: ``total`` matches were given, all of them OUTLIER."""
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
        stats=_stats(labels, course or Course()),
    )


def _said(*sentences: str) -> str:
    """Those that are not empty, one after the other."""
    return " ".join(filter(None, sentences))


def _stats(labels: np.ndarray, course: Course) -> PoseStats:
    each = labels.tobytes()
    return PoseStats(
        matches=len(each),
        far=each.count(TrackLabel.FAR),
        near=each.count(TrackLabel.NEAR),
        outliers=each.count(TrackLabel.OUTLIER),
        iterations=course.iterations,
        cost=course.cost,
        sign_probability=course.sign_probability,
        sharing=course.sharing,
        half_ratio=course.half_ratio,
        search_s=course.search_s,
        refinement_s=course.refinement_s,
        covariance_s=course.covariance_s,
    )
