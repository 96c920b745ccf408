"""An image in patches: what lies together."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel
from farpoint._kernels.formulas import greater
from farpoint._kernels.scratch import clear, index_room, room

__all__ = ["split_image"]


@kernel
def split_image(rays: np.ndarray, splits: int, patch: np.ndarray) -> None:
    """Write which ``patch`` (N,) of ``2^splits`` each of the ``rays`` (3 N,) is in.

    The image is split in two across its longest axis, at the mean of the rays, and so is each part,
    again and again.
    """
    for k in range(patch.size):
        patch[k] = 0
    for k in range(splits):
        _split(rays, 1 << k, patch)


@inner_kernel
def _split(rays: np.ndarray, parts: int, patch: np.ndarray) -> None:
    """Move what lies beyond the mean of its part, of so many, to a new one."""
    sizes, sums, squares = room(parts), room(3 * parts), room(3 * parts)
    clear(sizes)
    clear(sums)
    clear(squares)
    for k in range(patch.size):
        part = patch[k]
        sizes[part] += 1.0
        for i in range(3):
            x = rays[3 * k + i]
            sums[3 * part + i] += x
            squares[3 * part + i] += x * x
    longest, middle = index_room(parts), room(parts)
    for part in range(parts):
        size, widest = greater(sizes[part], 1.0), -1.0
        for i in range(3):
            total = sums[3 * part + i]
            spread = squares[3 * part + i] - total * total / size
            if spread > widest:
                longest[part], middle[part], widest = i, total / size, spread
    for k in range(patch.size):
        part = patch[k]
        patch[k] += parts if rays[3 * k + longest[part]] > middle[part] else 0
