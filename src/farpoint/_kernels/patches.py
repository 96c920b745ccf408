"""Patches of the image, and random halves of the patches."""

from __future__ import annotations

import numpy as np

from farpoint._kernels.arrays import clear
from farpoint._kernels.compile import kernel, step_kernel
from farpoint._kernels.linear import draw_index

__all__ = ["split_image", "split_patches"]


@kernel
def split_image(rays: np.ndarray, splits: int, patch: np.ndarray) -> None:
    """Assign each of the ``rays`` (3 N,) to one of ``2^splits`` patches: ``patch`` (N,).

    The image is split ``splits`` times. In each split, every part is divided in two along the
    coordinate in which the rays of the part have the largest scatter, at the mean of this
    coordinate.
    """
    for k in range(patch.size):
        patch[k] = 0
    for k in range(splits):
        _split(rays, 1 << k, patch)


@step_kernel
def _split(rays: np.ndarray, parts: int, patch: np.ndarray) -> None:
    """Split each of the ``parts`` as in `split_image`: rays above the mean form a new part."""
    sizes, sums, squares = np.empty(parts), np.empty(3 * parts), np.empty(3 * parts)
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
    longest, middle = np.empty(parts, np.int64), np.empty(parts)
    for part in range(parts):
        size, widest = max(sizes[part], 1.0), -1.0
        for i in range(3):
            total = sums[3 * part + i]
            spread = squares[3 * part + i] - total * total / size
            if spread > widest:
                longest[part], middle[part], widest = i, total / size, spread
    for k in range(patch.size):
        part = patch[k]
        patch[k] += parts if rays[3 * k + longest[part]] > middle[part] else 0


@kernel
def split_patches(patch: np.ndarray, state: np.ndarray, half: np.ndarray) -> int:
    """Assign patches to two halves: in random order, each patch goes to the smaller half.

    The function writes the ``half`` (N,) of each match, 0 or 1, given the ``patch`` (N,) of each
    match. ``state`` is the state of the random generator. The function returns the number of
    matches in the first half.
    """
    patches = 0
    for i in range(patch.size):
        patches = max(patches, patch[i] + 1)
    sizes, order, half_of = (
        np.empty(patches, np.int64),
        np.empty(patches, np.int64),
        np.empty(patches, np.int64),
    )
    for k in range(patches):
        sizes[k], order[k] = 0, k
    for i in range(patch.size):
        sizes[patch[i]] += 1
    first = second = 0
    for k in range(patches):
        j = k + draw_index(state, patches - k)
        chosen = order[j]
        order[j] = order[k]
        half_of[chosen] = 1 if first > second else 0
        if first > second:
            second += int(sizes[chosen])
        else:
            first += int(sizes[chosen])
    for i in range(patch.size):
        half[i] = half_of[patch[i]]
    return first
