"""The arrays that describe a scene to the ray caster, and the numbers that name its parts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = ["BOX", "CYLINDER", "ELLIPSOID", "GROUND", "NOTHING", "SKY", "SceneArrays", "ring_surface"]

# Kinds of shapes, rows of `SceneArrays.kind`.
BOX = 0
CYLINDER = 1
ELLIPSOID = 2

# Surfaces that are no shape; shapes are numbered from 0, rings of hills from -4 downwards.
GROUND = -1
SKY = -2
NOTHING = -3


def ring_surface(ring: int) -> int:
    """Number of a ring's surface."""
    return -4 - ring


class SceneArrays(NamedTuple):
    """A scene of upright shapes on flat ground within rings of hills; y points down, ground is y=0.

    Attributes
    ----------
    kind : ndarray of int64, shape (S,)
        BOX, CYLINDER or ELLIPSOID.
    shape : ndarray, shape (S, 8)
        Metres. ``x, z`` of the axis, ``cos, sin`` of the yaw, half width along the shape's own x
        and z (the radius, for round shapes, in the first), y of the top, y of the bottom.
    cell_start : ndarray of int64, shape (nx * nz + 1,)
    cell_shape : ndarray of int64, shape (M,)
        Shapes that reach into each cell of a grid on the ground: those of cell ``(i, j)`` are
        ``cell_shape[cell_start[j * nx + i] : cell_start[j * nx + i + 1]]``.
    grid : ndarray, shape (5,)
        ``x, z`` of the grid's corner, m, size of a cell, m, ``nx``, ``nz``.
    top_y : float
        Top of the highest shape.
    ring : ndarray, shape (K, 3)
        Circles of hills, the inner ones first: ``x, z`` of the centre and radius, m.
    ring_height : ndarray, shape (K, A)
        Heights above ground at A equal steps of azimuth, m.
    paint : ndarray, shape (S + 1 + K, 7)
        For every shape, then the ground, then every ring: mean grey, texture of the pattern, its
        metres per texel, its gain in grey, gain of the noise in grey, and the offsets in u and v, m.
    texels : ndarray of float32
        Mip pyramids of all textures, one after the other, each from fine to coarse.
    texture : ndarray of int64, shape (T, 2)
        Start in ``texels`` and binary logarithm of the width for each texture; 0 is the noise.
    """

    kind: np.ndarray
    shape: np.ndarray
    cell_start: np.ndarray
    cell_shape: np.ndarray
    grid: np.ndarray
    top_y: float
    ring: np.ndarray
    ring_height: np.ndarray
    paint: np.ndarray
    texels: np.ndarray
    texture: np.ndarray
