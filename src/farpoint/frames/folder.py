"""Plain images: a folder of images, a folder around such a folder, or a pattern of file names."""

from __future__ import annotations

import glob
from pathlib import Path

from farpoint.errors import InputError
from farpoint.frames.calibration import find_calibration
from farpoint.frames.files import in_order, is_image, list_images, source_name
from farpoint.frames.pages import with_pages
from farpoint.frames.sequence import ImageSequence
from farpoint.frames.stamps import find_stamps

__all__ = ["open_folder", "open_glob", "open_pages", "sequence_in"]

_USUAL_NAMES = ("images", "image", "rgb", "frames", "data", "img", "imgs")


def sequence_in(images_folder: Path, *, root: Path, fps: float | None) -> ImageSequence | None:
    """The images directly in `images_folder`, with the name of `root`; None without images."""
    images, pages = with_pages(list_images(images_folder))
    if not images:
        return None
    return ImageSequence(
        name=source_name(root),
        images=images,
        pages=pages,
        stamps=find_stamps(images, fps),
        calibration_path=find_calibration(images_folder, images_folder.absolute().parent),
    )


def open_folder(folder: Path, *, fps: float | None) -> ImageSequence:
    """Images in `folder`, else in a subfolder of a usual name, else in the only one with images.

    The usual names are ``images``, ``image``, ``rgb``, ``frames``, ``data``, ``img`` and ``imgs``,
    in this order.

    Raises
    ------
    InputError
        If there is no image, or if several subfolders of other names have images.
    """
    inside = sorted(entry for entry in folder.iterdir() if entry.is_dir())
    usual = [folder / name for name in _USUAL_NAMES if folder / name in inside]
    for place in (folder, *usual):
        if sequence := sequence_in(place, root=folder, fps=fps):
            return sequence
    choices = [entry for entry in inside if list_images(entry)]
    if len(choices) > 1:
        names = ", ".join(entry.name for entry in choices[:4])
        raise InputError(f"several folders in it hold images: expected one of {names}", file=folder)
    sequence = sequence_in(choices[0], root=folder, fps=fps) if choices else None
    if sequence is None:
        raise InputError(
            "holds no images: expected image files, or a KITTI, EuRoC or TUM sequence", file=folder
        )
    return sequence


def open_glob(pattern: str, *, fps: float | None) -> ImageSequence:
    """Images that match a pattern (``*``, ``?``, ``[...]``, ``**``), in natural order.

    Raises
    ------
    InputError
        If no image matches.
    """
    # Path.glob takes no absolute pattern.
    matches = [Path(match) for match in glob.glob(pattern, recursive=True)]  # noqa: PTH207
    images = in_order(path for path in matches if is_image(path) and not path.is_dir())
    if not images:
        raise InputError("matches no images", file=pattern)
    folder = images[0].absolute().parent
    found, pages = with_pages(images)
    return ImageSequence(
        name=source_name(folder),
        images=found,
        pages=pages,
        stamps=find_stamps(found, fps),
        calibration_path=find_calibration(folder, folder.parent),
    )


def open_pages(file: Path, *, fps: float | None) -> ImageSequence:
    """The pages of one image file.

    Raises
    ------
    InputError
        If the file has only one page.
    """
    images, pages = with_pages([file])
    if len(images) < 2:
        raise InputError("is one image: expected a video, a folder or a pattern", file=file)
    return ImageSequence(
        name=file.stem,
        images=images,
        pages=pages,
        stamps=find_stamps(images, fps),
        calibration_path=find_calibration(file.absolute().parent, stem=file.stem),
    )
