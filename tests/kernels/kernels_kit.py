"""Matches and poses for the kernels, and reference implementations in plain NumPy."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import LANES, LONG_TAIL, PANEL
from farpoint._kernels.pairs import pack_pairs, packed_length
from farpoint._kernels.pose import PackedMatches, Pose
from farpoint.geometry import so3, sphere

UNIT = np.eye(2)[None]


class View(NamedTuple):
    """Two views of points: unit rays (N, 3), factors (N, 3, 2) of their noise, the true pose."""

    rays0: np.ndarray
    rays1: np.ndarray
    noise0: np.ndarray
    noise1: np.ndarray
    R: np.ndarray
    t: np.ndarray

    @property
    def size(self) -> int:
        """Number of matches."""
        return len(self.rays0)

    @property
    def pairs(self) -> np.ndarray:
        """The matches in panels."""
        n = self.size
        pairs, index = np.full(packed_length(n) // LANES * PANEL, np.nan), np.empty(n, np.int64)
        given = (np.ascontiguousarray(array) for array in self[:4])
        count, _ = pack_pairs(*given, UNIT, UNIT, 0.0, pairs, index)
        assert count == n
        return pairs


def packed(values: np.ndarray) -> np.ndarray:
    """Values of the matches (N,), with zeros for filler."""
    out = np.zeros(packed_length(len(values)))
    out[: len(values)] = values
    return out


def matches_of(
    view: View, half_width: float, prior: np.ndarray | None = None, *, soft_cheirality: bool
) -> PackedMatches:
    """Packed matches with prior 1, or with a given packed ``prior``."""
    odds = packed(np.ones(view.size))
    prior = odds.copy() if prior is None else prior
    return PackedMatches(
        view.pairs, prior, odds, view.size, half_width, LONG_TAIL, 1e-6, math.inf, soft_cheirality
    )


def shares_of(tail_share: float, tail: float = LONG_TAIL) -> np.ndarray:
    """Shares (4, 1) of the core and the components of the tail among inliers."""
    ends = np.array([1.0 - tail_share, 1.0 - tail_share, 1.0 - tail * tail_share, tail])
    return (ends * tail_share ** np.arange(4.0))[:, None]


def half_width_of(mixture: np.ndarray, clutter: float) -> float:
    """Half-width with which outliers have the density ``clutter`` over that of the core."""
    variance, outliers, *_ = mixture
    return outliers / (1.0 - outliers) * np.sqrt(2.0 * np.pi * variance) / (2.0 * clutter)


def pose_of(R: np.ndarray, t: np.ndarray, mixture: np.ndarray) -> Pose:
    """A copy of the pose, with empty linearisation."""
    return Pose(R.copy(), t.copy(), mixture.copy(), np.full((6, 6), np.nan), np.full(1, np.nan))


def rays_only(rays0: np.ndarray, rays1: np.ndarray) -> View:
    """Rays (N, 3) with isotropic noise of one radian, without a known pose."""
    noise = sphere.tangent_basis(rays0), sphere.tangent_basis(rays1)
    return View(rays0, rays1, *noise, np.eye(3), np.array([0.0, 0.0, 1.0]))


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
    return View(rays0, rays1, noise0, noise1, R, t)


def shaken(view: View, seed: int, sigma: np.ndarray | float = 1.0) -> View:
    """The same views with the noise of their factors, times ``sigma`` (N,)."""
    rng = np.random.default_rng(seed)
    n = rng.normal(size=(2, view.size, 2)) * np.reshape(sigma, (-1, 1))
    rays0 = sphere.normalize(view.rays0 + np.einsum("nij,nj->ni", view.noise0, n[0]))
    rays1 = sphere.normalize(view.rays1 + np.einsum("nij,nj->ni", view.noise1, n[1]))
    return view._replace(rays0=rays0, rays1=rays1)


def moved(R: np.ndarray, t: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pose after ``step = [dtheta (3), dbeta (2)]``: perturbed on the left, on the sphere."""
    basis = sphere.tangent_basis(t)
    return so3.exp(step[:3]) @ R, sphere.retract(t, basis, step[3:])


def gradient(function: Callable[[np.ndarray], float], size: int, step: float) -> np.ndarray:
    """Central differences of a function of (size,) at zero, with one Richardson extrapolation."""

    def slope(h: float) -> np.ndarray:
        return np.array([(function(h * e) - function(-h * e)) / (2 * h) for e in np.eye(size)])

    return (4.0 * slope(step / 2) - slope(step)) / 3.0
