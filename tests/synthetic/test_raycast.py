"""The ray caster against every shape tried by itself, with formulas of its own."""

from __future__ import annotations

import numpy as np

from farpoint.synthetic.kernels.constants import BOX, CYLINDER
from farpoint.synthetic.kernels.raycast import cast_rays
from farpoint.synthetic.kernels.scene_arrays import Blocks
from farpoint.synthetic.street import build_street


def box_distances(row: np.ndarray, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Intersect the six planes, keep the points that lie on the box."""
    x, z, cos, sin, half_x, half_z, top, bottom = row[:8]
    R = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    start = R @ (origin - np.array([x, 0.5 * (top + bottom), z]))
    along = rays @ R.T
    half = np.array([half_x, 0.5 * (bottom - top), half_z])
    best = np.full(len(rays), np.inf)
    for axis in range(3):
        for side in (-1.0, 1.0):
            t = (side * half[axis] - start[axis]) / along[:, axis]
            point = start + t[:, None] * along
            others = [k for k in range(3) if k != axis]
            on_face = (np.abs(point[:, others]) <= half[others]).all(axis=1)
            # From outside in: the plane faces the origin.
            hit = on_face & (t > 0) & (side * start[axis] > half[axis])
            best = np.where(hit & (t < best), t, best)
    return best


def round_distances(row: np.ndarray, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Roots of the implicit surface along each ray."""
    x, z, _, _, radius, _, top, bottom, kind = row
    centre = np.array([x, 0.5 * (top + bottom), z])
    height = 0.5 * (bottom - top)
    weights = np.array([1 / radius**2, 0.0 if kind == CYLINDER else 1 / height**2, 1 / radius**2])
    best = np.full(len(rays), np.inf)
    for i, ray in enumerate(rays):
        p = origin - centre
        roots = np.roots([weights @ ray**2, 2 * weights @ (p * ray), weights @ p**2 - 1])
        roots = np.sort(roots[np.isreal(roots)].real)
        if len(roots) and roots[0] > 0 and abs(p[1] + roots[0] * ray[1]) <= height * 1.000001:
            best[i] = roots[0]
    return best


def expected_distances(blocks: Blocks, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    best = np.where(rays[:, 1] > 0, -origin[1] / rays[:, 1], np.inf)
    for row in blocks.shape:
        to_axis = np.hypot(*(row[:2] - origin[[0, 2]]))
        if to_axis > 60.0:
            continue
        distances = box_distances if row[8] == BOX else round_distances
        best = np.minimum(best, distances(row, origin, rays))
    return best


def test_rays_end_where_the_first_of_all_shapes_is():
    rng = np.random.default_rng(8)
    origin = np.array([1.9, -1.65, 12.0])
    street = build_street(origin[None], seed=5)
    rays = rng.normal(size=(150, 3)) * np.array([1.0, 0.15, 1.0])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found = np.empty(len(rays))
    cast_rays(street.blocks, street.hills, np.tile(origin, (len(rays), 1)), rays, found)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = expected_distances(street.blocks, origin, rays)
    near = np.minimum(found, expected) < 50.0  # the oracle looks no farther
    assert near.mean() > 0.7
    np.testing.assert_allclose(found[near], expected[near], rtol=1e-9)
    beyond = found[~near]
    assert (beyond >= 49.0).all()


def test_rays_along_the_axes_end_too():
    origin = np.array([1.9, -1.65, 12.0])
    street = build_street(origin[None], seed=5)
    rays = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    found = np.empty(4)
    cast_rays(street.blocks, street.hills, np.tile(origin, (len(rays), 1)), rays, found)
    assert found[0] == 1.65
    assert np.isinf(found[1])
    assert (found[2:] > 1.0).all()
    assert np.isfinite(found[2:]).all()
