"""Objects of the street: houses, gardens, trees, lamps, boxes and parked cars.

Objects are placed at random within a cell of `farpoint.synthetic.street`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from farpoint.synthetic.kernels.constants import BOX, CYLINDER, ELLIPSOID

__all__ = ["FACADES", "Shapes", "build_house", "lay_garden", "line_street", "plant_tree"]

_BAY_M = 3.2  # width and height of a window with the wall around the window

FACADES = 4
"""Number of textures of facades, numbered from 1."""


@dataclass
class Shapes:
    """Table of shapes, with one row for each added shape; see `Blocks` and `Finish`.

    ``thing`` is the number of the object to which a shape belongs. The shapes of one object, such
    as the parts of a car, are kept or removed together.
    """

    thing: list[int] = field(default_factory=list)
    shape: list[tuple[float, ...]] = field(default_factory=list)
    paint: list[tuple[float, ...]] = field(default_factory=list)
    begun: int = 0

    def begin(self) -> None:
        """Begin a new object, to which the next shapes belong."""
        self.begun += 1

    def box(self, x, z, yaw, half_x, half_z, top, paint, *, bottom=0.0) -> None:
        """Upright box; ``top`` and ``bottom`` are heights above ground, m."""
        turn = (math.cos(yaw), math.sin(yaw))
        self.shape.append((x, z, *turn, half_x, half_z, -top, -bottom, BOX))
        self.paint.append(paint)
        self.thing.append(self.begun)

    def round(self, kind, x, z, radius, top, paint, *, bottom=0.0) -> None:
        """Cylinder or ellipsoid around an upright axis."""
        self.shape.append((x, z, 1.0, 0.0, radius, radius, -top, -bottom, kind))
        self.paint.append(paint)
        self.thing.append(self.begun)


def build_house(shapes: Shapes, rng: np.random.Generator, x: float, z: float) -> None:
    """House of one to three floors with a roof and a chimney, slightly rotated to the street."""
    shapes.begin()
    half_x, half_z = rng.uniform(3.2, 5.9, 2)
    height = _BAY_M * rng.integers(1, 4) + rng.uniform(0.1, 0.5)  # whole rows of windows
    x, z = x + rng.uniform(-1, 1) * (5.9 - half_x), z + rng.uniform(-1, 1) * (5.9 - half_z)
    yaw = rng.normal(0.0, 0.03) if rng.random() < 0.7 else rng.uniform(-0.25, 0.25)
    shrink = 1.0 / (math.cos(yaw) + abs(math.sin(yaw)))  # stay within the cell
    pattern = (1 + rng.integers(FACADES), _BAY_M / 128, rng.uniform(40.0, 65.0))
    base = rng.uniform(85.0, 150.0)
    wall = (base, *pattern, 10.0, *(_BAY_M * rng.integers(0, 8, 2)))
    shapes.box(x, z, yaw, half_x * shrink, half_z * shrink, height, wall)
    roof = _plain(rng, 60.0, 110.0, 9.0)
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


def lay_garden(shapes: Shapes, rng: np.random.Generator, x: float, z: float) -> None:
    """Garden with a hedge and a few trees, all so low that hills and sky are visible."""
    shapes.begin()
    hedge = _plain(rng, 60.0, 95.0, 13.0)
    half_x, half_z = ((5.5, 0.35), (0.35, 5.5))[rng.integers(2)]
    shapes.box(x + rng.uniform(-4, 4), z + rng.uniform(-4, 4), 0.0, half_x, half_z, 1.1, hedge)
    for _ in range(rng.integers(1, 4)):
        at = (x + rng.uniform(-4, 4), z + rng.uniform(-4, 4))
        plant_tree(shapes, rng, *at, rng.uniform(3.5, 7.0))


def plant_tree(shapes: Shapes, rng: np.random.Generator, x: float, z: float, height: float) -> None:
    """Tree of ``height`` m with a trunk and a crown."""
    shapes.begin()
    trunk = _plain(rng, 45.0, 75.0, 9.0)
    crown = _plain(rng, 60.0, 115.0, 17.0)
    bottom = 0.3 * height
    shapes.round(CYLINDER, x, z, 0.03 * height, 1.3 * bottom, trunk)
    shapes.round(ELLIPSOID, x, z, rng.uniform(0.24, 0.34) * height, height, crown, bottom=bottom)


def line_street(
    shapes: Shapes, rng: np.random.Generator, x: float, z: float, along_z: bool
) -> None:
    """Parked cars, lamps, bins and boxes on both sides of one cell of a street."""

    def place(along: float, aside: float) -> tuple[float, float]:
        return (x + aside, z + along) if along_z else (x + along, z + aside)

    line_yaw = 0.0 if along_z else math.pi / 2
    for side in (-1.0, 1.0):
        if rng.random() < 0.4:
            yaw = line_yaw + rng.normal(0.0, 0.02)
            _park_car(shapes, rng, *place(rng.uniform(-3.5, 3.5), side * 4.9), yaw)
        if rng.random() < 0.5:
            shapes.begin()
            dark = _plain(rng, 40.0, 70.0, 7.0)
            at = place(rng.uniform(-5.5, 5.5), side * 5.8)
            shapes.round(CYLINDER, *at, rng.uniform(0.07, 0.13), rng.uniform(4.0, 8.0), dark)
        if rng.random() < 0.15:
            plant_tree(shapes, rng, *place(rng.uniform(-5.5, 5.5), side * 6.6), 6.0)
        if rng.random() < 0.35:
            shapes.begin()
            stuff = _plain(rng, 50.0, 190.0, 12.0)
            half_x, half_z, height = rng.uniform((0.25, 0.25, 0.6), (0.7, 0.7, 1.7))
            at = place(rng.uniform(-5.0, 5.0), side * 6.4)
            shapes.box(*at, rng.uniform(-0.6, 0.6), half_x, half_z, height, stuff)


def _plain(
    rng: np.random.Generator, darkest: float, lightest: float, noise: float
) -> tuple[float, ...]:
    """Paint without a pattern: a random mean grey level in a range, and a gain of the noise."""
    return (rng.uniform(darkest, lightest), 0.0, 1.0, 0.0, noise, *rng.uniform(0.0, 90.0, 2))


def _park_car(shapes: Shapes, rng: np.random.Generator, x: float, z: float, yaw: float) -> None:
    shapes.begin()
    body = _plain(rng, 50.0, 205.0, 4.0)
    glass = _plain(rng, 35.0, 60.0, 6.0)
    tyre = _plain(rng, 25.0, 31.0, 3.0)
    length, height = rng.uniform(3.8, 4.8), rng.uniform(0.85, 1.0)
    cos, sin = math.cos(yaw), math.sin(yaw)

    def part(along, half_width, half_length, top, paint, bottom) -> None:
        # ``along`` is the offset along the car's own z axis, which the yaw rotates.
        at = (x - sin * along, z + cos * along)
        shapes.box(*at, yaw, half_width, half_length, top, paint, bottom=bottom)

    part(0.0, 0.88, length / 2, height, body, 0.28)
    part(-0.2, 0.76, length * 0.27, height + 0.48, glass, height)
    part(-0.2, 0.8, length * 0.25, height + 0.55, body, height + 0.48)
    for along in (-0.3, 0.3):
        part(along * length, 0.86, 0.32, 0.62, tyre, 0.0)
