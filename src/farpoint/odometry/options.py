"""Options of the odometry, a record for each stage."""

from __future__ import annotations

from dataclasses import dataclass, field

from farpoint.path.options import LensRefinementOptions, PathOptions
from farpoint.pose import RelativePoseOptions
from farpoint.tracks import TrackerOptions

__all__ = ["OdometryOptions"]


@dataclass(frozen=True, kw_only=True)
class OdometryOptions:
    """Options of `Odometry`, grouped by stage.

    Attributes
    ----------
    tracker : TrackerOptions
        Detection and tracking of points.
    pose : RelativePoseOptions
        Options of the two-view estimate. By default `shared_error_px` is 0.002, the common error of
        tracks on rendered street scenes. `half_splits` is 8. `common_error_slope` is 10,
        measured on compressed video of street scenes.
    path : PathOptions
        Options of the sliding window of keyframes.
    lens : LensRefinementOptions
        Prior uncertainty of lens and shutter.
    seed : int
        Seed of the random samples.
    """

    tracker: TrackerOptions = field(default_factory=TrackerOptions)
    pose: RelativePoseOptions = field(
        default_factory=lambda: RelativePoseOptions(
            shared_error_px=0.002, half_splits=8, common_error_slope=10.0
        )
    )
    path: PathOptions = field(default_factory=PathOptions)
    lens: LensRefinementOptions = field(default_factory=LensRefinementOptions)
    seed: int = 0
