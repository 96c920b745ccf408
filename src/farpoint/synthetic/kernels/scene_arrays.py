"""Arrays that describe a scene to the ray caster."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = [
    "Blocks",
    "Finish",
    "Hills",
    "Scene",
]


class Blocks(NamedTuple):
    """Upright shapes on flat ground, sorted into a grid; y points down, the ground is y = 0.

    Attributes
    ----------
    shape : ndarray, shape (S, 9)
        For each shape: ``x, z`` of the axis, m, ``cos, sin`` of the yaw, half widths along the
        shape's own x and z, m, y of the top and y of the bottom, m, and the kind: BOX, CYLINDER or
        ELLIPSOID. For round shapes the first half width is the radius.
    cell_start : ndarray of int64, shape (nx * nz + 1,)
    cell_shape : ndarray of int64, shape (M,)
        Shapes that reach into each cell of the grid. The shapes of cell ``(i, j)`` are
        ``cell_shape[cell_start[j * nx + i] : cell_start[j * nx + i + 1]]``.
    cell_top : ndarray, shape (nx * nz,)
        y of the top of the highest shape in each cell; infinite for an empty cell.
    grid : ndarray, shape (6,)
        ``x, z`` of the grid's corner, m, size of a cell, m, ``nx``, ``nz``, y of the highest top.
    """

    shape: np.ndarray
    cell_start: np.ndarray
    cell_shape: np.ndarray
    cell_top: np.ndarray
    grid: np.ndarray


class Hills(NamedTuple):
    """Rings of hills around everything.

    Attributes
    ----------
    ring : ndarray, shape (K, 3)
        ``x, z`` of the centre and radius of each ring, m, from the innermost ring to the outermost.
    height : ndarray, shape (K, A)
        Heights above ground at A equal steps of azimuth, m.
    """

    ring: np.ndarray
    height: np.ndarray


class Finish(NamedTuple):
    """Appearance of the surfaces.

    Attributes
    ----------
    paint : ndarray, shape (S + 1 + K, 7)
        One row for every shape, then for the ground, then for every ring: mean grey level, number
        of the pattern's texture, metres per texel of the pattern, gain of the pattern in grey
        levels, gain of the noise in grey levels, and offsets in u and v, m.
    texels : ndarray of float32
        Mip pyramids of all textures, one after the other, each from fine to coarse.
    texture : ndarray of int64, shape (T, 2)
        Start in ``texels`` and binary logarithm of the width of each texture. Texture 0 is noise.
    """

    paint: np.ndarray
    texels: np.ndarray
    texture: np.ndarray


class Scene(NamedTuple):
    """Arrays of a scene."""

    blocks: Blocks
    hills: Hills
    finish: Finish
