"""Options of the tracker, grouped by stage."""

from __future__ import annotations

from dataclasses import dataclass, field

from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_int, coerce_positive
from farpoint.tracks.constants import MAX_WINDOW_PX

__all__ = ["CornerOptions", "LucasKanadeOptions", "RefinementOptions", "TrackerOptions"]


@dataclass(frozen=True, kw_only=True)
class CornerOptions:
    """Options of corner detection.

    Attributes
    ----------
    cell_px : int
        Side of the image cells, px. New tracks are placed in the cells with the fewest tracks.
    min_distance_px : int
        Least distance of a new track from every other track, px. The distance is the larger of the
        distances along the two image axes.
    block_px : int
        Width of the window of the structure tensor, px.
    min_slope : float
        Least root mean square gradient in the window of a corner, grey levels per px, along the
        direction in which the root mean square gradient is smallest. For image noise of standard
        deviation s this gradient is about 0.43 s.
    """

    cell_px: int = 64
    min_distance_px: int = 8
    block_px: int = 7
    min_slope: float = 1.5

    def __post_init__(self) -> None:
        coerce_int(self, 4, "cell_px")
        coerce_int(self, 1, "min_distance_px")
        coerce_int(self, 2, "block_px", most=MAX_WINDOW_PX)
        coerce_positive(self, "min_slope")


@dataclass(frozen=True, kw_only=True)
class LucasKanadeOptions:
    """Options of pyramidal Lucas-Kanade.

    Attributes
    ----------
    window_px : int
        Width of the matched window, px, odd.
    levels : int
        Largest number of times the image is halved. The tracker follows motions up to about
        ``window_px / 2 * 2**levels`` px.
    max_iterations : int
        Largest number of iterations at each level.
    tolerance_px : float
        The iterations of a level end with a step below this length, in px of the level.
    forward_backward_px : float
        Largest forward-backward error of a match, px.
    """

    window_px: int = 11
    levels: int = 4
    max_iterations: int = 15
    tolerance_px: float = 0.1
    forward_backward_px: float = 1.0

    def __post_init__(self) -> None:
        coerce_int(self, 5, "window_px", most=MAX_WINDOW_PX)
        coerce_int(self, 0, "levels")
        coerce_int(self, 1, "max_iterations")
        _check_odd(self, "window_px")
        coerce_positive(self, "tolerance_px", "forward_backward_px")


@dataclass(frozen=True, kw_only=True)
class RefinementOptions:
    """Options of the sub-pixel refinement: window, priors and acceptance.

    Attributes
    ----------
    window_px : int
        Width of the matched window, px, odd.
    max_iterations : int
        Largest number of iterations.
    tolerance_px : float
        The iterations end with a step below this length, px.
    affine_sigma : float
        Prior 1-sigma of the deviation of each of the four elements of the affine warp from the
        expected warp.
    gain_sigma : float
        Prior 1-sigma of the relative change of contrast.
    offset_sigma : float
        Prior 1-sigma of the change of brightness, grey levels.
    noise_floor : float
        Lower bound of the noise of a residual (1-sigma), grey levels. The noise is the root mean
        square residual of the two windows, or this bound if larger.
    max_shift_px : float
        Largest distance, px, between the position before and after the refinement. Matches with a
        larger distance are rejected.
    min_correlation : float
        Least normalised correlation of the two windows of a match, -1 to 1.
    """

    window_px: int = 15
    max_iterations: int = 6
    tolerance_px: float = 0.05
    affine_sigma: float = 0.1
    gain_sigma: float = 0.1
    offset_sigma: float = 10.0
    noise_floor: float = 3.0
    max_shift_px: float = 1.5
    min_correlation: float = 0.7

    def __post_init__(self) -> None:
        coerce_int(self, 9, "window_px", most=MAX_WINDOW_PX)
        coerce_int(self, 1, "max_iterations")
        _check_odd(self, "window_px")
        coerce_positive(self, "tolerance_px", "affine_sigma", "gain_sigma", "offset_sigma")
        coerce_positive(self, "noise_floor", "max_shift_px")
        coerce_float(
            self, "a correlation in [-1, 1]", lambda value: -1 <= value <= 1, "min_correlation"
        )


@dataclass(frozen=True, kw_only=True)
class TrackerOptions:
    """Options of `Tracker`.

    Attributes
    ----------
    max_tracks : int
        Largest number of tracks. Lost tracks are replaced by new tracks up to this number.
    corners : CornerOptions
        Corner detection.
    matching : LucasKanadeOptions
        Lucas-Kanade tracking.
    refinement : RefinementOptions
        Sub-pixel refinement.
    """

    max_tracks: int = 700
    corners: CornerOptions = field(default_factory=CornerOptions)
    matching: LucasKanadeOptions = field(default_factory=LucasKanadeOptions)
    refinement: RefinementOptions = field(default_factory=RefinementOptions)

    def __post_init__(self) -> None:
        coerce_int(self, 1, "max_tracks")


def _check_odd(options: object, name: str) -> None:
    if getattr(options, name) % 2 == 0:
        raise InputError(f"expected an odd number, got {getattr(options, name)!r}", field=name)
