"""A town around a path: streets in a grid, houses, parked cars, poles, trees, hills and sky.

World axes are x right, y down, z forward, in metres. The ground is y = 0. Streets run along x and
z, and the middle of each street is at a multiple of `BLOCK_M`. The objects in a cell of the town
depend only on the seed and the cell, but objects on the path are left out. Only cells near the path
contain objects.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import KDTree

from farpoint.synthetic import textures
from farpoint.synthetic.kernels.scene_arrays import Blocks, Finish, Hills, Scene
from farpoint.synthetic.things import (
    FACADES,
    Shapes,
    build_house,
    lay_garden,
    line_street,
    plant_tree,
)

__all__ = ["BLOCK_M", "CELL_M", "LANE_M", "ROAD_M", "build_street"]

CELL_M = 12.0
BLOCK_CELLS = 4
BLOCK_M = CELL_M * BLOCK_CELLS
ROAD_M = 8.0
LANE_M = 1.9
"""Distance from the middle of the street to the middle of the lane on the right."""

_REACH_M = 150.0  # largest distance of cells with objects from the path
_CLEARANCE_M = 1.6  # least distance of objects from the path
_GRID_M = 3.0  # size of a cell of the ray caster's grid
_ROAD_TEXTURE = 1 + FACADES
_ROAD_LOG2_WIDTH = 11
# For each ring of hills: distance beyond the town, m, and scale of the heights, m.
_RINGS_M = ((240.0, 40.0), (600.0, 130.0), (1400.0, 380.0))
_RING_STEPS = 8192


def build_street(positions: np.ndarray, seed: int) -> Scene:
    """The scene around a path.

    Parameters
    ----------
    positions : ndarray, shape (N, 3)
        Positions of the camera in the world, m; above ground (y < 0).
    seed : int
        The same seed gives the same town.
    """
    near_path = KDTree(positions[:, [0, 2]])
    shapes = Shapes()
    low = np.floor((positions[:, [0, 2]].min(axis=0) - _REACH_M) / CELL_M).astype(int)
    high = np.ceil((positions[:, [0, 2]].max(axis=0) + _REACH_M) / CELL_M).astype(int)
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            centre = (CELL_M * i, CELL_M * j)
            if near_path.query(centre)[0] < _REACH_M:
                # The offset 1 << 20 avoids negative seeds, which are invalid.
                rng = np.random.default_rng((seed, i + (1 << 20), j + (1 << 20)))
                _furnish(shapes, rng, i, j)
    kept = _clear_of(near_path, shapes)
    return _assemble(shapes, kept, positions, low, high, seed)


def _furnish(shapes: Shapes, rng: np.random.Generator, i: int, j: int) -> None:
    """Put objects into the cell centred at ``(CELL_M * i, CELL_M * j)``."""
    x, z = CELL_M * i, CELL_M * j
    along_z, along_x = i % BLOCK_CELLS == 0, j % BLOCK_CELLS == 0
    if along_z and along_x:
        return
    if along_z or along_x:
        line_street(shapes, rng, x, z, along_z)
    elif i % BLOCK_CELLS == 2 and j % BLOCK_CELLS == 2:
        plant_tree(shapes, rng, x, z, rng.uniform(6.0, 11.0))  # the yard within the block
    elif rng.random() < 0.55:
        build_house(shapes, rng, x, z)
    else:
        lay_garden(shapes, rng, x, z)


def _clear_of(near_path: KDTree, shapes: Shapes) -> np.ndarray:
    """Indices of the shapes of all objects that are not on the path."""
    rows = np.array(shapes.shape).reshape(-1, 9)
    centre, half = rows[:, :2], rows[:, 4:6]
    margin = _CLEARANCE_M + np.hypot(half[:, 0], half[:, 1])
    thing, in_the_way = np.array(shapes.thing), set()
    for index, close in enumerate(near_path.query_ball_point(centre, margin)):
        cos, sin = rows[index, 2:4]
        offset = np.asarray(near_path.data)[close] - centre[index]
        local = np.abs(offset @ np.array([[cos, -sin], [sin, cos]])) - half[index]
        if (local.max(axis=1) < _CLEARANCE_M).any():
            in_the_way.add(thing[index])
    return np.flatnonzero(~np.isin(thing, list(in_the_way)))


def _assemble(
    shapes: Shapes,
    kept: np.ndarray,
    positions: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    seed: int,
) -> Scene:
    rows = np.array(shapes.shape).reshape(-1, 9)[kept]
    hills = _raise_hills(positions, np.random.default_rng((seed, 1)))
    texel_m = BLOCK_M / (1 << _ROAD_LOG2_WIDTH)
    ground = (80.0, _ROAD_TEXTURE, texel_m, 1.0, 10.0, 0.0, 0.0)
    slopes = [(95.0 + 22.0 * k, 0.0, 0.6 * 3.0**k, 13.0, 6.0, 37.0 * k, 0.0) for k in range(3)]
    paint = np.array([*(shapes.paint[k] for k in kept), ground, *slopes])
    # Cells are centred on multiples of their size, so that a street is one cell wide.
    grid_low, grid_high = (low - 0.5) * CELL_M, (high + 0.5) * CELL_M
    return Scene(
        blocks=_sort_into_grid(rows, grid_low, grid_high),
        hills=hills,
        finish=Finish(paint, *_pictures(seed)),
    )


@lru_cache(maxsize=1)
def _pictures(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Texels and table of all textures.

    The result for the last seed is cached, because textures take longer than the shapes of a town.
    """
    rng = np.random.default_rng((seed, 0))
    pictures = [textures.noise(rng)]
    pictures += [textures.facade(rng) for _ in range(FACADES)]
    pictures += [textures.road(rng, BLOCK_M, ROAD_M, _ROAD_LOG2_WIDTH)]
    return textures.pyramids(pictures)


