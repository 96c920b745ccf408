"""Focal lengths in the metadata of images and videos."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from farpoint.camera import EquivalentFocalLength
from farpoint.errors import InputError, optional_import
from farpoint.frames.sequence import ImageSequence
from farpoint.frames.video import VideoFile

__all__ = ["find_focal_length"]

_EXIF_IFD, _FOCAL_LENGTH_35MM = 0x8769, 0xA405
# QuickTime's metadata key of the focal length, written by Apple's and other phones.
_VIDEO_KEY = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
_MOST_IMAGES = 20  # one image in len(images) // 20 is read
_ZOOM = 1.02  # largest ratio of the focal lengths of images from one lens

HELP = "give --fov DEG, or a calibration by --camera"


def find_focal_length(source: object, name: str) -> EquivalentFocalLength:
    """The focal length, in 35 mm equivalents, in the metadata of images or a video.

    Parameters
    ----------
    source : object
        Opened source: a video file or image files. Other sources have no focal length.
    name : str
        Name of the source in errors.

    Raises
    ------
    InputError
        If the source has no focal length, or if the images have different focal lengths.
    """
    if isinstance(source, VideoFile):
        return _of_video(source)
    if isinstance(source, ImageSequence):
        return _of_images(source.images, name)
    raise InputError(f"a live source has no focal length: {HELP}", file=name, field="--camera")


def _of_video(video: VideoFile) -> EquivalentFocalLength:
    with video.container() as container:
        found = {**container.streams.video[0].metadata, **container.metadata}.get(_VIDEO_KEY)
    try:
        millimetres = float(found) if found is not None else 0.0
    except ValueError:
        millimetres = 0.0
    if not 0.0 < millimetres < float("inf"):
        raise InputError(f"carries no focal length: {HELP}", file=video.path, field="--camera")
    return EquivalentFocalLength(millimetres=millimetres, source="the video's metadata")


def _of_images(images: Sequence[Path], name: str) -> EquivalentFocalLength:
    step = max(len(images) // _MOST_IMAGES, 1)
    found = {path: _exif_focal_length(path) for path in images[::step]}
    lengths = [length for length in found.values() if length > 0.0]
    if not lengths:
        raise InputError(
            f"EXIF of {images[0].name} has no FocalLengthIn35mmFilm: {HELP}",
            file=name,
            field="--camera",
        )
    if max(lengths) > _ZOOM * min(lengths):
        raise InputError(
            f"images of several focal lengths, {min(lengths):g} to {max(lengths):g} mm in 35 mm "
            "equivalents: expected one lens at one setting",
            file=name,
            field="--camera",
        )
    return EquivalentFocalLength(millimetres=lengths[0], source="EXIF")


def _exif_focal_length(path: Path) -> float:
    """FocalLengthIn35mmFilm, mm; 0 if the tag is absent or the file is no image."""
    pillow = optional_import("PIL.Image", extra="video", purpose="reading EXIF")
    try:
        with pillow.open(path) as image:
            return float(image.getexif().get_ifd(_EXIF_IFD).get(_FOCAL_LENGTH_35MM, 0.0))
    except (OSError, SyntaxError, ValueError, TypeError):
        return 0.0
