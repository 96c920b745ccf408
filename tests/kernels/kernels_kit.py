"""Matches and poses for the kernels, and what they compute written down plainly."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from farpoint._kernels.pairs import RayPairs
from farpoint.geometry import so3, sphere


class View(NamedTuple):
    """Two views of points: what a kernel is given, and the true pose."""

    pairs: RayPairs
    R: np.ndarray
    t: np.ndarray


def two_views(
    seed: int,
    matches: int = 20,
    *,
    error_rad: float = 0.0,
    noise_rad: float = 1e-3,
    turn_rad: float = 0.3,
    baseline_m: float = 0.5,
    depth_m: tuple[float, float] = (2.0, 6.0),
) -> View:
    """Rays within 45 degrees of the axis, each with an anisotropic noise factor of its own."""
    rng = np.random.default_rng(seed)
    R = so3.exp(turn_rad * sphere.normalize(rng.normal(size=3)))
    t = sphere.normalize(rng.normal(size=3))
    rays0 = sphere.normalize(np.c_[rng.uniform(-1, 1, (matches, 2)), np.ones(matches)])
    depth = rng.uniform(*depth_m, (matches, 1))
    rays1 = sphere.normalize(depth * rays0 @ R.T + baseline_m * t)
    rays1 = sphere.normalize(rays1 + error_rad * rng.normal(size=(matches, 3)))
    factors = noise_rad * rng.normal(size=(2, matches, 2, 2)) + noise_rad * np.eye(2)
    noise0 = sphere.tangent_basis(rays0) @ factors[0]
    noise1 = sphere.tangent_basis(rays1) @ factors[1]
    arrays = (np.ascontiguousarray(a) for a in (rays0, rays1, noise0, noise1))
    return View(RayPairs(*arrays), R, t)


def moved(R: np.ndarray, t: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pose after ``step = [dtheta (3), dbeta (2)]``: perturbed on the left, on the sphere."""
    basis = sphere.tangent_basis(t)
    return so3.exp(step[:3]) @ R, sphere.retract(t, basis, step[3:])


def gradient(function: Callable[[np.ndarray], float], size: int, step: float) -> np.ndarray:
    """Central differences of a function of (size,) at zero, with one Richardson extrapolation."""

    def slope(h: float) -> np.ndarray:
        return np.array([(function(h * e) - function(-h * e)) / (2 * h) for e in np.eye(size)])

    return (4.0 * slope(step / 2) - slope(step)) / 3.0
