"""What a user can choose about tracking: one record for each stage."""

from __future__ import annotations

from dataclasses import dataclass, field

from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_int, coerce_positive

__all__ = ["CornerOptions", "LucasKanadeOptions", "RefinementOptions", "TrackerOptions"]

_LARGEST_WINDOW_PX = 255  # time and memory grow with the square


@dataclass(frozen=True, kw_only=True)
class CornerOptions:
    """Where new tracks begin.

    Attributes
    ----------
    cell_px : int
        Width and height of the cells over which tracks are spread, px.
    min_distance_px : int
        No new track begins nearer to another, px along either axis.
    block_px : int
        Width of the window over which gradients are gathered, px.
    min_slope : float
        Root-mean-square slope that a corner must have in its weakest direction, grey levels per
        px. Image noise of standard deviation s alone makes a slope of about 0.43 s.
    """

    cell_px: int = 64
    min_distance_px: int = 8
    block_px: int = 7
    min_slope: float = 1.5

    def __post_init__(self) -> None:
        coerce_int(self, 4, "cell_px")
        coerce_int(self, 1, "min_distance_px")
        coerce_int(self, 2, "block_px", most=_LARGEST_WINDOW_PX)
        coerce_positive(self, "min_slope")


@dataclass(frozen=True, kw_only=True)
class LucasKanadeOptions:
    """How points are found again, to a fraction of a pixel.

    Attributes
    ----------
    window_px : int
        Width of the matched window, px, odd.
    levels : int
        Times the image is halved: motion up to about ``window_px / 2 * 2**levels`` px is followed.
    max_iterations : int
        Bound on the steps at every level.
    tolerance_px : float
        Steps end when they are shorter, px.
    forward_backward_px : float
        A track followed forward and back must come out no farther from its start, px.
    """

    window_px: int = 11
    levels: int = 4
    max_iterations: int = 15
    tolerance_px: float = 0.1
    forward_backward_px: float = 1.0

    def __post_init__(self) -> None:
        coerce_int(self, 5, "window_px", most=_LARGEST_WINDOW_PX)
        coerce_int(self, 0, "levels")
        coerce_int(self, 1, "max_iterations")
        _check_odd(self, "window_px")
        coerce_positive(self, "tolerance_px", "forward_backward_px")


@dataclass(frozen=True, kw_only=True)
class RefinementOptions:
    """How matches become precise, what they may be, and what is known beforehand about the warp.

    Attributes
    ----------
    window_px : int
        Width of the matched window, px, odd.
    max_iterations : int
        Bound on the steps.
    tolerance_px : float
        Steps end when they are shorter, px.
    affine_sigma : float
        Prior 1-sigma of every element of the window's linear distortion (scale, shear, turn).
    gain_sigma : float
        Prior 1-sigma of the relative change of contrast.
    offset_sigma : float
        Prior 1-sigma of the change of brightness, grey levels.
    noise_floor : float
        Least 1-sigma by which two windows are expected to differ, grey levels; above it the
        residual tells how much the priors weigh.
    max_shift_px : float
        A refinement that moves a point farther has gone astray, px.
    min_correlation : float
        Windows that correlate less do not show the same thing, -1 to 1.
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
        coerce_int(self, 9, "window_px", most=_LARGEST_WINDOW_PX)
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
        Tracks are replenished up to this number; more are more precise and take longer.
    corners : CornerOptions
        Where new tracks begin.
    matching : LucasKanadeOptions
        How points are found again.
    refinement : RefinementOptions
        How their positions become precise.
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
