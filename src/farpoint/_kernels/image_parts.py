"""Parts of the image, and random halves of the parts."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.linear import draw_index

__all__ = ["split_image", "split_parts"]


@kernel
def split_image(rays: np.ndarray, splits: int, part: np.ndarray) -> None:
    """Assign each of the ``rays`` (3 N,) to one of ``2^splits`` parts: ``part`` (N,).

    The image is split ``splits`` times. In each split, every part is divided in two along the
    coordinate in which the rays of the part have the largest scatter, at the mean of this
    coordinate.
    """
    for k in range(part.size):
        part[k] = 0
    for k in range(splits):
        _split(rays, 1 << k, part)


@step_kernel
def _split(rays: np.ndarray, parts: int, part_of: np.ndarray) -> None:
    """Split each of the ``parts`` as in `split_image`: rays above the mean form a new part."""
    sizes, sums, squares = np.empty(parts), np.empty(3 * parts), np.empty(3 * parts)
    clear(sizes)
    clear(sums)
    clear(squares)
    for k in range(part_of.size):
        part = part_of[k]
        sizes[part] += 1.0
        for i in range(3):
            x = rays[3 * k + i]
            sums[3 * part + i] += x
            squares[3 * part + i] += x * x
    longest, middle = np.empty(parts, np.int64), np.empty(parts)
    for part in range(parts):
        size, widest = max(sizes[part], 1.0), -1.0
        for i in range(3):
            total = sums[3 * part + i]
            spread = squares[3 * part + i] - total * total / size
            if spread > widest:
                longest[part], middle[part], widest = i, total / size, spread
    for k in range(part_of.size):
        part = part_of[k]
        part_of[k] += parts if rays[3 * k + longest[part]] > middle[part] else 0


@kernel
def split_parts(part: np.ndarray, state: np.ndarray, half: np.ndarray) -> int:
    """Assign parts to two halves: in random order, each part goes to the smaller half.

    The function writes the ``half`` (N,) of each match, 0 or 1, given the ``part`` (N,) of each
    match. ``state`` is the state of the random generator. The function returns the number of
    matches in the first half.
    """
    parts = 0
    for i in range(part.size):
        parts = max(parts, part[i] + 1)
    sizes, order, half_of = (
        np.empty(parts, np.int64),
        np.empty(parts, np.int64),
        np.empty(parts, np.int64),
    )
    for k in range(parts):
        sizes[k], order[k] = 0, k
    for i in range(part.size):
        sizes[part[i]] += 1
    first = second = 0
    for k in range(parts):
        j = k + draw_index(state, parts - k)
        chosen = order[j]
        order[j] = order[k]
        half_of[chosen] = 1 if first > second else 0
        if first > second:
            second += int(sizes[chosen])
        else:
            first += int(sizes[chosen])
    for i in range(part.size):
        half[i] = half_of[part[i]]
    return first
