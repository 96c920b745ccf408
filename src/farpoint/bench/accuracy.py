"""Errors of an estimator against the truth, and against the Cramer-Rao bound."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from farpoint.bench.interleaved import EstimatorRun
from farpoint.bench.table import Cell, Column
from farpoint.bench.views import TwoViews
from farpoint.geometry import sphere
from farpoint.metrics import chi2_quantile, direction_error, nees, rotation_error, summarize

__all__ = [
    "ERROR_COLUMNS",
    "GROSS_DIRECTION_DEG",
    "GROSS_ROTATION_DEG",
    "REAL_COLUMNS",
    "REAL_NOTES",
    "Errors",
    "bound_ratios",
    "error_cells",
    "errors_of",
    "ratio_cells",
    "real_cells",
]

GROSS_ROTATION_DEG = 1.0
GROSS_DIRECTION_DEG = 30.0
# Least translation of a real motion for which directions are compared.
MIN_TRANSLATION_M = 0.01
# Columns of `error_cells`.
ERROR_COLUMNS = (
    Column("rotation_median_deg", 4),
    Column("rotation_mean_deg", 4),
    Column("direction_median_deg", 3),
    Column("direction_mean_deg", 3),
    Column("failed"),
    Column("no_direction"),
    Column("gross"),
)
# Columns of `real_cells`, and a note about them.
REAL_COLUMNS = (
    *ERROR_COLUMNS,
    Column("rotation_over_farpoint", 2),
    Column("rotation_over_low", 2),
    Column("rotation_over_high", 2),
)
REAL_NOTES = (
    "means are over the pairs with an estimate; gross: rotation more than 1 deg or direction "
    "more than 30 deg off",
    "rotation_over_farpoint: mean error of the peer over that of farpoint, of the pairs that "
    "both estimate; low, high: 95 % interval by bootstrap of the pairs; if high is below 1, "
    "farpoint is less accurate beyond chance",
    f"directions of true motions below {100 * MIN_TRANSLATION_M:g} cm are not compared",
)
# Bootstrap samples of the pairs for an interval, and the quantiles that bound it.
_RESAMPLES = 4000
_INTERVAL = (0.025, 0.975)


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Errors over V pairs of views; NaN where the estimate or the truth is missing.

    Attributes
    ----------
    dtheta_rad : ndarray, shape (V, 3)
        Rotation errors, ``R_true = Exp(dtheta) @ R_est``.
    rotation_deg, direction_deg : ndarray, shape (V,)
        Angles between estimate and truth, deg.
    failed : int
        Number of pairs without any estimate.
    undecided : int
        Number of pairs with an estimate of the rotation but not of the direction.
    gross : int
        Number of estimates with a rotation error above 1 deg or a direction error above 30 deg.
    """

    dtheta_rad: np.ndarray
    rotation_deg: np.ndarray
    direction_deg: np.ndarray
    failed: int
    undecided: int
    gross: int


def errors_of(
    run: EstimatorRun, views: Sequence[TwoViews], *, min_translation: float = 0.0
) -> Errors:
    """Errors against the truth; NaN for the direction of translations below `min_translation`."""
    R_true, directions_true = _truth(views, min_translation)
    dtheta = rotation_error(run.rotations, R_true)
    rotation_deg = np.degrees(np.linalg.norm(dtheta, axis=1))
    direction_deg = np.degrees(sphere.angle_between(run.directions, directions_true))
    failed = np.isnan(run.rotations[:, 0, 0])
    gross = (rotation_deg > GROSS_ROTATION_DEG) | (direction_deg > GROSS_DIRECTION_DEG)
    return Errors(
        dtheta_rad=dtheta,
        rotation_deg=rotation_deg,
        direction_deg=direction_deg,
        failed=int(np.count_nonzero(failed)),
        undecided=int(np.count_nonzero(~failed & np.isnan(run.directions[:, 0]))),
        gross=int(np.count_nonzero(gross)),
    )


