"""Image pyramids in the memory layout of the kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.errors import optional_import
from farpoint.tracks.kernels.lucas_kanade import border_px
from farpoint.tracks.kernels.windows import Image
from farpoint.tracks.options import LucasKanadeOptions

__all__ = ["Pyramid", "build_pyramid"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Pyramid:
    """Image pyramid in one buffer.

    Attributes
    ----------
    values : ndarray of uint8, shape (V,)
        All levels, each with a border of replicated edge pixels.
    layout : ndarray of int64, shape (L, 4)
        One row for each level, from the finest to the coarsest: index of pixel (0, 0) in
        ``values``, row stride, width, height.
    """

    values: np.ndarray
    layout: np.ndarray

    def level(self, k: int) -> Image:
        """Level k in the format of the kernels; level 0 is the finest."""
        return Image(self.values, *self.layout[k].tolist())

    @property
    def image(self) -> np.ndarray:
        """The image at full resolution, uint8 (H, W)."""
        origin, stride, width, height = self.layout[0]
        return self.values[origin : origin + height * stride].reshape(height, stride)[:, :width]


def build_pyramid(image: np.ndarray, options: LucasKanadeOptions) -> Pyramid:
    """Build an image pyramid of at most ``options.levels`` halvings.

    The coarsest level is not smaller than the window. Pixel (0, 0) shows the same point at every
    level (Burt and Adelson 1983, doi:10.1109/TCOM.1983.1095851).

    Parameters
    ----------
    image : ndarray of uint8, shape (H, W)
    options : LucasKanadeOptions
    """
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    border = border_px(options.window_px // 2)
    sizes = [image.shape]
    while len(sizes) <= options.levels and min(sizes[-1]) > 2 * options.window_px:
        sizes.append(((sizes[-1][0] + 1) // 2, (sizes[-1][1] + 1) // 2))
    lines = [width + 2 * border for _, width in sizes]
    lengths = [
        stride * (height + 2 * border) for stride, (height, _) in zip(lines, sizes, strict=True)
    ]
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    values = np.empty(offsets[-1], np.uint8)
    layout = np.empty((len(sizes), 4), np.int64)
    finer = image
    for level, (height, width) in enumerate(sizes):
        padded = values[offsets[level] : offsets[level + 1]].reshape(-1, lines[level])
        inner = padded[border : border + height, border : border + width]
        if level == 0:
            inner[:] = image
        else:
            cv2.pyrDown(finer, dst=inner)
        _repeat_edges(padded, border)
        layout[level] = offsets[level] + border * (lines[level] + 1), lines[level], width, height
        finer = inner
    return Pyramid(values=values, layout=layout)


def _repeat_edges(padded: np.ndarray, border: int) -> None:
    """Fill the border with replicated edge pixels."""
    inside = slice(border, -border)
    padded[inside, :border] = padded[inside, border, None]
    padded[inside, -border:] = padded[inside, -border - 1, None]
    padded[:border] = padded[border]
    padded[-border:] = padded[-border - 1]
