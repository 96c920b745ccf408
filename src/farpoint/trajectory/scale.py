"""The length of a motion, from points whose distances are known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from farpoint.trajectory.depths import Depths
from farpoint.trajectory.parallax import Parallax

__all__ = ["MIN_POINTS", "ScaleFit", "can_fit", "fit_scale"]

MIN_POINTS = 6
"""Fewer points of known distance say nothing of the length of a motion."""

_DOF = 5.0  # of the t distribution of deviations: matches have heavier tails than the normal
_MEDIAN = 0.455  # of chi-square with one degree of freedom
_DENIED = 10.0  # times the variance they may have: known points this far off deny a motion
_MAX_STEPS = 15
_TOLERANCE = 1e-5


@dataclass(frozen=True, kw_only=True, eq=False)
class ScaleFit:
    """The length of a motion in the unit of the trajectory.

    Attributes
    ----------
    scale : float
        Positive.
    correction : ndarray, shape (5,)
        Change of the motion, ``[dtheta, dbeta]``, rad, that the known distances ask for: within its
        covariance, and not applied to it.
    covariance : ndarray, shape (6, 6)
        Of the errors of ``[log(scale), dtheta, dbeta]``, given the distances.
    gain : float
        Share, 0 to 1, of an error of the scale that the distances take over from this motion.
    ids : ndarray of int64, shape (M,)
        Points whose distances are behind it.
    by_inverse : ndarray, shape (6, M)
        By how much ``[log(scale), dtheta, dbeta]`` would be larger had an inverse distance been
        told larger than it is.
    """

    scale: float
    correction: np.ndarray
    covariance: np.ndarray
    gain: float
    ids: np.ndarray
    by_inverse: np.ndarray

    @property
    def points(self) -> int:
        """Number of distances behind it."""
        return len(self.ids)

    @classmethod
    def unit(cls, scale: float, covariance: np.ndarray) -> ScaleFit:
        """A motion that defines the scale; ``covariance`` (5, 5) is its own."""
        return cls._without_points(scale, 0.0, covariance, gain=0.0)

    @classmethod
    def guess(cls, scale: float, sigma: float, covariance: np.ndarray) -> ScaleFit:
        """A motion whose length no point tells: ``sigma`` is of its logarithm.

        All distances to come are measured by it, so its error becomes that of the scale.
        """
        return cls._without_points(scale, sigma, covariance, gain=1.0)

    @classmethod
    def _without_points(
        cls, scale: float, sigma: float, covariance: np.ndarray, gain: float
    ) -> ScaleFit:
        joint = np.zeros((6, 6))
        joint[0, 0], joint[1:, 1:] = sigma**2, covariance
        return cls(
            scale=scale,
            correction=np.zeros(5),
            covariance=joint,
            gain=gain,
            ids=np.empty(0, np.int64),
            by_inverse=np.empty((6, 0)),
        )

    @property
    def root(self) -> np.ndarray:
        """Matrix (6, 6) that makes these errors of white ones."""
        values, axes = np.linalg.eigh(self.covariance)
        return axes * np.sqrt(np.maximum(values, 0.0))

    @property
    def is_guess(self) -> bool:
        """Whether no point, and no convention either, tells the length."""
        return self.points == 0 and self.gain == 1.0


def can_fit(depths: Depths, ids: np.ndarray) -> bool:
    """Whether enough of the tracks ``ids`` (N,) have known distances."""
    return int(np.count_nonzero(depths.carry_scale(ids))) >= MIN_POINTS


def fit_scale(depths: Depths, parallax: Parallax, covariance: np.ndarray) -> ScaleFit | None:
    """Maximum likelihood of the scale over the distances, known with errors, and the motion.

    Model: ``parallax_j = scale * inverse_j - by_motion_j @ x + noise_j`` with ``x`` of the motion's
    covariance, ``inverse_j`` of the depth's, and t-distributed deviations, so that moving things
    and slipped tracks count little. The distances are eliminated, each with its own error: taken
    as exact, they would make the scale a little smaller with every motion.

    Parameters
    ----------
    depths : Depths
        From camera 0.
    parallax : Parallax
        Of the motion.
    covariance : ndarray, shape (5, 5)
        Of the motion, ``[dtheta, dbeta]``, rad^2.

    Returns
    -------
    ScaleFit or None
        None where fewer than `MIN_POINTS` distances are known (`can_fit`), or where these deny the
        motion: the points did not move along the direction, or most lie far from where they should.
    """
    if not can_fit(depths, parallax.ids):
        return None
    parallax = parallax.select(depths.carry_scale(parallax.ids))
    inverse, variance = depths.of(parallax.ids)
    log_scale = _start(inverse, variance, parallax)
    if log_scale is None:
        return None
    prior = np.zeros((6, 6))
    prior[1:, 1:] = np.linalg.inv(covariance)
    x = np.zeros(5)
    equations = _equations(inverse, variance, parallax, log_scale, x)
    for _ in range(_MAX_STEPS):
        pull = prior @ np.concatenate([[0.0], x])
        step = -np.linalg.solve(equations.H + prior, equations.g + pull)
        log_scale += float(np.clip(step[0], -0.5, 0.5))
        x = x + step[1:]
        equations = _equations(inverse, variance, parallax, log_scale, x)
        if abs(step[0]) < _TOLERANCE:
            break
    if equations.excess > _DENIED:
        return None
    # Fisher information of the t distribution is less than the weights' sum says.
    information = (_DOF + 1.0) / (_DOF + 3.0) * equations.H + prior
    scale = math.exp(log_scale)
    return ScaleFit(
        scale=scale,
        correction=x,
        covariance=np.linalg.inv(information),
        gain=equations.gain,
        ids=parallax.ids,
        by_inverse=scale * np.linalg.solve(equations.H + prior, equations.weighted.T),
    )


class _Equations(NamedTuple):
    """Information (6, 6) and gradient (6,) by ``[log(scale), x]``, with the weighted derivatives
    (N, 6) of the deviations; the gain; and how many times larger than their variance the squares of
    the deviations typically are.
    """

    H: np.ndarray
    g: np.ndarray
    weighted: np.ndarray
    gain: float
    excess: float


def _equations(
    inverse: np.ndarray, variance: np.ndarray, parallax: Parallax, log_scale: float, x: np.ndarray
) -> _Equations:
    scale = math.exp(log_scale)
    seen, noise, D = parallax.around(scale * inverse)
    total = noise + scale**2 * variance
    off = seen + D @ x - scale * inverse
    weight = (_DOF + 1.0) / (_DOF + off**2 / total) / total
    # The most likely distances, given the scale.
    likely = inverse + off * scale * variance / total
    J = np.column_stack([-scale * likely, D])
    weighted = weight[:, None] * J
    share = weighted[:, 0] * J[:, 0]
    taken = scale**2 * variance / total
    return _Equations(
        H=J.T @ weighted,
        g=weighted.T @ off,
        weighted=weighted,
        gain=float(share @ taken / np.sum(share)),
        excess=float(np.median(off**2 / total)) / _MEDIAN,
    )


def _start(inverse: np.ndarray, variance: np.ndarray, parallax: Parallax) -> float | None:
    """Logarithm of the weighted median of the ratios; None where it is not positive."""
    seen = parallax.measured()
    noise = parallax.around(np.maximum(seen, 0.0)).variance
    ratio = seen / inverse
    order = np.argsort(ratio)
    typical = max(float(np.median(ratio)), 0.0)
    weight = np.cumsum((inverse / np.sqrt(noise + typical**2 * variance))[order])
    middle = ratio[order][np.searchsorted(weight, 0.5 * weight[-1])]
    return math.log(middle) if middle > 0.0 else None