def error_cells(errors: Errors) -> tuple[Cell, ...]:
    """Cells of a row of a table, in the order of `ERROR_COLUMNS`."""
    rotation, direction = summarize(errors.rotation_deg), summarize(errors.direction_deg)
    middle = rotation.median, rotation.mean, direction.median, direction.mean
    return *middle, errors.failed, errors.undecided, errors.gross


def real_cells(runs: Sequence[EstimatorRun], views: Sequence[TwoViews]) -> list[tuple[Cell, ...]]:
    """Cells of each run, in the order of `REAL_COLUMNS`; the first run must be farpoint's."""
    errors = [errors_of(run, views, min_translation=MIN_TRANSLATION_M) for run in runs]
    return [(*error_cells(each), *ratio_cells(each, errors[0])) for each in errors]


def ratio_cells(errors: Errors, reference: Errors) -> tuple[float, float, float]:
    """Mean rotation error over the mean error of a ``reference``, and 95 % interval of the ratio.

    A few pairs with large errors dominate a mean, so that two means over the same pairs may differ
    by 50 % by chance. The interval has the percentiles of a bootstrap, in which pairs are drawn
    together with the errors of both estimators (Efron, Ann. Stat. 7, 1979, DOI
    10.1214/aos/1176344552).
    """
    both = np.isfinite(errors.rotation_deg) & np.isfinite(reference.rotation_deg)
    pairs = np.stack([errors.rotation_deg[both], reference.rotation_deg[both]])
    n = pairs.shape[1]
    if n == 0:
        return math.nan, math.nan, math.nan
    drawn = np.random.default_rng(0).integers(0, n, (_RESAMPLES, n))
    low, high = np.quantile(_over(pairs[:, drawn]), _INTERVAL)
    return float(_over(pairs)), float(low), float(high)


def _over(pairs: np.ndarray) -> np.ndarray:
    """Mean of the first row divided by mean of the second row; 1 if both means are zero."""
    ours, theirs = pairs.mean(axis=-1) + 1e-300
    return ours / theirs


def bound_ratios(
    run: EstimatorRun, views: Sequence[TwoViews], bounds: np.ndarray
) -> tuple[float, float]:
    """Errors of rotation and direction divided by the Cramer-Rao bounds; the best value is 1.

    Each error is normalised by the bound of the same pair. The ratio is the median of the
    normalised errors, divided by the median of the chi distribution. A missing estimate counts as
    an infinite error.

    Parameters
    ----------
    run : EstimatorRun
    views : sequence of TwoViews, length V
    bounds : ndarray, shape (V, 5, 5)
        Bounds from `farpoint.synthetic.cramer_rao_bound`.
    """
    R_true, directions_true = _truth(views, 0.0)
    # The bound is in the tangent space of the truth, so truth and estimate are exchanged here.
    dtheta = rotation_error(R_true, run.rotations)
    bases = sphere.tangent_basis(directions_true)
    dbeta = direction_error(directions_true, bases, run.directions)
    return _ratio(dtheta, bounds[:, :3, :3]), _ratio(dbeta, bounds[:, 3:, 3:])


def _ratio(errors: np.ndarray, bounds: np.ndarray) -> float:
    squared = nees(errors, bounds)
    squared[np.isnan(squared)] = np.inf
    return float(np.sqrt(np.median(squared) / chi2_quantile(0.5, errors.shape[1])))


def _truth(views: Sequence[TwoViews], min_translation: float) -> tuple[np.ndarray, np.ndarray]:
    """True rotations (V, 3, 3) and directions (V, 3), NaN if the translation is too short."""
    translations = np.array([v.translation_cam1_from_cam0 for v in views])
    length = np.linalg.norm(translations, axis=1)
    directions = np.full_like(translations, np.nan)
    long = (length > 0.0) & (length >= min_translation)
    directions[long] = translations[long] / length[long, None]
    return np.array([v.rotation_cam1_from_cam0 for v in views]), directions
