"""Errors of stretches of a path, in length and in rotation, compared with their covariances.

A segment is a part of a path with one scale, and a stretch is the part between two poses of one
segment. The covariance of a pose is that of its error since the beginning of the segment. The error
of a stretch is the error that is added between its two ends. Let ``x = [dtheta, rho, dlog_scale]``
be the error of a pose as a perturbation of the whole world, which moves a position ``p`` by ``dp =
dtheta x p + p dlog_scale + rho``. An error of a motion that all later poses inherit has the same
``x`` at all these poses. The covariance ``W_t`` of the sum of these errors up to pose t therefore
grows with each motion. A pose that is located independently has an additional error of its own,
with the covariance ``N_t``. The covariance of a pose is then ``C_t = W_t + N_t``. If ``N`` is not
given, ``N`` is estimated from the decrease of ``C``,

    W_t = C_t - (C_t - W_{t+1})_+

where ``(...)_+`` keeps the positive eigenvalues only. If poses without an error of their own are
rare, ``N`` and the covariances of short stretches are too small. The increments of ``W`` are taken
as independent:

    cov(x_s, x_t) = W_min(s, t) + [s = t] N_t.

If the increments are correlated, for example by a wrong lens, the covariance of a stretch is too
large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from farpoint.geometry import so3
from farpoint.metrics.path_consistency import PathSamples
from farpoint.metrics.statistics import Coverage, coverage

__all__ = ["STRETCH_SHARES", "StretchFigure", "evaluate_stretches"]

STRETCH_SHARES = (0.01, 0.05, 0.1, 0.2)
"""Lengths of the stretches, as shares of the length of the path."""

_LEVEL = 0.95
_LEAST_TURN_SIGMA = 1e-9  # rad; rounding error of rotations, added to their covariances
_ROUNDING = 1e-9  # relative rounding error of lengths


@dataclass(frozen=True, kw_only=True)
class StretchFigure:
    """Errors of all stretches of one length, compared with the covariances of these errors.

    Attributes
    ----------
    share : float
        Length of the stretches as a share of the length of the path.
    length : float
        Length of the stretches in the unit of the truth. If the true path has no length, the value
        is NaN, and ``share`` is a share of the number of poses.
    lengths : Coverage
        Coverage of the errors of the distances between the ends of the stretches by 1.96 sigma,
        after each segment is scaled.
    rotations : Coverage
        Coverage of the errors of the rotations between the ends by the 95 % ellipsoids.
    """

    share: float
    length: float
    lengths: Coverage
    rotations: Coverage


def evaluate_stretches(
    samples: PathSamples, shares: tuple[float, ...] = STRETCH_SHARES
) -> tuple[StretchFigure, ...]:
    """Compare stretches of a path with the truth.

    A stretch begins at every pose and lies within one segment.

    For a given length, a stretch ends at the first pose that is at least this length farther along
    the true path. Each segment is scaled so that the estimated and the true lengths of its
    stretches have the same sum, and the variances take this scaling into account. For honest
    covariances, 0.95 of the stretches lie within their 95 % regions on average. Stretches overlap,
    but the interval of `Coverage` assumes independent samples, so the interval is too narrow.

    Returns
    -------
    tuple of StretchFigure
        One figure for each share; empty if no pose has a true pose.
    """
    known = ~np.isnan(samples.truth[:, 0, 0]) & ~np.isnan(samples.covariances[:, 0, 0])
    rows = np.flatnonzero(known)
    if len(rows) < 2:
        return ()
    steps = np.linalg.norm(np.diff(samples.truth[rows, :3, 3], axis=0), axis=1)
    length = float(np.sum(steps)) or math.nan
    along = np.cumsum([0.0, *(steps if length > 0.0 else np.ones(len(steps)))])
    numbers = samples.segments[rows]
    parts = [
        _part(samples, rows[numbers == number], along[numbers == number])
        for number in np.unique(numbers)
    ]
    figures = []
    for share in shares:
        squares = [_squares(part, *_ends(part.along, share * along[-1])) for part in parts]
        by_length, by_turn = (np.concatenate(kind) for kind in zip(*squares, strict=True))
        figures.append(
            StretchFigure(
                share=share,
                length=share * length,
                lengths=coverage(by_length, 1, _LEVEL),
                rotations=coverage(by_turn, 3, _LEVEL),
            )
        )
    return tuple(figures)


class _Part(NamedTuple):
    """A segment of P poses: estimated poses, true poses, and covariances (P, 7, 7) of ``x``.

    ``along`` (P,) is the length of the true path up to each pose. ``carried`` is the part of the
    covariances that later poses inherit, and ``own`` is the part that belongs to one pose only.

    Estimated positions ``p`` are relative to the mean position of the segment, in units of the RMS
    distance from this mean.
    """

    along: np.ndarray
    rotations: np.ndarray
    p: np.ndarray
    true_rotations: np.ndarray
    true_p: np.ndarray
    carried: np.ndarray
    own: np.ndarray


def _part(samples: PathSamples, rows: np.ndarray, along: np.ndarray) -> _Part:
    found, truth = samples.world_from_cam[rows], samples.truth[rows]
    p = found[:, :3, 3] - np.mean(found[:, :3, 3], axis=0)
    reach = float(np.sqrt(np.mean(np.sum(p**2, axis=1)))) or 1.0
    p = p / reach
    units = np.array([1.0, 1.0, 1.0, reach, reach, reach, 1.0])
    to_world = np.tile(np.eye(7), (len(rows), 1, 1))
    to_world[:, 3:6, :3], to_world[:, 3:6, 6] = [so3.skew(place) for place in p], -p
    to_world /= units
    whole = to_world @ samples.covariances[rows] @ np.swapaxes(to_world, 1, 2)
    since = whole
    if samples.own_covariances is not None:
        own = samples.own_covariances[rows]
        since = whole - to_world @ own @ np.swapaxes(to_world, 1, 2)
    carried = _carried(since)
    return _Part(
        along, found[:, :3, :3], p, truth[:, :3, :3], truth[:, :3, 3], carried, whole - carried
    )


def _carried(covariances: np.ndarray) -> np.ndarray:
    """The part (P, 7, 7) of covariances that all later poses inherit."""
    carried = covariances.copy()
    for t in range(len(carried) - 2, -1, -1):
        values, vectors = np.linalg.eigh(carried[t] - carried[t + 1])
        carried[t] -= (vectors * np.maximum(values, 0.0)) @ vectors.T
    return carried


def _ends(along: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """First and last poses of the shortest stretches with at least this length."""
    last = np.searchsorted(along, along + length * (1.0 - _ROUNDING))
    first = np.flatnonzero(last < len(along))
    return first, np.maximum(last[first], first + 1)


def _squares(part: _Part, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared errors of lengths and of rotations, normalised by the covariances."""
    return _length_squares(part, first, last), _turn_squares(part, first, last)


