"""Options that several commands share."""

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
    """Options of all commands that estimate the motion of a camera.

    Attributes
    ----------
    lens : LensOptions
        Options of the camera.
    max_megapixels : float
        Size limit of an image. A larger image is not decoded and is a frame with a fault.
    follow_playlists : bool
        Open the files that are named in a playlist (M3U8, ffconcat, MPD, SDP).
    mask : Path or None
        8-bit image of the same size as the frames. White pixels are used. Black pixels (a bonnet, a
        mount, a logo) are not used.
    odometry : OdometryOptions
        Options of tracking and estimation.
    output : OutputOptions
        Options of the outputs.
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
    """Options of commands that process recordings.

    Attributes
    ----------
    fps : float or None
        Frames per second of images without time stamps; 10 by default.
    topic : str or None
        Topic of the images, for a bag with several image topics.
    metric : MetricOptions
        Aiding measurements of length.
    """

    fps: float | None = None
    topic: str | None = None
    metric: MetricOptions = field(default_factory=MetricOptions)
