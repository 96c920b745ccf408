"""Robust smoothing of the metric scale from readings with outliers."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from scipy.linalg import solveh_banded

from farpoint.aiding.readings import Reading

__all__ = ["Contradiction", "MetricFit", "fit_readings"]

_DOF = 3.0  # degrees of freedom of Student's t distribution of readings
_ROUNDS = 40  # largest number of reweighted solutions
_TOLERANCE = 1e-7  # largest change of a log scale in the last reweighted solution
_CONTRADICTS = 3.0  # residual, in sigma, above which a reading is excluded
_EXCLUDED_FACTOR = 1e6  # factor on the variance of an excluded reading: the weight must not be 0
_EXCLUSIONS = 4  # largest number of solutions with different excluded readings
_LEAST_DRIFT = 1e-8  # lower bound of variances that are inverted


@dataclass(frozen=True, kw_only=True)
class Contradiction:
    """Consecutive readings of one kind that are excluded, all too large or all too small.

    Attributes
    ----------
    kind : str
        Kind of aiding measurement.
    start_s, end_s : float
        Start of the first reading and end of the last reading, s.
    readings : int
        Number of readings.
    ratio : float
        Median ratio of the readings (metres per unit) to the fit. The ratio is 1.3 for measured
        lengths that are 30 % too large.
    """

    kind: str
    start_s: float
    end_s: float
    readings: int
    ratio: float

    def __str__(self) -> str:
        return (
            f"{self.kind}: from {self.start_s:.1f} s to {self.end_s:.1f} s, lengths are "
            f"{self.ratio:.2f} times those of all other measurements"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class MetricFit:
    """Scale over time: metres per unit of the trajectory.

    Attributes
    ----------
    times_s : ndarray, shape (N,)
        Times of the readings, ascending, s.
    segments : ndarray of int64, shape (N,)
        Segment of the trajectory, for each reading.
    log_metres : ndarray, shape (N,)
        Logarithm of metres per unit, at each reading.
    sigma : ndarray, shape (N,)
        1-sigma of ``log_metres``.
    contradictions : tuple of Contradiction
        Readings that were excluded from the fit.
    """

    times_s: np.ndarray
    segments: np.ndarray
    log_metres: np.ndarray
    sigma: np.ndarray
    contradictions: tuple[Contradiction, ...]

    def at(self, time_s: float, segment: int) -> tuple[float, float]:
        """Metres per unit at a time in a segment, and the 1-sigma of the logarithm of this number.

        For a segment without readings, the result is a guess: the scale at the last reading of the
        earlier segments, or at the first reading if no earlier segment has readings.
        """
        inside = np.flatnonzero(self.segments == segment)
        if not len(inside):
            earlier = np.flatnonzero(self.segments < segment)
            nearest = int(earlier[-1]) if len(earlier) else 0
            return float(np.exp(self.log_metres[nearest])), float(self.sigma[nearest])
        times = self.times_s[inside]
        log_metres = np.interp(time_s, times, self.log_metres[inside])
        return float(np.exp(log_metres)), float(np.interp(time_s, times, self.sigma[inside]))


def fit_readings(readings: list[Reading]) -> MetricFit:
    """Maximum-likelihood scale over time.

    The logarithm of metres per unit is modelled as a random walk from reading to reading. The
    variance of a step of the random walk is the increase of `Reading.drift`. A reading has two
    errors: an independent error with Student's t distribution of 3 degrees of freedom, and a
    normally distributed error that all readings of the same kind share. The iteration starts from
    the weighted median of the readings of each segment. Readings with a residual above 3 sigma are
    then excluded and the scale is fitted again, because outliers on one side would bias the scale.

    Parameters
    ----------
    readings : list of Reading
        One or more readings.
    """
    readings = sorted(readings, key=lambda reading: (reading.segment, reading.end_s))
    z = np.array([reading.log_ratio for reading in readings])
    variance = np.array([reading.sigma**2 for reading in readings])
    kinds = sorted({reading.kind for reading in readings})
    kind = np.array([kinds.index(reading.kind) for reading in readings])
    shared = np.array(
        [max(r.shared_sigma for r in readings if r.kind == name) ** 2 for name in kinds]
    )
    walk = _walk_precision(readings)
    x, common = _medians(z, variance, readings), np.zeros(len(kinds))
    residuals, fit_variance, excluded = z, z, np.zeros(len(z), bool)
    for _ in range(_EXCLUSIONS):
        weighted = np.where(excluded, _EXCLUDED_FACTOR, 1.0) * variance
        x, common, fit_variance = _reweighted(z, weighted, kind, shared, walk, x, common)
        residuals = z - x - common[kind]
        before, excluded = excluded, residuals**2 > _CONTRADICTS**2 * (variance + fit_variance)
        if (excluded == before).all():
            break
    return MetricFit(
        times_s=np.array([0.5 * (reading.start_s + reading.end_s) for reading in readings]),
        segments=np.array([reading.segment for reading in readings], np.int64),
        log_metres=x,
        sigma=np.sqrt(fit_variance),
        contradictions=_contradictions(readings, residuals, excluded),
    )


def _reweighted(
    z: np.ndarray,
    variance: np.ndarray,
    kind: np.ndarray,
    shared: np.ndarray,
    walk: np.ndarray,
    x: np.ndarray,
    common: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Iteratively reweighted least squares: `_solve` with Student's t weights of the residuals."""
    fit_variance = np.zeros(len(z))
    for _ in range(_ROUNDS):
        residuals = z - x - common[kind]
        weight = (_DOF + 1.0) / (_DOF + residuals**2 / variance) / variance
        before, (x, common, fit_variance) = x, _solve(z, weight, kind, shared, walk)
        if np.abs(x - before).max() < _TOLERANCE:
            break
    return x, common, fit_variance