def _turn_squares(part: _Part, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Normalised squares of ``dtheta_1 - dtheta_0 = R0 Log((R*0^T R*1) (R0^T R1)^T)``.

    ``R*`` are the true rotations.
    """
    between, true_between = (
        np.swapaxes(R[first], 1, 2) @ R[last] for R in (part.rotations, part.true_rotations)
    )
    rotation_errors = so3.log(true_between @ np.swapaxes(between, 1, 2))
    rotation_errors = np.einsum("nij,nj->ni", part.rotations[first], rotation_errors)
    C = (part.carried[last] - part.carried[first] + part.own[last] + part.own[first])[:, :3, :3]
    C = C + _LEAST_TURN_SIGMA**2 * np.eye(3)
    return np.sum(rotation_errors * np.linalg.solve(C, rotation_errors[..., None])[..., 0], axis=1)


def _length_squares(part: _Part, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Normalised squares of the errors ``s |p*1 - p*0| - |p1 - p0|``.

    ``p*`` are the true positions. The scale ``s`` makes the sum of these errors zero.
    """
    ways, true_ways = part.p[last] - part.p[first], part.true_p[last] - part.true_p[first]
    lengths, true_lengths = np.linalg.norm(ways, axis=1), np.linalg.norm(true_ways, axis=1)
    total, true_total = float(np.sum(lengths)), float(np.sum(true_lengths))
    if not (total > 0.0 and true_total > 0.0):  # nothing moved
        return np.empty(0)
    errors = total / true_total * true_lengths - lengths
    # Derivatives of each length by x of its two ends, and of the sum of all lengths by every x.
    axis = ways / np.maximum(lengths, 1e-300)[:, None]
    by_first, by_last = (_by_pose(part.p[row], axis) for row in (first, last))
    by_sum = np.zeros((len(part.along), 7))
    np.add.at(by_sum, last, by_last)
    np.subtract.at(by_sum, first, by_first)
    with_sum = _with_sum(part, by_sum)
    spread = part.carried + part.own
    of_length = (
        _forms(by_last, spread[last], by_last)
        + _forms(by_first, spread[first], by_first)
        - 2.0 * _forms(by_last, part.carried[first], by_first)
    )
    of_both = np.sum(by_last * with_sum[last] - by_first * with_sum[first], axis=1)
    share = true_lengths / true_total
    variances = of_length - 2.0 * share * of_both + share**2 * float(np.sum(by_sum * with_sum))
    return errors**2 / np.maximum(variances, (_ROUNDING * lengths) ** 2 + 1e-300)


def _by_pose(p: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Derivatives (K, 7) of ``axis . dp`` by ``x``."""
    return np.hstack([np.cross(p, axis), axis, np.sum(p * axis, axis=1, keepdims=True)])


def _with_sum(part: _Part, by_sum: np.ndarray) -> np.ndarray:
    """Covariances (P, 7) of each ``x_s`` with the sum over t of ``by_sum[t] . x_t``."""
    here = np.einsum("tij,tj->ti", part.carried, by_sum)
    later = np.sum(by_sum, axis=0) - np.cumsum(by_sum, axis=0)
    return (
        np.cumsum(here, axis=0)
        + np.einsum("tij,tj->ti", part.carried, later)
        + np.einsum("tij,tj->ti", part.own, by_sum)
    )


def _forms(left: np.ndarray, C: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.einsum("ni,nij,nj->n", left, C, right)
