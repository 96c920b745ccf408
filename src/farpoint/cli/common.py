"""Options that several commands have, each defined once."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.aiding import MetricOptions
from farpoint.cli.lens import LensOptions
from farpoint.frames.decode import MAX_MEGAPIXELS
from farpoint.odometry import OdometryOptions
from farpoint.sinks import OutputOptions

__all__ = ["ImageOptions", "RecordedOptions"]


@dataclass(frozen=True, kw_only=True)
class ImageOptions:
    """Of whatever estimates the motion of a camera.

    Attributes
    ----------
    lens : LensOptions
        Which camera it is.
    max_megapixels : float
        Larger images are refused before they are decoded.
    follow_playlists : bool
        Play the files that a playlist (M3U8, ffconcat, MPD, SDP) names.
    mask : Path or None
        8-bit image of the frames' size: white is used, black (a bonnet, a mount, a logo) is not.
    odometry : OdometryOptions
        Options of tracking and estimation.
    output : OutputOptions
        Which outputs are made.
    """

    lens: Annotated[LensOptions, tyro.conf.arg(name="")] = field(default_factory=LensOptions)
    max_megapixels: float = MAX_MEGAPIXELS
    follow_playlists: bool = False
    mask: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    odometry: Annotated[OdometryOptions, tyro.conf.arg(name="")] = field(
        default_factory=OdometryOptions
    )
    output: Annotated[OutputOptions, tyro.conf.arg(name="")] = field(default_factory=OutputOptions)


@dataclass(frozen=True, kw_only=True)
class RecordedOptions(ImageOptions):
    """Of what works on recordings.

    Attributes
    ----------
    fps : float or None
        Frames a second of images without time stamps; 10 by default.
    topic : str or None
        Of the images in a bag that has several such topics.
    metric : MetricOptions
        What is known of lengths.
    """

    fps: float | None = None
    topic: str | None = None
    metric: MetricOptions = field(default_factory=MetricOptions)
