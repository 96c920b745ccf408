"""When a frame becomes a keyframe, and how much of their errors motions share."""

from __future__ import annotations

from dataclasses import dataclass

from farpoint.errors import InputError
from farpoint.options import settle_float, settle_positive

__all__ = ["PathOptions"]


@dataclass(frozen=True, kw_only=True)
class PathOptions:
    """When a frame becomes the keyframe that later ones are compared with.

    Attributes
    ----------
    keyframe_direction_deg : float
        1-sigma, deg, to which the direction of travel since the last keyframe must be known.
    keyframe_share : float
        Share, 0 to 1, of the keyframe's tracks: with fewer left, it is replaced in any case.
    persistent_motion_share : float
        Share, 0 to 1, of the variances of rotation and direction that all motions have in common:
        trackers err in the same sense again and again.
    persistent_length_share : float
        The same of the logarithms of lengths.
    fading_motion_share : float
        Share, 0 to 1, of the variances of rotation and direction that motions have in common while
        the same things are in view; with the persistent share, 1 at most.
    fading_motions : float
        Number of motions after which that has gone down to 1 / e.
    speed_ratio_sigma : float
        1-sigma of the logarithm of the ratio of two speeds, before and after a turn on the spot
        from which no known point is left in view: that ratio is taken to be 1, and the error of
        the scale grows by this.
    """

    keyframe_direction_deg: float = 1.0
    keyframe_share: float = 0.5
    persistent_motion_share: float = 0.12
    persistent_length_share: float = 0.008
    fading_motion_share: float = 0.3
    fading_motions: float = 12.0
    speed_ratio_sigma: float = 0.5

    def __post_init__(self) -> None:
        settle_positive(self, "keyframe_direction_deg", "fading_motions", "speed_ratio_sigma")
        lengths = "persistent_motion_share", "persistent_length_share", "fading_motion_share"
        settle_float(
            self, "a share, 0 to 1", lambda share: 0 <= share <= 1, "keyframe_share", *lengths
        )
        both = self.persistent_motion_share + self.fading_motion_share
        if both > 1.0:
            raise InputError(
                f"expected 1 at most with persistent_motion_share, got {both} of both",
                field="fading_motion_share",
            )
