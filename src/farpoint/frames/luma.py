"""Grey values of a decoded video picture, upright."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from farpoint.frames.depth import GreyTable

__all__ = ["Grey"]

# More than 8 bits, little-endian, in the low bits of each sample: not P010, whose bits are high.
_DEEP_LUMA = re.compile(r"(?:yuv|yuva|gray)[0-9]*p?(?:9|10|12|14|16)le")


class Grey:
    """Grey values of the pictures of one video.

    If a picture has a plane of luma, this plane is used unchanged. No colour is converted. Limited
    range (16 to 235) is not stretched, because corners and optical flow do not depend on the range.
    If luma has 9 to 14 bits, the upper 8 bits are used. Luma of 16 bits, whose upper bits may be
    unused, is mapped by a table. FFmpeg converts other formats (RGB, packed or palette colours).

    Attributes
    ----------
    deep : GreyTable or None
        Table for samples of 16 bits; by default made from the first picture with such samples.
    """

    def __init__(self, deep: GreyTable | None = None) -> None:
        self.deep = deep

    def __call__(self, picture: Any) -> np.ndarray:
        """Grey values of an ``av.VideoFrame``, uint8 of shape (height, width), upright."""
        # A copy, so that a frame someone keeps does not hold the decoder's memory.
        return np.array(_upright(self._luma(picture), picture), order="C")

    def _luma(self, picture: Any) -> np.ndarray:
        if _is_byte_luma(picture):
            return _plane(picture, np.dtype(np.uint8))
        if not (_DEEP_LUMA.fullmatch(picture.format.name) and picture.planes[0].line_size > 0):
            return _plane(picture.reformat(format="gray"), np.dtype(np.uint8))
        samples, bits = _plane(picture, np.dtype("<u2")), picture.format.components[0].bits
        if bits < 16:
            return GreyTable.upper_bits(bits)(samples)
        if self.deep is None:
            self.deep = GreyTable.for_images([samples])
        return self.deep(samples)


def _is_byte_luma(picture: Any) -> bool:
    """Whether plane 0 is 8-bit luma only, with lines stored from top to bottom."""
    layout = picture.format
    first, *others = layout.components
    alone = first.is_luma and first.plane == 0 and all(other.plane != 0 for other in others)
    return alone and first.bits == 8 and not layout.has_palette and picture.planes[0].line_size > 0


def _plane(picture: Any, dtype: np.dtype[Any]) -> np.ndarray:
    """View of the samples of plane 0, without the padding at the end of each line."""
    plane = picture.planes[0]
    samples = np.frombuffer(plane, dtype)
    stride = plane.line_size // dtype.itemsize
    return samples.reshape(-1, stride)[: picture.height, : picture.width]


def _upright(image: np.ndarray, picture: Any) -> np.ndarray:
    """Rotate and mirror the image as the display matrix states, in steps of 90 degrees.

    The matrix (fixed point, 3 x 3 by rows: ``a b u, c d v, x y w``) maps a pixel of the stored
    picture to the screen: ``x' = a x + c y``, ``y' = b x + d y`` (libavutil/display.h). Phones
    store videos in the orientation of the sensor; the matrix contains the rotation to the upright
    orientation.
    """
    matrix = picture.side_data.get("DISPLAYMATRIX")
    if matrix is None:
        return image
    a, b, _, c, d = np.frombuffer(matrix, np.int32)[:5].tolist()
    if abs(a) + abs(d) < abs(b) + abs(c):
        image, a, d = image.T, c, b
    return image[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1]
