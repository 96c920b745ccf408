"""The mask of a sequence: an image whose white pixels are used."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from farpoint.errors import InputError, optional_import
from farpoint.frames.decode import silent_opencv
from farpoint.frames.integrity import find_damage

__all__ = ["WHITE", "read_mask"]

WHITE = 128
"""From here on a pixel of a mask counts as white."""


def read_mask(path: Path, size: tuple[int, int]) -> np.ndarray:
    """Which pixels of the frames are used: those that are white in the image ``path``.

    Parameters
    ----------
    path : Path
        An image of 8 bits, grey or colour (whose luma counts; transparency does not); 128 and
        above is white.
    size : tuple of int
        Width and height of the frames, px.

    Returns
    -------
    ndarray of bool, shape (height, width)

    Raises
    ------
    InputError
        Where the file cannot be read, is no image of 8 bits and of that size, or has no white.
    """
    mask = _grey(path)
    height, width = mask.shape
    if (width, height) != size:
        raise InputError(
            f"expected a mask of {size[0]}x{size[1]} pixels like the frames, got {width}x{height}",
            file=path,
        )
    used = mask >= WHITE
    if not used.any():
        raise InputError(
            f"expected a mask with white pixels (128 to 255), which are used; "
            f"its brightest is {mask.max()}",
            file=path,
        )
    return used


def _grey(path: Path) -> np.ndarray:
    """Grey values of an image of 8 bits, in the orientation that it is stored in."""
    cv2 = optional_import("cv2", extra="video", purpose="reading images")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"cannot be read as a mask, an 8-bit image: {error.strerror}", file=path
        ) from error
    damage = find_damage(data)
    image = None
    if data and not damage:
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