def _sort_into_grid(rows: np.ndarray, low: np.ndarray, high: np.ndarray) -> Blocks:
    """Shapes ``rows`` (S, 9), sorted into the cells of a grid from ``low`` to ``high`` (x, z).

    A shape is in each cell that the bounding rectangle of the shape touches.
    """
    cells = np.ceil((high - low) / _GRID_M).astype(int)
    cos, sin = np.abs(rows[:, 2]), np.abs(rows[:, 3])
    half = np.stack(
        [cos * rows[:, 4] + sin * rows[:, 5], sin * rows[:, 4] + cos * rows[:, 5]], axis=1
    )
    first = np.floor((rows[:, :2] - half - low) / _GRID_M).astype(int).clip(0, cells - 1)
    last = np.floor((rows[:, :2] + half - low) / _GRID_M).astype(int).clip(0, cells - 1)
    pairs = [
        (j * cells[0] + i, index)
        for index in range(len(rows))
        for j in range(first[index, 1], last[index, 1] + 1)
        for i in range(first[index, 0], last[index, 0] + 1)
    ]
    table = np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)
    cell_top = np.full(cells[0] * cells[1], np.inf)
    np.minimum.at(cell_top, table[:, 0], rows[table[:, 1], 6])
    highest = rows[:, 6].min(initial=0.0)
    return Blocks(
        shape=rows,
        cell_start=np.searchsorted(table[:, 0], np.arange(len(cell_top) + 1)),
        cell_shape=np.ascontiguousarray(table[:, 1]),
        cell_top=cell_top,
        grid=np.array([*low, _GRID_M, *cells, highest]),
    )


def _raise_hills(positions: np.ndarray, rng: np.random.Generator) -> Hills:
    """Rings of hills around the town, with the skyline of each ring.

    Each ring is higher and farther away than the previous ring.
    """
    flat = positions[:, [0, 2]]
    centre = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    town = np.linalg.norm(flat - centre, axis=1).max() + _REACH_M
    rings = np.array([(*centre, town + distance) for distance, _ in _RINGS_M])
    heights = []
    for _, height in _RINGS_M:
        skyline = np.zeros(_RING_STEPS)
        for octave in range(6):
            rough = rng.normal(size=_RING_STEPS)
            smooth = gaussian_filter1d(rough, _RING_STEPS / 18 / 2**octave, mode="wrap")
            skyline += smooth / smooth.std() / 1.8**octave
        heights.append(height * (0.6 + 0.22 * skyline).clip(0.05))
    return Hills(rings, np.stack(heights))
