"""The mask of a sequence: an image that is white where the frames are used."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from farpoint.errors import InputError, optional_import
from farpoint.frames.decode import MAX_MEGAPIXELS, silent_opencv
from farpoint.frames.integrity import find_damage
from farpoint.frames.pages import image_size
from farpoint.regular_files import read_regular_file

__all__ = ["WHITE", "read_mask"]

WHITE = 128
"""From here on a pixel of a mask counts as white."""

_LARGEST_BYTES = 1 << 28


def read_mask(path: Path, size: tuple[int, int]) -> np.ndarray:
    """Mask that is True for pixels that are used, which are white in the image ``path``.

    Parameters
    ----------
    path : Path
        An image of 8 bits, grey or colour. A pixel counts as white if its luma is 128 or more.
        Transparency is ignored.
    size : tuple of int
        Width and height of the frames, px.

    Returns
    -------
    ndarray of bool, shape (height, width)

    Raises
    ------
    InputError
        If the file cannot be read, is no image of 8 bits and of this size, or has no white pixel.
    """
    mask = _grey(path, size)
    height, width = mask.shape
    if (width, height) != size:
        raise _other_size(path, f"{width}x{height}", size)
    used = mask >= WHITE
    if not used.any():
        raise InputError(
            f"expected a mask with white pixels (128 to 255), which are used; "
            f"its brightest is {mask.max()}",
            file=path,
        )
    return used


def _other_size(path: Path, got: str, size: tuple[int, int]) -> InputError:
    return InputError(
        f"expected a mask of {size[0]}x{size[1]} pixels like the frames, got {got}", file=path
    )


def _grey(path: Path, size: tuple[int, int]) -> np.ndarray:
    """Grey values of an 8-bit image, in the orientation of the file.

    If the header states more than `MAX_MEGAPIXELS`, and more pixels than the frames have, an error
    is raised before decoding, because decoding could take gigabytes.
    """
    cv2 = optional_import("cv2", extra="video", purpose="reading images")
    data = read_regular_file(path, limit_bytes=_LARGEST_BYTES, what="a mask, an 8-bit image")
    damage = find_damage(data)
    image = None
    if data and not damage:
        pixels = math.prod(image_size(data) or (0,))
        if pixels > MAX_MEGAPIXELS * 1e6 and pixels > math.prod(size):
            raise _other_size(path, f"{pixels / 1e6:.0f} megapixels", size)
        with silent_opencv():
            try:
                image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
            except cv2.error:  # raised for absurd sizes, instead of returning None
                image = None
    if image is None:
        why = damage or "cannot be decoded as an image"
        raise InputError(f"expected a mask, an 8-bit image: {why}", file=path)
    if image.dtype != np.uint8:
        raise InputError(f"expected a mask, an 8-bit image, got {image.dtype}", file=path)
    if image.ndim == 3:
        kinds = {3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}
        # Grey with transparency has two channels.
        known = kinds.get(image.shape[2])
        image = image[:, :, 0] if known is None else cv2.cvtColor(image, known)
    return image
