"""Parts of the image: the errors of matches within a part are correlated."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.image_parts import split_image
from farpoint.pose.constants import PART_SPLITS

__all__ = ["parts_of"]


def parts_of(rays: np.ndarray) -> np.ndarray:
    """Number (N,), 0 to 15, of the part of the image that contains each of the rays (N, 3).

    The parts have about the same number of matches. Errors of neighbouring matches are correlated,
    because their windows share pixels and surfaces, and because errors of lens, shutter and codec
    are smooth. Errors of matches in different parts are less correlated.
    """
    part = np.empty(len(rays), np.int64)
    split_image(np.ascontiguousarray(rays).reshape(-1), PART_SPLITS, part)
    return part
