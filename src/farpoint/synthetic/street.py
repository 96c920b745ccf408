"""A town around a path: streets in a grid, houses, parked cars, poles, trees, hills and sky.

World axes are x right, y down, z forward, in metres; the ground is y = 0. Streets run along x and z,
their middles at multiples of `BLOCK_M`. What stands in a place depends on the seed and on the place
alone; only places near the path are built, so a longer drive does not cost more per frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from farpoint._kernels.scene_arrays import BOX, CYLINDER, ELLIPSOID, Blocks, Finish, Hills
from farpoint.synthetic import textures

__all__ = ["BLOCK_M", "CELL_M", "LANE_M", "ROAD_M", "Street", "build_street"]

CELL_M = 12.0
BLOCK_CELLS = 4
BLOCK_M = CELL_M * BLOCK_CELLS
ROAD_M = 8.0
LANE_M = 1.9
"""From the middle of the street to the middle of the lane on the right."""

_REACH_M = 150.0  # from the path: houses stand up to here, meadows beyond
_CLEARANCE_M = 1.6  # from the path: nothing stands here
_GRID_M = 3.0  # cell of the ray caster's grid
_FACADES = 4
_ROAD_TEXTURE = 1 + _FACADES
_ROAD_LOG2_WIDTH = 11
_NO_PATTERN = (0.0, 1.0, 0.0)  # texture, metres per texel, gain
_RINGS_M = ((240.0, 40.0), (600.0, 130.0), (1400.0, 380.0))  # beyond the houses: distance, height
_RING_STEPS = 8192


class Street(NamedTuple):
    """A scene for the renderer."""

    blocks: Blocks
    hills: Hills
    finish: Finish


@dataclass
class _Shapes:
    """Shapes as they are put up, one row each; see `Blocks` and `Finish`."""

    shape: list[tuple[float, ...]] = field(default_factory=list)
    paint: list[tuple[float, ...]] = field(default_factory=list)

    def box(self, x, z, yaw, half_x, half_z, top, paint, *, bottom=0.0) -> None:
        """Upright box; ``top`` and ``bottom`` are heights above ground, m."""
        turn = (math.cos(yaw), math.sin(yaw))
        self.shape.append((x, z, *turn, half_x, half_z, -top, -bottom, BOX))
        self.paint.append(paint)

    def round(self, kind, x, z, radius, top, paint, *, bottom=0.0) -> None:
        """Cylinder or ellipsoid around an upright axis."""
        self.shape.append((x, z, 1.0, 0.0, radius, radius, -top, -bottom, kind))
        self.paint.append(paint)


def build_street(positions: np.ndarray, seed: int) -> Street:
    """The scene around a path.

    Parameters
    ----------
    positions : ndarray, shape (N, 3)
        Where the camera will be, world, m; above ground (y < 0).
    seed : int
        The same seed gives the same town.
    """
    near_path = cKDTree(positions[:, [0, 2]])
    shapes = _Shapes()
    low = np.floor((positions[:, [0, 2]].min(axis=0) - _REACH_M) / CELL_M).astype(int)
    high = np.ceil((positions[:, [0, 2]].max(axis=0) + _REACH_M) / CELL_M).astype(int)
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            centre = (CELL_M * i, CELL_M * j)
            if near_path.query(centre)[0] < _REACH_M:
                # Offset, as seeds may not be negative.
                rng = np.random.default_rng((seed, i + (1 << 20), j + (1 << 20)))
                _furnish(shapes, rng, i, j)
    kept = _clear_of(near_path, shapes)
    return _assemble(shapes, kept, positions, low, high, np.random.default_rng((seed, 1)))


def _furnish(shapes: _Shapes, rng: np.random.Generator, i: int, j: int) -> None:
    """Put things into the cell centred at ``(CELL_M * i, CELL_M * j)``."""
    x, z = CELL_M * i, CELL_M * j
    along_z, along_x = i % BLOCK_CELLS == 0, j % BLOCK_CELLS == 0
    if along_z and along_x:
        return
    if along_z or along_x:
        _line_street(shapes, rng, x, z, along_z)
    elif i % BLOCK_CELLS == 2 and j % BLOCK_CELLS == 2:
        _plant_tree(shapes, rng, x, z, rng.uniform(6.0, 11.0))  # the yard within the block
    elif rng.random() < 0.55:
        _build_house(shapes, rng, x, z)
    else:
        _lay_garden(shapes, rng, x, z)


def _build_house(shapes: _Shapes, rng: np.random.Generator, x: float, z: float) -> None:
    half_x, half_z = rng.uniform(3.2, 5.9, 2)
    height = 3.2 * rng.integers(1, 4) + rng.uniform(0.1, 0.5)  # whole rows of windows
    x, z = x + rng.uniform(-1, 1) * (5.9 - half_x), z + rng.uniform(-1, 1) * (5.9 - half_z)
    yaw = rng.normal(0.0, 0.03) if rng.random() < 0.7 else rng.uniform(-0.25, 0.25)
    shrink = 1.0 / (math.cos(yaw) + abs(math.sin(yaw)))  # stay within the cell
    pattern = (1 + rng.integers(_FACADES), 0.025, rng.uniform(40.0, 65.0))
    base = rng.uniform(85.0, 150.0)
    bay = 3.2
    offset = (bay * rng.integers(8), bay * rng.integers(8))
    wall = (base, *pattern, 10.0, *offset)
    shapes.box(x, z, yaw, half_x * shrink, half_z * shrink, height, wall)
    roof = (rng.uniform(60.0, 110.0), *_NO_PATTERN, 9.0, *rng.uniform(0, 90, 2))
    eaves = 0.3
    shapes.box(
        x,
        z,
        yaw,
        half_x * shrink + eaves,
        half_z * shrink + eaves,
        height + rng.uniform(0.3, 0.9),
        roof,
        bottom=height,
    )
    if rng.random() < 0.6:
        cx, cz = x + rng.uniform(-2, 2), z + rng.uniform(-2, 2)
        shapes.box(cx, cz, yaw, 0.5, 0.5, height + rng.uniform(1.2, 2.4), roof, bottom=height)


def _lay_garden(shapes: _Shapes, rng: np.random.Generator, x: float, z: float) -> None:
    hedge = (rng.uniform(60.0, 95.0), *_NO_PATTERN, 13.0, *rng.uniform(0, 90, 2))
    half_x, half_z = ((5.5, 0.35), (0.35, 5.5))[rng.integers(2)]
    shapes.box(x + rng.uniform(-4, 4), z + rng.uniform(-4, 4), 0.0, half_x, half_z, 1.1, hedge)
    for _ in range(rng.integers(1, 4)):
        at = (x + rng.uniform(-4, 4), z + rng.uniform(-4, 4))
        _plant_tree(shapes, rng, *at, rng.uniform(3.5, 7.0))


def _plant_tree(
    shapes: _Shapes, rng: np.random.Generator, x: float, z: float, height: float
) -> None:
    trunk = (rng.uniform(45.0, 75.0), *_NO_PATTERN, 9.0, *rng.uniform(0, 90, 2))
    crown = (rng.uniform(60.0, 115.0), *_NO_PATTERN, 17.0, *rng.uniform(0, 90, 2))
    bottom = 0.3 * height
    shapes.round(CYLINDER, x, z, 0.03 * height, 1.3 * bottom, trunk)
    shapes.round(ELLIPSOID, x, z, rng.uniform(0.24, 0.34) * height, height, crown, bottom=bottom)


def _line_street(
    shapes: _Shapes, rng: np.random.Generator, x: float, z: float, along_z: bool
) -> None:
    """Parked cars, lamps, bins and boxes on both sides of one cell of a street."""

    def place(along: float, aside: float) -> tuple[float, float]:
        return (x + aside, z + along) if along_z else (x + along, z + aside)

    turned = 0.0 if along_z else math.pi / 2
    for side in (-1.0, 1.0):
        if rng.random() < 0.4:
            yaw = turned + rng.normal(0.0, 0.02)
            _park_car(shapes, rng, *place(rng.uniform(-3.5, 3.5), side * 4.9), yaw)
        if rng.random() < 0.5:
            dark = (rng.uniform(40.0, 70.0), *_NO_PATTERN, 7.0, *rng.uniform(0, 90, 2))
            at = place(rng.uniform(-5.5, 5.5), side * 5.8)
            shapes.round(CYLINDER, *at, rng.uniform(0.07, 0.13), rng.uniform(4.0, 8.0), dark)
        if rng.random() < 0.15:
            _plant_tree(shapes, rng, *place(rng.uniform(-5.5, 5.5), side * 6.6), 6.0)
        if rng.random() < 0.35:
            stuff = (rng.uniform(50.0, 190.0), *_NO_PATTERN, 12.0, *rng.uniform(0, 90, 2))
            half_x, half_z, height = rng.uniform((0.25, 0.25, 0.6), (0.7, 0.7, 1.7))
            at = place(rng.uniform(-5.0, 5.0), side * 6.4)
            shapes.box(*at, rng.uniform(-0.6, 0.6), half_x, half_z, height, stuff)


def _park_car(
    shapes: _Shapes, rng: np.random.Generator, x: float, z: float, yaw: float
) -> None:
    body = (rng.uniform(50.0, 205.0), *_NO_PATTERN, 4.0, *rng.uniform(0, 90, 2))
    glass = (rng.uniform(35.0, 60.0), *_NO_PATTERN, 6.0, *rng.uniform(0, 90, 2))
    tyre = (28.0, *_NO_PATTERN, 3.0, *rng.uniform(0, 90, 2))
    length, height = rng.uniform(3.8, 4.8), rng.uniform(0.85, 1.0)
    cos, sin = math.cos(yaw), math.sin(yaw)

    def part(along, half_width, half_length, top, paint, bottom) -> None:
        # The car's own z axis, turned by the yaw of the box.
        at = (x - sin * along, z + cos * along)
        shapes.box(*at, yaw, half_width, half_length, top, paint, bottom=bottom)

    part(0.0, 0.88, length / 2, height, body, 0.28)
    part(-0.2, 0.76, length * 0.27, height + 0.48, glass, height)
    part(-0.2, 0.8, length * 0.25, height + 0.55, body, height + 0.48)
    for along in (-0.3, 0.3):
        part(along * length, 0.86, 0.32, 0.62, tyre, 0.0)


def _clear_of(near_path: cKDTree, shapes: _Shapes) -> np.ndarray:
    """Indices of the shapes that leave the path free."""
    rows = np.array(shapes.shape).reshape(-1, 9)
    centre, half = rows[:, :2], rows[:, 4:6]
    margin = _CLEARANCE_M + np.hypot(half[:, 0], half[:, 1])
    kept = []
    for index, close in enumerate(near_path.query_ball_point(centre, margin)):
        cos, sin = rows[index, 2:4]
        offset = np.asarray(near_path.data)[close] - centre[index]
        local = np.abs(offset @ np.array([[cos, -sin], [sin, cos]])) - half[index]
        if not (local.max(axis=1) < _CLEARANCE_M).any():
            kept.append(index)
    return np.array(kept, dtype=np.int64)


def _assemble(
    shapes: _Shapes,
    kept: np.ndarray,
    positions: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    rng: np.random.Generator,
) -> Street:
    rows = np.array(shapes.shape).reshape(-1, 9)[kept]
    hills = _raise_hills(positions, rng)
    texel_m = BLOCK_M / (1 << _ROAD_LOG2_WIDTH)
    ground = (80.0, _ROAD_TEXTURE, texel_m, 1.0, 10.0, 0.0, 0.0)
    slopes = [(95.0 + 22.0 * k, 0.0, 0.6 * 3.0**k, 13.0, 6.0, 37.0 * k, 0.0) for k in range(3)]
    paint = np.array([*(shapes.paint[k] for k in kept), ground, *slopes])
    pictures = [textures.noise(rng)]
    pictures += [textures.facade(rng) for _ in range(_FACADES)]
    pictures += [textures.road(rng, BLOCK_M, ROAD_M, _ROAD_LOG2_WIDTH)]
    texels, texture = textures.pyramids(pictures)
    # Cells are centred on multiples of their size, so that a street is one cell wide.
    grid_low, grid_high = (low - 0.5) * CELL_M, (high + 0.5) * CELL_M
    return Street(
        blocks=_sort_into_grid(rows, grid_low, grid_high),
        hills=hills,
        finish=Finish(paint, texels, texture),
    )


def _sort_into_grid(rows: np.ndarray, low: np.ndarray, high: np.ndarray) -> Blocks:
    """Shapes of every cell of a grid from ``low`` to ``high`` (x, z), by their rectangles."""
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
    """Rings around the town, each higher and farther than the one before, and their skylines."""
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
