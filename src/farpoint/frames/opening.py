"""Opening of all kinds of sources."""

from __future__ import annotations

import glob
import math
import stat
from dataclasses import replace
from pathlib import Path

from farpoint.errors import InputError
from farpoint.frames.bags import BagImages, holds_bag, is_bag, open_bag_images
from farpoint.frames.decode import MAX_MEGAPIXELS
from farpoint.frames.device import open_device
from farpoint.frames.euroc import open_euroc
from farpoint.frames.files import is_image, list_images
from farpoint.frames.folder import open_folder, open_glob, open_pages
from farpoint.frames.frame import FrameSource
from farpoint.frames.kitti import open_kitti
from farpoint.frames.network import open_url
from farpoint.frames.remote import is_remote, open_remote
from farpoint.frames.sequence import ImageSequence
from farpoint.frames.tum import open_tum
from farpoint.frames.video import open_video

__all__ = ["open_frames"]

_MOST_FPS = 1e6  # largest frame rate; the smallest is 1 / _MOST_FPS


def open_frames(
    source: str | Path | int,
    *,
    fps: float | None = None,
    max_megapixels: float = MAX_MEGAPIXELS,
    follow_playlists: bool = False,
    topic: str | None = None,
) -> FrameSource:
    """Open a source of images. The kind of the source is recognised by the name or the files.

    Parameters
    ----------
    source : str, Path or int
        One of these sources:

        - a video file;
        - a folder of images, or a folder around such a folder (``images``, ``rgb``, ...);
        - a pattern of image files, such as ``"shots/*.png"``;
        - a TIFF or WebP file with several pages (each page is a frame), alone or in a folder;
        - a KITTI (odometry or raw), EuRoC, TUM-VI or TUM RGB-D folder, from which the left, grey
          or only colour camera is read; to read another camera, give the folder of that camera;
        - a bag: a ROS 1 ``.bag``, the folder or a file of a ROS 2 bag (sqlite3 or MCAP), or any
          MCAP file with ROS's or Foxglove's images;
        - the index of an attached camera, such as ``0`` or ``"0"``;
        - the URL of a stream, such as ``"rtsp://..."``;
        - the URL of a video or folder in an object store, such as ``"s3://bucket/drive.mp4"``.
    fps : float, optional
        Frames per second, used only if the source has no time stamps. Time stamps may be in a
        video, in a list of images, in a file ``times.txt``, or in file names that are times.
        ``timestamp_source`` of the result states the origin of the times. With None, images without
        times get 10 frames per second.
    max_megapixels : float
        Size limit of an image. A larger image is not decoded and is a frame with a fault.
    follow_playlists : bool
        Open the files that are named in a playlist (M3U8, ffconcat, MPD, SDP), in any folder.
    topic : str, optional
        Topic of the images in a bag; needed if the bag has several image topics.

    Returns
    -------
    FrameSource
        An iterable of `Frame`. An unreadable frame has, instead of an image, a fault that states
        the cause. Iteration continues after such a frame.

    Raises
    ------
    InputError
        If the source is missing, unreadable, empty, or of no kind in the list above.

    Examples
    --------
    >>> for frame in open_frames("drive.mp4"):  # doctest: +SKIP
    ...     print(frame.timestamp, frame.image.shape)
    """
    _check(source, fps, max_megapixels)
    if isinstance(source, int):
        return open_device(source)
    try:
        if is_remote(str(source)):
            return open_remote(
                str(source),
                lambda folder: _limited(
                    _open_path(folder, fps, follow_playlists, topic), max_megapixels
                ),
                fps=fps,
                follow_playlists=follow_playlists,
            )
        if "://" in str(source):
            return open_url(str(source))
        opened = _open_path(Path(source).expanduser(), fps, follow_playlists, topic)
    except OSError as error:
        raise InputError(
            f"cannot be read: {error.strerror}", file=error.filename or source
        ) from error
    if topic is not None and not isinstance(opened, BagImages):
        raise InputError(f"{topic}: only a bag has topics", file=source, field="topic")
    return _limited(opened, max_megapixels)


def _check(source: str | Path | int, fps: float | None, max_megapixels: float) -> None:
    if not (math.isfinite(max_megapixels) and max_megapixels > 0):
        raise InputError(
            f"expected a positive number, got {max_megapixels}", field="max_megapixels"
        )
    if fps is not None and not 1.0 / _MOST_FPS <= fps <= _MOST_FPS:
        raise InputError(
            f"expected {1.0 / _MOST_FPS:g} to {_MOST_FPS:g} frames a second, got {fps}", field="fps"
        )
    # Path would take "" for the current folder, and True is an int.
    if not isinstance(source, str | Path | int) or isinstance(source, bool) or source == "":
        raise InputError(
            f"expected a file, folder, pattern, camera index or URL, got {source!r}", field="source"
        )


def _limited(opened: FrameSource, max_megapixels: float) -> FrameSource:
    if isinstance(opened, ImageSequence | BagImages):
        return replace(opened, max_megapixels=max_megapixels)
    return opened


def _open_path(
    path: Path, fps: float | None, follow_playlists: bool, topic: str | None
) -> FrameSource:
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return _open_name(str(path), fps)
    if stat.S_ISDIR(mode):
        if is_bag(path):
            return open_bag_images(path, topic)
        if known := open_euroc(path) or open_tum(path) or open_kitti(path, fps=fps):
            return known
        if holds_bag(path) and not list_images(path):
            return open_bag_images(path, topic)
        return open_folder(path, fps=fps)
    if not stat.S_ISREG(mode):
        raise InputError("is neither a file nor a folder", file=path)
    if is_bag(path):
        return open_bag_images(path, topic)
    if is_image(path):
        return open_pages(path, fps=fps)
    return open_video(path, fps=fps, follow_playlists=follow_playlists)


def _open_name(name: str, fps: float | None) -> FrameSource:
    """Open a source that is no path: a camera index or a pattern."""
    if name.isascii() and name.isdecimal():
        return open_device(int(name))
    if glob.has_magic(name):
        return open_glob(name, fps=fps)
    raise InputError("no such file or folder", file=name)