def _walk_precision(readings: list[Reading]) -> np.ndarray:
    """Inverse variance (N - 1,) of the change of log scale between readings; 0 across segments."""
    return np.array(
        [
            1.0 / max(after.drift - before.drift, _LEAST_DRIFT)
            if after.segment == before.segment
            else 0.0
            for before, after in pairwise(readings)
        ]
    )


def _medians(z: np.ndarray, variance: np.ndarray, readings: list[Reading]) -> np.ndarray:
    """For each reading, the weighted median of the readings in the same segment."""
    segments = np.array([reading.segment for reading in readings])
    found = np.empty(len(z))
    for segment in np.unique(segments):
        inside = segments == segment
        order = np.argsort(z[inside])
        weight = np.cumsum((1.0 / np.sqrt(variance[inside]))[order])
        found[inside] = z[inside][order][np.searchsorted(weight, 0.5 * weight[-1])]
    return found


def _solve(
    z: np.ndarray, weight: np.ndarray, kind: np.ndarray, shared: np.ndarray, walk: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log scale (N,), shared error of each kind (K,), and variance of the log scale (N,).

    The variance includes the uncertainty of the shared errors.
    """
    banded = np.zeros((2, len(z)))
    banded[1] = weight
    banded[1, :-1] += walk
    banded[1, 1:] += walk
    banded[0, 1:] = -walk
    B = weight[:, None] * (kind[:, None] == np.arange(len(shared)))
    right = np.column_stack([weight * z, B])
    alone = solveh_banded(banded, right) if len(z) > 1 else right / weight[:, None]
    # The log scales are eliminated from the equations of the shared errors (Schur complement S).
    S = np.diag(B.sum(axis=0) + 1.0 / np.maximum(shared, _LEAST_DRIFT)) - B.T @ alone[:, 1:]
    covariance = np.linalg.inv(S)
    common = covariance @ (B.T @ (z - alone[:, 0]))
    x = alone[:, 0] - alone[:, 1:] @ common
    through = np.einsum("nk,kl,nl->n", alone[:, 1:], covariance, alone[:, 1:])
    return x, common, _diagonal_of_inverse(banded) + through


def _diagonal_of_inverse(banded: np.ndarray) -> np.ndarray:
    """Diagonal of the inverse of a tridiagonal positive definite matrix.

    The matrix is eliminated from both ends, and the two pivots of each row are combined.
    """
    aside, main = banded[0, 1:] ** 2, banded[1]
    down, up = main.copy(), main.copy()
    for k in range(1, len(main)):
        down[k] -= aside[k - 1] / down[k - 1]
        up[-1 - k] -= aside[-k] / up[-k]
    return 1.0 / (down + up - main)


def _contradictions(
    readings: list[Reading], residuals: np.ndarray, excluded: np.ndarray
) -> tuple[Contradiction, ...]:
    found = []
    for name in sorted({reading.kind for reading in readings}):
        rows = [k for k, reading in enumerate(readings) if reading.kind == name]
        sign = np.sign(residuals) * excluded
        for value, group in groupby(rows, key=lambda k: sign[k]):
            run = list(group)
            if value:
                found.append(
                    Contradiction(
                        kind=name,
                        start_s=readings[run[0]].start_s,
                        end_s=readings[run[-1]].end_s,
                        readings=len(run),
                        ratio=float(np.exp(np.median(residuals[run]))),
                    )
                )
    return tuple(sorted(found, key=lambda one: one.start_s))
