"""An image and its halves, halves of halves, and so on, as the kernels read them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint._kernels.lucas_kanade import border_px
from farpoint._kernels.windows import Image
from farpoint.errors import optional_import
from farpoint.tracks.options import LucasKanadeOptions

__all__ = ["Pyramid", "build_pyramid"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Pyramid:
    """An image at falling resolution.

    Attributes
    ----------
    values : ndarray of uint8, shape (V,)
        All levels, each with a border that repeats its outermost pixels.
    layout : ndarray of int64, shape (L, 4)
        Of each level, the finest first: place in ``values`` of its pixel (0, 0), places from one
        line to the next, width, height.
    """

    values: np.ndarray
    layout: np.ndarray

    def level(self, k: int) -> Image:
        """Level k, the finest first, as the kernels take it."""
        return Image(self.values, *self.layout[k].tolist())

    @property
    def image(self) -> np.ndarray:
        """The image itself, uint8 (H, W)."""
        place, line, width, height = self.layout[0]
        return self.values[place : place + height * line].reshape(height, line)[:, :width]


def build_pyramid(image: np.ndarray, options: LucasKanadeOptions) -> Pyramid:
    """Halve an image as often as the options ask and a window fits in.

    Pixel (0, 0) of every level is the same point (Burt and Adelson 1983,
    doi:10.1109/TCOM.1983.1095851).

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
    places = [line * (height + 2 * border) for line, (height, _) in zip(lines, sizes, strict=True)]
    begins = np.concatenate([[0], np.cumsum(places)])
    values = np.empty(begins[-1], np.uint8)
    layout = np.empty((len(sizes), 4), np.int64)
    finer = image
    for level, (height, width) in enumerate(sizes):
        whole = values[begins[level] : begins[level + 1]].reshape(-1, lines[level])
        inner = whole[border : border + height, border : border + width]
        if level == 0:
            inner[:] = image
        else:
            cv2.pyrDown(finer, dst=inner)
        _repeat_edges(whole, border)
        layout[level] = begins[level] + border * (lines[level] + 1), lines[level], width, height
        finer = inner
    return Pyramid(values=values, layout=layout)


def _repeat_edges(whole: np.ndarray, border: int) -> None:
    """Fill the border around the inner part with its outermost pixels."""
    inside = slice(border, -border)
    whole[inside, :border] = whole[inside, border, None]
    whole[inside, -border:] = whole[inside, -border - 1, None]
    whole[:border] = whole[border]
    whole[-border:] = whole[-border - 1]
