"""Options of the odometry, a record for each stage."""

from __future__ import annotations

from dataclasses import dataclass, field

from farpoint.pose import RelativePoseOptions
from farpoint.tracks import TrackerOptions
from farpoint.trajectory.options import PathOptions

__all__ = ["OdometryOptions"]


@dataclass(frozen=True, kw_only=True)
class OdometryOptions:
    """Options of `Odometry`, one record for each stage.

    Attributes
    ----------
    tracker : TrackerOptions
        How points are found and followed.
    pose : RelativePoseOptions
        How the motion is estimated from them. By default `shared_error_px` is 0.002: what the
        tracker's windows were seen to have in common on rendered streets; and `half_deals` is 8.
        `expected_half_ratio` is that of the first pair, from which it goes on.
    path : PathOptions
        How motions are strung together.
    seed : int
        Of the random samples.
    """

    tracker: TrackerOptions = field(default_factory=TrackerOptions)
    pose: RelativePoseOptions = field(
        default_factory=lambda: RelativePoseOptions(shared_error_px=0.002, half_deals=8)
    )
    path: PathOptions = field(default_factory=PathOptions)
    seed: int = 0
