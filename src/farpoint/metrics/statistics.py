"""Statistics of errors, and tests of their covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv, gammaincinv

from farpoint.errors import InputError

__all__ = [
    "Consistency",
    "Coverage",
    "Summary",
    "binomial_interval",
    "chi2_quantile",
    "consistency",
    "coverage",
    "nees",
    "summarize",
    "total_sigma",
]


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Figures of one kind of error, in the unit of the errors; NaN where ``count`` is 0.

    Attributes
    ----------
    count : int
        Number of errors.
    mean, median, rmse, p95, max : float
        ``p95`` is the smallest error that at least 95 % of the errors do not exceed.
    """

    count: int
    mean: float
    median: float
    rmse: float
    p95: float
    max: float

    def scaled(self, factor: float) -> Summary:
        """The same figures in another unit."""
        return Summary(
            count=self.count,
            mean=self.mean * factor,
            median=self.median * factor,
            rmse=self.rmse * factor,
            p95=self.p95 * factor,
            max=self.max * factor,
        )


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """Share of the confidence regions that contain the truth.

    Attributes
    ----------
    level : float
        Nominal probability of each region.
    inside, count : int
        Number of regions that contain the truth, and of all regions.
    low, high : float
        95 % Clopper-Pearson interval of the probability that ``inside / count`` estimates.
    """

    level: float
    inside: int
    count: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """``inside / count``; NaN without regions."""
        return self.inside / self.count if self.count else float("nan")

    @property
    def kept(self) -> bool:
        """Whether the nominal level lies within the interval."""
        return self.low <= self.level <= self.high


@dataclass(frozen=True, kw_only=True)
class Consistency:
    """Errors against their covariances.

    Attributes
    ----------
    dof : int
        Degrees of freedom of each error, and also the mean NEES of honest covariances for Gaussian
        errors.
    count : int
        Number of errors.
    mean_nees, median_nees : float
        Mean and median of the normalised estimation error squared.
    nees_low, nees_high : float
        95 % interval of ``mean_nees`` for honest covariances and independent Gaussian errors.
    coverage68, coverage95 : Coverage
        Coverage of the 68 % and 95 % ellipsoids.
    median_sigma : float
        Sharpness: median of ``sqrt(trace(covariance))``, in the unit of the errors. Of two honest
        estimators, the estimator with the smaller value is better.
    sigma_over_error : float
        Square root of the expected median NEES divided by the measured median NEES. This is the
        factor by which the sigmas are too large (above 1) or too small (below 1). A few large
        errors do not change this factor.
    """

    dof: int
    count: int
    mean_nees: float
    median_nees: float
    nees_low: float
    nees_high: float
    coverage68: Coverage
    coverage95: Coverage
    median_sigma: float
    sigma_over_error: float


def summarize(errors: np.ndarray) -> Summary:
    """`Summary` of the errors that are not NaN; infinite errors count."""
    e = np.asarray(errors, dtype=np.float64)
    e = e[~np.isnan(e)]
    if not e.size:
        nan = float("nan")
        return Summary(count=0, mean=nan, median=nan, rmse=nan, p95=nan, max=nan)
    return Summary(
        count=e.size,
        mean=float(np.mean(e)),
        median=float(np.median(e)),
        rmse=float(np.sqrt(np.mean(e**2))),
        p95=float(np.quantile(e, 0.95, method="inverted_cdf")),
        max=float(np.max(e)),
    )


def chi2_quantile(probability: float, dof: int) -> float:
    """Quantile of the chi-square distribution with ``dof`` degrees of freedom."""
    return float(2.0 * gammaincinv(0.5 * dof, probability))


def binomial_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Interval of a probability, from the number of ``successes`` in a number of ``trials``.

    The interval is that of Clopper and Pearson, Biometrika 26(4), 1934,
    doi:10.1093/biomet/26.4.404. The coverage of the interval is at least ``confidence`` for every
    number of trials. For 0 trials the interval is (0, 1).
    """
    tail = 0.5 * (1.0 - confidence)
    k, n = successes, trials
    low = float(betaincinv(k, n - k + 1, tail)) if k > 0 else 0.0
    high = float(betaincinv(k + 1, n - k, 1.0 - tail)) if k < n else 1.0
    return low, high


def nees(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Normalised estimation error squared, ``e^T C^-1 e``.

    Parameters
    ----------
    errors : ndarray, shape (N, D)
        Error vectors. NaN rows are undefined. Infinite rows lie outside every confidence region.
    covariances : ndarray, shape (N, D, D)
        Covariances of the errors; NaN for an error without a covariance.

    Returns
    -------
    ndarray, shape (N,)
        NaN if the error or the covariance is NaN; infinite if the error is infinite.

    Raises
    ------
    InputError
        If a covariance is not positive definite.
    """
    squared = np.full(len(errors), np.nan)
    known = ~np.isnan(errors).any(axis=1) & ~np.isnan(covariances).any(axis=(1, 2))
    squared[known] = np.inf
    finite = known & np.isfinite(errors).all(axis=1)
    for row in np.flatnonzero(known):
        if np.linalg.eigvalsh(covariances[row])[0] <= 0.0:
            raise InputError("expected a positive definite matrix", field=f"covariances[{row}]")
    solved = np.linalg.solve(covariances[finite], errors[finite, :, None])[..., 0]
    squared[finite] = np.sum(errors[finite] * solved, axis=1)
    return squared


def coverage(nees_values: np.ndarray, dof: int, level: float) -> Coverage:
    """`Coverage` of the ellipsoids of probability ``level``; NaN values are left out."""
    values = nees_values[~np.isnan(nees_values)]
    inside = int(np.count_nonzero(values <= chi2_quantile(level, dof)))
    low, high = binomial_interval(inside, values.size)
    return Coverage(level=level, inside=inside, count=values.size, low=low, high=high)


def consistency(errors: np.ndarray, covariances: np.ndarray) -> Consistency:
    """`Consistency` of errors (N, D) with covariances (N, D, D); undefined rows are left out."""
    values = nees(errors, covariances)
    used = ~np.isnan(values)
    dof, count = errors.shape[1], int(np.count_nonzero(used))
    figures = summarize(values)
    total = count * dof
    return Consistency(
        dof=dof,
        count=count,
        mean_nees=figures.mean,
        median_nees=figures.median,
        nees_low=chi2_quantile(0.025, total) / count if count else float("nan"),
        nees_high=chi2_quantile(0.975, total) / count if count else float("nan"),
        coverage68=coverage(values, dof, 0.68),
        coverage95=coverage(values, dof, 0.95),
        median_sigma=summarize(total_sigma(covariances[used])).median,
        sigma_over_error=_root_ratio(chi2_quantile(0.5, dof), figures.median),
    )


def total_sigma(covariances: np.ndarray) -> np.ndarray:
    """Sharpness (N,) of covariances (N, D, D): ``sqrt(trace)``, which is the expected RMS error."""
    return np.sqrt(np.trace(covariances, axis1=1, axis2=2))


def _root_ratio(expected: float, found: float) -> float:
    return float(np.sqrt(expected / found)) if found != 0.0 else float("inf")
