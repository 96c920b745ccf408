"""Patches of the image: the errors of matches within a patch are correlated."""

from __future__ import annotations

import math

import numpy as np

from farpoint._kernels.patches import split_image
from farpoint.pose.constants import PATCH_MATCHES

__all__ = ["patches_of"]


def patches_of(rays: np.ndarray) -> np.ndarray:
    """Number (N,) of the image patch that contains each of the unit ``rays`` (N, 3).

    Windows of neighbouring points share pixels and surfaces. Errors of matches in one patch are
    therefore correlated; errors of matches in different patches are nearly independent.
    """
    splits = max(int(math.log2(max(len(rays) / PATCH_MATCHES, 1.0))), 0)
    patch = np.empty(len(rays), np.int64)
    split_image(np.ascontiguousarray(rays).reshape(-1), splits, patch)
    return patch
