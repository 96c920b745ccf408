"""Corner strength of every pixel, and local maxima.

Loops along a line of the image are written for vector instructions. Floats are float32. Gradients
and sums of gradients are whole numbers, for which float32 is exact.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.compile import inner_kernel, kernel, step_kernel

__all__ = ["corner_strength", "strongest_places"]


@kernel
def corner_strength(image: np.ndarray, block: int, strength: np.ndarray) -> None:
    """Shi-Tomasi corner strength of each pixel, from the gradients in a block around the pixel.

    Parameters
    ----------
    image : ndarray of uint8, shape (H, W)
    block : int
        Width and height of the blocks, px. An even block reaches one pixel farther left and up.
    strength : ndarray of float32, shape (H, W)
        Out: smallest eigenvalue of the second moments of Sobel gradients, grey levels^2 per px^2; 0
        if the block leaves the image.
    """
    height, width = image.shape
    strength[:] = 0.0
    # Gradients of the last ``block`` lines, and column sums of their products.
    gx, gy = np.zeros((block, width), np.float32), np.zeros((block, width), np.float32)
    xx, xy, yy = (
        np.zeros(width, np.float32),
        np.zeros(width, np.float32),
        np.zeros(width, np.float32),
    )
    sums = np.zeros((3, width), np.float32)
    scale = np.float32(1.0 / (64.0 * block * block))
    for y in range(1, height - 1):
        slot = y % block
        _move_on(image[y - 1], image[y], image[y + 1], gx[slot], gy[slot], xx, xy, yy)
        if y >= block and width > block + 1:
            line = strength[y - block + 1 + block // 2]
            _sum_along(xx, block, sums[0])
            _sum_along(xy, block, sums[1])
            _sum_along(yy, block, sums[2])
            _weakest(sums[0], sums[1], sums[2], scale, block, line)


@step_kernel
def _move_on(
    above: np.ndarray,
    here: np.ndarray,
    below: np.ndarray,
    gx: np.ndarray,
    gy: np.ndarray,
    xx: np.ndarray,
    xy: np.ndarray,
    yy: np.ndarray,
) -> None:
    """Add products of gradients of a new line to the running sums, and subtract the oldest line.

    ``gx`` and ``gy`` hold the gradients of the line ``block`` lines above the new line, which are
    replaced by the gradients of the new line.
    """
    one, two = np.uintp(1), np.uintp(2)
    twice = np.float32(2.0)
    for i in range(np.uintp(len(here) - 2)):
        j, k = i + one, i + two
        # Converted first: bytes would wrap around.
        nw, n, ne = np.float32(above[i]), np.float32(above[j]), np.float32(above[k])
        w, e = np.float32(here[i]), np.float32(here[k])
        sw, s, se = np.float32(below[i]), np.float32(below[j]), np.float32(below[k])
        dx = (ne - nw) + twice * (e - w) + (se - sw)
        dy = (sw - nw) + twice * (s - n) + (se - ne)
        xx[j] += dx * dx - gx[j] * gx[j]
        xy[j] += dx * dy - gx[j] * gy[j]
        yy[j] += dy * dy - gy[j] * gy[j]
        gx[j], gy[j] = dx, dy


@inner_kernel
def _sum_along(values: np.ndarray, block: int, sums: np.ndarray) -> None:
    """Sums of ``block`` successive values, stored at the index of the first value."""
    count = np.uintp(len(values) - block)
    for i in range(count):
        sums[i] = values[i]
    for b in range(1, block):
        for i in range(count):
            sums[i] += values[i + np.uintp(b)]


@step_kernel
def _weakest(
    xx: np.ndarray,
    xy: np.ndarray,
    yy: np.ndarray,
    scale: np.floating,
    block: int,
    line: np.ndarray,
) -> None:
    """Smallest eigenvalues, stored at the centres of the blocks."""
    half = np.float32(0.5)
    for i in range(np.uintp(1), np.uintp(len(xx) - block)):
        mean, difference = half * (xx[i] + yy[i]), half * (xx[i] - yy[i])
        root = np.sqrt(difference * difference + xy[i] * xy[i])
        line[i + np.uintp(block // 2)] = scale * (mean - root)


@kernel
def strongest_places(
    strength: np.ndarray,
    least: float,
    reach: int,
    border: int,
    taken: np.ndarray,
    places: np.ndarray,
) -> int:
    """Find the pixels that are maximal in their square of half width ``reach``; returns the count.

    Parameters
    ----------
    strength : ndarray of float32, shape (H, W)
    least : float
        Strength that a maximum must exceed.
    reach, border : int
        Half width of the square, and least distance from the border of the image, px.
    taken : ndarray of bool, shape (H, W)
        Pixels that are excluded.
    places : ndarray of int64, shape (C, 2)
        Out: column and row of each maximum. A square of ``reach + 1`` pixels contains at most one
        maximum.
    """
    height, width = strength.shape
    size = reach + 1
    count = 0
    highest = np.empty(width, np.float32)
    for top in range(border, height - border, size):
        bottom = min(top + size, height - border)
        _highest(strength[top:bottom], highest)
        for left in range(border, width - border, size):
            right = min(left + size, width - border)
            best = np.float32(least)
            column = -1
            for x in range(left, right):
                if highest[x] > best:
                    best, column = highest[x], x
            if column < 0:
                continue
            row = top
            while strength[row, column] != best:
                row += 1
            if taken[row, column] or not _outdone_by_none(strength, column, row, 1):
                continue  # most candidates end here
            if _outdone_by_none(strength, column, row, reach):
                places[count, 0], places[count, 1] = column, row
                count += 1
    return count


@step_kernel
def _highest(lines: np.ndarray, highest: np.ndarray) -> None:
    """Maximum of each column."""
    for x in range(np.uintp(len(highest))):
        highest[x] = lines[0, x]
    for y in range(1, len(lines)):
        line = lines[y]
        for x in range(np.uintp(len(highest))):
            here, above = line[x], highest[x]  # both read, so that the selection needs no branch
            highest[x] = here if here > above else above


@inner_kernel
def _outdone_by_none(strength: np.ndarray, column: int, row: int, reach: int) -> bool:
    height, width = strength.shape
    for y in range(max(row - reach, 0), min(row + reach + 1, height)):
        for x in range(max(column - reach, 0), min(column + reach + 1, width)):
            if strength[y, x] > strength[row, column]:
                return False
    return True
