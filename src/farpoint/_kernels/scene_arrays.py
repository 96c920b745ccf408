"""Arrays that describe a scene to the ray caster, and numbers of its parts."""

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
        Metres. ``x, z`` of the axis, ``cos, sin`` of the yaw, half width along the shape's own x
        and z (the radius, for round shapes, in the first), y of the top, y of the bottom, and the
        kind: BOX, CYLINDER or ELLIPSOID.
    cell_start : ndarray of int64, shape (nx * nz + 1,)
    cell_shape : ndarray of int64, shape (M,)
        Shapes that reach into each cell of the grid: those of cell ``(i, j)`` are
        ``cell_shape[cell_start[j * nx + i] : cell_start[j * nx + i + 1]]``.
    cell_top : ndarray, shape (nx * nz,)
        y of the top of the highest shape in each cell.
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
        The inner ones first: ``x, z`` of the centre and radius, m.
    height : ndarray, shape (K, A)
        Heights above ground at A equal steps of azimuth, m.
    """

    ring: np.ndarray
    height: np.ndarray


class Finish(NamedTuple):
    """What the surfaces look like.

    Attributes
    ----------
    paint : ndarray, shape (S + 1 + K, 7)
        For every shape, then the ground, then every ring: mean grey, texture of the pattern, its
        metres per texel, its gain in grey, gain of the noise in grey, and offsets in u and v, m.
    texels : ndarray of float32
        Mip pyramids of all textures, one after the other, each from fine to coarse.
    texture : ndarray of int64, shape (T, 2)
        Start in ``texels`` and binary logarithm of the width for each texture; 0 is the noise.
    """

    paint: np.ndarray
    texels: np.ndarray
    texture: np.ndarray


class Scene(NamedTuple):
    """Arrays of a scene."""

    blocks: Blocks
    hills: Hills
    finish: Finish
