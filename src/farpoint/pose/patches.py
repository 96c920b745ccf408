"""Matches that lie together in the image, and so err together."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.patches import split_image

__all__ = ["patches_of"]

# A patch has so many matches on average at the least, and twice as many at the most. Of 6, the
# regions of poses on rendered sequences hold the truth as often.
TOGETHER = 3.0


def patches_of(rays: np.ndarray) -> np.ndarray:
    """Number (N,) of the patch of the image that each of the unit ``rays`` (N, 3) is in.

    Windows of points nearby share pixels, and what they show moves and bends alike. Of a patch as
    large as that, the errors add up; those of another are its own.
    """
    splits = max(int(math.log2(max(len(rays) / TOGETHER, 1.0))), 0)
    patch = np.empty(len(rays), np.int64)
    split_image(np.ascontiguousarray(rays).reshape(-1), splits, patch)
    return patch
