"""The other motion that a plane allows, and whether anything off the plane tells the two apart.

Two motions move the points of a plane alike (Longuet-Higgins, Proc. R. Soc. B 223, 1984,
DOI 10.1098/rspb.1984.0088). Their likelihoods differ all the same, by chance: each leaves free
where a match lies along its own epipolar line, and so counts another part of the same noise. Over N
matches that makes a difference of about sqrt(N), which says nothing. What says something are points
off the plane, and by how much the others are nearer or farther than it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from farpoint._kernels.contest import GATE_SIGMA
from farpoint._kernels.likelihood import clutter_density, explain, refine_pose
from farpoint._kernels.twins import planar_twin
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.fits import MAX_REFINEMENTS, MIN_VARIANCE, MovingFit, refit_moving
from farpoint.pose.matches import Matches

__all__ = ["OtherMotion", "likelier_motion"]

# Log likelihood that the other motion may lack: more than the chance of 160 matches makes.
RIVAL = 40.0
FINE = 0.1
# Two directions as close as this, rad, are one minimum.
SAME_RAD = math.radians(10.0)
# Distance from the plane, in sigma, at which a match is off it.
OFF_SIGMA = 4.0
PLANE_ROUNDS = 8
# Median of the sum of the squares of two normal errors.
MEDIAN = 2.0 * math.log(2.0)


class OtherMotion(NamedTuple):
    """A second motion that explains the matches of a plane.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    direction_cam1_from_cam0 : ndarray, shape (3,)
    against : float
        By how much the log likelihood of the first motion is larger, as far as it is not chance.
    """

    R_cam1_from_cam0: np.ndarray
    direction_cam1_from_cam0: np.ndarray
    against: float


def likelier_motion(matches: Matches, fit: MovingFit) -> tuple[MovingFit, OtherMotion | None]:
    """The fit, or one to the other motion that a plane allows if that is likelier; and the rival.

    Usually there is none: no plane explains the matches nearly as well.
    """
    other = _other_motion(fit) if fit.is_planar else None
    if other is None or other.against >= 0.0:
        return fit, other
    R, t = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    start = replace(
        fit,
        R_cam1_from_cam0=other.R_cam1_from_cam0,
        direction_cam1_from_cam0=other.direction_cam1_from_cam0,
    )
    return refit_moving(matches, start), OtherMotion(R, t, -other.against)


def _other_motion(fit: MovingFit) -> OtherMotion | None:
    seen = fit.searched
    first = _Motion(fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0, fit.noise.array)
    other = _Motion(np.empty((3, 3)), np.empty(3), fit.noise.array)
    gate = GATE_SIGMA * fit.noise.sigma
    if not planar_twin(seen.pairs, len(seen), gate, first.R, first.t, other.R, other.t):
        return None
    cost = _refined(seen, _Motion(*(array.copy() for array in first)))
    if not _refined(seen, other) < cost + RIVAL:
        return None
    if first.t @ other.t > math.cos(SAME_RAD):
        return None
    return OtherMotion(other.R, other.t, _evidence(seen, fit, first, other))


class _Motion(NamedTuple):
    """As the kernels take it; refined in place."""

    R: np.ndarray
    t: np.ndarray
    mixture: np.ndarray


def _refined(matches: Matches, motion: _Motion) -> float:
    """Refine the motion in place; its cost."""
    return refine_pose(
        matches.pairs,
        matches.weights(),
        len(matches),
        matches.spread,
        MIN_VARIANCE,
        FINE,
        MAX_REFINEMENTS,
        *motion,
        np.empty((6, 6)),
    )


def _evidence(matches: Matches, fit: MovingFit, first: _Motion, other: _Motion) -> float:
    """Log likelihood of the first motion over the other, but for what chance makes of it.

    Of a match at the distance z from the plane, both in units of the noise, the part that depends
    on which line it left the plane along has the weight ``z^2 / (1 + z^2)``: nothing on the plane,
    all off it. Near it, the weight is that of a typical match, less what chance makes of that.
    """
    of_first, right = _log_likelihood(matches, first)
    of_other, _ = _log_likelihood(matches, other._replace(mixture=first.mixture))
    gain = of_first - of_other
    square = _squares_from_plane(matches, first, right > 0.5, fit.noise.variance)
    off = square > OFF_SIGMA**2
    near = (right > 0.5) & ~off
    weight = 0.0
    if near.any():
        excess = np.median(square[near]) / MEDIAN * (1.0 - 1.0 / math.sqrt(near.sum())) - 1.0
        weight = max(2.0 * excess, 0.0) / (1.0 + max(2.0 * excess, 0.0))
    return float(gain[off].sum() + weight * gain[~off].sum())


def _log_likelihood(matches: Matches, motion: _Motion) -> tuple[np.ndarray, np.ndarray]:
    """Of each match (N,), and its probability of being right."""
    variance, wrong, _ = motion.mixture
    clutter = clutter_density(variance, wrong, matches.spread)
    weights = matches.weights()
    told = np.empty((3, len(weights)))
    explain(matches.pairs, weights, *motion, clutter, *told)
    right = told[2, : len(matches)]
    return -np.log1p(-right), right


def _squares_from_plane(
    matches: Matches, motion: _Motion, right: np.ndarray, variance: float
) -> np.ndarray:
    """Squared distances (N,) of the later rays from where the plane through most would have them.

    In units of the noise, over both of its coordinates. The plane ``n . X = 1`` (camera 0, unit of
    the translation) moves a ray a to ``R a + t (n . a)``.
    """
    across = tangent_basis(matches.rays1)
    still = np.einsum("nik,ni->nk", across, matches.rays0 @ motion.R.T)
    moved = np.einsum("nik,i->nk", across, motion.t)[:, :, None] * matches.rays0[:, None, :]
    precision = matches.precision / variance
    weight = right.astype(float)
    square = np.zeros(len(matches))
    for _ in range(PLANE_ROUNDS):
        M = np.einsum("n,nki,nkj->ij", weight * precision, moved, moved)
        v = np.einsum("n,nki,nk->i", weight * precision, moved, still)
        n = -np.linalg.solve(M + (1e-9 * np.trace(M) + 1e-300) * np.eye(3), v)
        square = precision * np.sum((still + moved @ n) ** 2, axis=1)
        typical = max(float(np.median(square[right])) / MEDIAN, 1.0) if right.any() else 1.0
        weight = right / (1.0 + square / (9.0 * typical)) ** 2
    return square
