"""Deinterlacing: interlaced pictures are recognised by combs, and one field is used.

The even and the odd lines of an interlaced picture are half a frame time apart. At moving edges
each line is less similar to the next line than to the line after the next line. This pattern is
called a comb.
"""

from __future__ import annotations

import numpy as np

__all__ = ["Deinterlacer", "comb_share", "one_field"]

_EVERY_COLUMN = 8
"""Step between the columns that are used, because neighbouring columns are similar."""

_BLOCK_PX = 32
_TEXTURE_GREY2 = 25.0
"""Least mean squared second difference of lines, grey levels^2, of a textured block. White noise of
2 grey levels has a mean of 6."""

_COMB_RATIO = 1.5
"""Least ratio, in a comb, of the mean squared second difference of adjacent lines to that of lines
two apart. The ratio is 1 for white noise, and smaller for a smooth image."""

_LEAST_SHARE = 0.3
"""Share of combs among the textured blocks above which a picture is interlaced. The share is 0.5 in
rendered streets at 20 fields a second, at most 0.14 in 1,048 progressive pictures of nine
recordings and five renderings, and 0.21 in pure noise (`tests/frames/test_deinterlace.py`)."""

_FRAMES = 50
"""Number of pictures tested at the start of a source. All pictures of a source are interlaced, or
none are. While the camera stands still, an interlaced picture has no combs."""


class Deinterlacer:
    """Filter that uses the even lines of every picture from the first interlaced picture on.

    Attributes
    ----------
    is_interlaced : bool
        Whether any picture so far was interlaced.
    """

    def __init__(self) -> None:
        self.is_interlaced = False
        self._seen = 0

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """The picture (H, W), uint8, either unchanged or made from one field."""
        if not self.is_interlaced and self._seen < _FRAMES:
            self._seen += 1
            self.is_interlaced = comb_share(image) > _LEAST_SHARE
        return one_field(image) if self.is_interlaced else image


def comb_share(image: np.ndarray) -> float:
    """Share, 0 to 1, of combs among the textured blocks of an image (H, W)."""
    rows = len(image) // _BLOCK_PX * _BLOCK_PX
    some = image[:rows, ::_EVERY_COLUMN]
    columns = some.shape[1] // (_BLOCK_PX // _EVERY_COLUMN) * (_BLOCK_PX // _EVERY_COLUMN)
    if rows < 2 * _BLOCK_PX or columns == 0:
        return 0.0
    lines = some[:, :columns].astype(np.float32)
    middle = lines[2:-2]
    by_next = _in_blocks((middle - 0.5 * (lines[1:-3] + lines[3:-1])) ** 2)
    by_second = _in_blocks((middle - 0.5 * (lines[:-4] + lines[4:])) ** 2)
    textured = np.maximum(by_next, by_second) > _TEXTURE_GREY2
    if not textured.any():
        return 0.0
    return float(np.mean(by_next[textured] > _COMB_RATIO * by_second[textured]))


def one_field(image: np.ndarray) -> np.ndarray:
    """The even lines of an image (H, W), with interpolated lines in between; no pixel moves.

    Details finer than the line spacing of the field cause aliasing, which would bias the positions
    of all tracked windows towards whole lines. Therefore the lines are first smoothed with the
    weights 1 2 1. All lines of the result are samples of the cubic B-spline whose coefficients are
    the smoothed lines. This spline smooths even and odd lines equally.
    """
    even = image[::2].astype(np.float32)
    even = (_shifted(even, -1) + 2.0 * even + _shifted(even, 1)) / 4.0
    above, below = _shifted(even, -1), _shifted(even, 1)
    field = np.empty(image.shape, np.float32)
    field[::2] = (above + 4.0 * even + below) / 6.0
    between = (above + 23.0 * even + 23.0 * below + _shifted(even, 2)) / 48.0
    field[1::2] = between[: len(image) // 2]
    return np.rint(field).astype(np.uint8)


def _shifted(lines: np.ndarray, count: int) -> np.ndarray:
    """The lines shifted by ``count`` lines; the first or last line is repeated at the border."""
    return lines[(np.arange(len(lines)) + count).clip(0, len(lines) - 1)]


def _in_blocks(squares: np.ndarray) -> np.ndarray:
    """Means over the blocks of an image."""
    width, height = _BLOCK_PX // _EVERY_COLUMN, len(squares) // _BLOCK_PX
    blocks = squares[: height * _BLOCK_PX].reshape(height, _BLOCK_PX, -1)
    columns = blocks.sum(axis=1)  # first: along lines the memory is contiguous
    return columns.reshape(height, -1, width).sum(axis=2) / (_BLOCK_PX * width)
