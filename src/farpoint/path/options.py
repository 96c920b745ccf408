"""What a user can choose about the path, and about the lens that is found along it."""

from __future__ import annotations

from dataclasses import dataclass

from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_int, coerce_positive

__all__ = ["LensRefinementOptions", "PathOptions"]


@dataclass(frozen=True, kw_only=True)
class PathOptions:
    """The window over keyframes.

    Attributes
    ----------
    keyframes : int
        How many the window holds; time for a frame grows with it.
    keyframe_flow_px : float
        A frame becomes a keyframe when tracks have moved by this since the last one, px, median.
    keyframe_share : float
        Or when a smaller share of the keyframe's tracks, 0 to 1, is left.
    max_tracks : int
        Tracks that the window takes of each frame, at most.
    speed_ratio_sigma : float
        1-sigma of the logarithm of the ratio of two speeds, before and after a turn on the spot
        from which no known point is left in view: that ratio is taken to be 1, and the error of
        the scale grows by this.
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
    """How far lens and shutter may be from what the calibration says; its own sigmas come first.

    Attributes
    ----------
    refine : bool
        Estimate lens and shutter along the path; otherwise the calibration is believed.
    focal_sigma : float
        Relative 1-sigma of the focal length, of a calibration without sigmas.
    center_sigma_px : float
        1-sigma of each coordinate of the principal point, px, of such a calibration.
    distortion_sigma_px : float
        1-sigma of the displacement by distortion at the corner of the image, px, of such a one.
    readout_ms : float or None
        Read-out time of a frame, first row to last, ms; 0 for a global shutter. None: that of the
        calibration, or estimated.
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
