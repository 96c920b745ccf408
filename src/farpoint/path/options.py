"""Options of the path and of the lens refinement."""

from __future__ import annotations

from dataclasses import dataclass

from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_int, coerce_positive

__all__ = ["LensRefinementOptions", "PathOptions"]


@dataclass(frozen=True, kw_only=True)
class PathOptions:
    """Options of the keyframe window.

    Attributes
    ----------
    keyframes : int
        Number of keyframes in the window.
    keyframe_flow_px : float
        Median flow since the last keyframe, px, above which a frame becomes a keyframe.
    keyframe_share : float
        A frame becomes a keyframe if the share of the last keyframe's tracks that are still
        followed, 0 to 1, is below this limit.
    max_tracks : int
        Largest number of tracks of each keyframe in the window.
    speed_ratio_sigma : float
        1-sigma of the logarithm of the ratio of the speeds after and before a pure rotation that
        leaves no landmark in view. The scale after the rotation follows from equal speeds (ratio
        1), and the square of this 1-sigma is added to the variance of the logarithmic scale.
    """

    keyframes: int = 12
    keyframe_flow_px: float = 30.0
    keyframe_share: float = 0.7
    max_tracks: int = 200
    speed_ratio_sigma: float = 0.5

    def __post_init__(self) -> None:
        coerce_int(self, 3, "keyframes")
        coerce_int(self, 20, "max_tracks")
        coerce_positive(self, "keyframe_flow_px", "speed_ratio_sigma")
        coerce_float(self, "a share, 0 to 1", lambda share: 0 <= share <= 1, "keyframe_share")


@dataclass(frozen=True, kw_only=True)
class LensRefinementOptions:
    """Prior uncertainty of lens and shutter. Sigmas in the calibration take precedence.

    Attributes
    ----------
    refine : bool
        Estimate lens and shutter along the path. False keeps lens and shutter as given.
    focal_sigma : float
        Relative 1-sigma of the focal length, for a calibration without sigmas.
    center_sigma_px : float
        1-sigma of each coordinate of the principal point, px.
    distortion_sigma_px : float
        1-sigma of the displacement by distortion at the image corner, px.
    readout_ms : float or None
        Read-out time of a frame, first row to last, ms; 0 for a global shutter. None takes the
        read-out time of the calibration. If the calibration has none, the read-out time is
        estimated, or taken as 0 if ``refine`` is False.
    """

    refine: bool = True
    focal_sigma: float = 0.03
    center_sigma_px: float = 1.0
    distortion_sigma_px: float = 4.0
    readout_ms: float | None = None

    def __post_init__(self) -> None:
        coerce_positive(self, "focal_sigma", "center_sigma_px", "distortion_sigma_px")
        if self.readout_ms is not None:
            coerce_float(self, "0 or more", lambda value: value >= 0, "readout_ms")
            if self.readout_ms > 1e6:
                raise InputError(
                    f"expected 1e6 at most, got {self.readout_ms:g}", field="readout_ms"
                )
