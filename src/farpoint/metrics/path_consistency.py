"""Errors of a path against its covariances.

Errors of a path add up from pose to pose, so all poses of a segment together have hardly more
information than one pose. All figures are therefore means over segments, and each segment counts as
one sample.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from farpoint.geometry import so3
from farpoint.metrics.statistics import Consistency, chi2_quantile, consistency

__all__ = ["PathConsistency", "PathFigure", "PathSamples", "evaluate_path"]

# Smallest eigenvalue of a correlation matrix at which a covariance counts as singular: a pose that
# the gauge fixes has no error, and is not compared.
_SINGULAR = 1e-9
_LEAST_RELATIVE_SIGMA = 1e-50


@dataclass(frozen=True, kw_only=True, eq=False)
class PathSamples:
    """A path with its covariances and the truth; each frame has one row.

    Attributes
    ----------
    segments : ndarray of int, shape (N,)
        Number of the segment of each frame, never decreasing. A segment is a part of the path with
        one scale.
    world_from_cam : ndarray, shape (N, 4, 4)
        Estimated poses.
    covariances : ndarray, shape (N, 7, 7)
        Covariances of ``[dtheta, dposition, dlog_scale]`` since the beginning of the segment, in
        world axes; NaN for a frame without a covariance.
    truth : ndarray, shape (N, 4, 4)
        True poses in any world; NaN if unknown.
    lengths, length_sigmas : ndarray, shape (N,)
        Lengths of the motions that end at the frames, and the 1-sigmas of these lengths; NaN for a
        frame without a length.
    length_from : ndarray of int, shape (N,)
        Rows at which the motions of ``lengths`` begin.
    own_covariances : ndarray, shape (N, 7, 7), or None
        The part of each covariance that belongs to one pose only and that later poses do not
        inherit; None if unknown.
    """

    segments: np.ndarray
    world_from_cam: np.ndarray
    covariances: np.ndarray
    truth: np.ndarray
    lengths: np.ndarray
    length_sigmas: np.ndarray
    length_from: np.ndarray
    own_covariances: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True)
class PathFigure:
    """Errors of the poses of a path against their covariances.

    Attributes
    ----------
    dof : int
        Degrees of freedom of each error, and also the mean NEES of honest covariances.
    poses, segments : int
        Number of poses and of segments.
    mean_nees : float
        NEES averaged over the poses of each segment, and then over the segments.
    end_nees : float
        NEES of the last pose of each segment, averaged over the segments.
    nees_low, nees_high : float
        95 % interval of ``end_nees`` for honest covariances, from chi-square with ``dof`` degrees
        of freedom for each segment. The interval is conservative for ``mean_nees``.
    """

    dof: int
    poses: int
    segments: int
    mean_nees: float
    end_nees: float
    nees_low: float
    nees_high: float

    @property
    def kept(self) -> bool:
        """Whether ``mean_nees`` lies between ``nees_low`` and ``nees_high``."""
        return self.nees_low <= self.mean_nees <= self.nees_high


@dataclass(frozen=True, kw_only=True)
class PathConsistency:
    """Figures of `evaluate_path`.

    Attributes
    ----------
    unit_is_given : bool
        Whether the covariances include an error of the unit of length, as for a path in metres. If
        the covariances include no such error, the unit is the length of the first motion of each
        segment.
    orientation, position, pose : PathFigure
        Figures of 3, 3 and 6 degrees of freedom.
    position_any_scale : PathFigure
        Figure of 2 degrees of freedom: errors of the positions after each position is fitted with
        its best scale. Errors of the unit and of the scale therefore have no effect.
    scale : PathFigure
        Figure of 1 degree of freedom: the error of the logarithm of each motion's length, without
        the error of the unit, against the 1-sigma of this logarithm. All lengths of a segment share
        the error of the segment's scale.
    lengths : Consistency
        The errors of ``scale``, with each length as an independent sample. The lengths are not
        independent, so the bounds are too narrow.
    """

    unit_is_given: bool
    orientation: PathFigure
    position: PathFigure
    pose: PathFigure
    position_any_scale: PathFigure
    scale: PathFigure
    lengths: Consistency


def evaluate_path(samples: PathSamples) -> PathConsistency | None:
    """Compare every segment with the truth; None if nothing can be compared.

    The comparison uses the gauge of the covariances, and nothing is fitted to the truth. The first
    pose of a segment (position and orientation) and the length of the first motion are taken as
    true. If this length has an error of its own, the distance with the smallest relative error, of
    all distances from the first pose, is taken as true instead. If the covariances include an error
    of the unit of length, no length is taken as true. An error of the ground truth in the first
    pose, or in the length that is used, counts as an error of the path.
    """
    found = list(_segments(samples))
    if not found:
        return None
    errors = [segment.errors for segment in found]
    covariances = [segment.covariances for segment in found]
    return PathConsistency(
        unit_is_given=all(segment.unit_is_given for segment in found),
        orientation=_figure(3, [_nees(e, C, slice(0, 3)) for e, C in _zip(errors, covariances)]),
        position=_figure(3, [_nees(e, C, slice(3, 6)) for e, C in _zip(errors, covariances)]),
        pose=_figure(6, [_nees(e, C, slice(0, 6)) for e, C in _zip(errors, covariances)]),
        position_any_scale=_figure(
            2, [_nees_any_scale(s.ways, s.true_ways, s.covariances) for s in found]
        ),
        scale=_figure(1, [s.length_errors**2 / s.length_variances for s in found]),
        lengths=consistency(
            np.concatenate([segment.length_errors for segment in found])[:, None],
            np.concatenate([segment.length_variances for segment in found])[:, None, None],
        ),
    )


class _Segment(NamedTuple):
    """The quantities of a segment that can be compared, in its gauge: P poses and M lengths.

    ``errors`` (P, 6) and ``covariances`` (P, 6, 6) are those of ``[dtheta, dposition]``. ``ways``
    and ``true_ways`` (P, 3) are the estimated and the true displacements since the first pose.
    ``length_errors`` and ``length_variances`` (M,) are those of the logarithms of motion lengths.
    """

    unit_is_given: bool
    errors: np.ndarray
    covariances: np.ndarray
    ways: np.ndarray
    true_ways: np.ndarray
    length_errors: np.ndarray
    length_variances: np.ndarray


def _zip(errors: list[np.ndarray], covariances: list[np.ndarray]) -> Iterator[tuple]:
    return zip(errors, covariances, strict=True)


def _segments(samples: PathSamples) -> Iterator[_Segment]:
    s = samples
    for number in np.unique(s.segments):
        rows = np.flatnonzero(s.segments == number)
        # The pose at the beginning of a segment has covariance 0: it is in the first row of the
        # segment, or else in the row before.
        begins = rows[0] if not np.any(s.covariances[rows[0], :6, :6]) else max(rows[0] - 1, 0)
        segment = _segment(samples, int(begins), rows[rows > begins])
        if segment is not None:
            yield segment


def _segment(samples: PathSamples, begins: int, rows: np.ndarray) -> _Segment | None:
    s = samples
    rows = rows[~np.isnan(s.truth[rows, 0, 0]) & ~np.isnan(s.covariances[rows, 0, 0])]
    start, true_start = s.world_from_cam[begins], s.truth[begins]
    ways = s.world_from_cam[rows, :3, 3] - start[:3, 3]
    moved = np.linalg.norm(ways, axis=1) > 0.0
    if np.isnan(true_start[0, 0]) or not moved.any():
        return None
    turn = start[:3, :3] @ true_start[:3, :3].T
    true_ways = (s.truth[rows, :3, 3] - true_start[:3, 3]) @ turn.T
    unit_is_given = bool(s.covariances[rows[np.argmax(moved)], 6, 6] > 0.0)
    unit = 1.0
    if not unit_is_given:
        # The first displacement whose scale has no error, or else the displacement with the
        # smallest relative error.
        exact = moved & (s.lengths[rows] > 0.0) & (s.covariances[rows, 6, 6] == 0.0)
        best = _best_known(ways, s.covariances[rows, 3:6, 3:6])
        row = int(np.argmax(exact)) if exact.any() else best
        unit = float(np.linalg.norm(true_ways[row]) / np.linalg.norm(ways[row]))
    if not unit > 0.0:
        return None
    rotation_errors = so3.log(
        turn @ s.truth[rows, :3, :3] @ np.swapaxes(s.world_from_cam[rows, :3, :3], 1, 2)
    )
    covariances = s.covariances[rows, :6, :6]
    known = np.array([_is_regular(covariance) for covariance in covariances])
    if not known.any():
        return None
    log_errors, log_variances = _length_errors(samples, rows, unit)
    return _Segment(
        unit_is_given=unit_is_given,
        errors=np.hstack([rotation_errors, true_ways / unit - ways])[known],
        covariances=covariances[known],
        ways=ways[known],
        true_ways=true_ways[known],
        length_errors=log_errors,
        length_variances=log_variances,
    )


def _best_known(ways: np.ndarray, covariances: np.ndarray) -> int:
    """Row of the displacement (N, 3) with the smallest relative error, which gives the unit."""
    square = np.sum(ways**2, axis=1)
    variance = np.einsum("ni,nij,nj->n", ways, covariances, ways)
    # A displacement with covariance 0, as before the camera moved, gives no unit.
    stated = (square > 0.0) & covariances.any(axis=(1, 2))
    relative = np.divide(variance, square**2, out=np.full(len(ways), np.inf), where=stated)
    return int(np.argmin(relative))


def _length_errors(
    samples: PathSamples, rows: np.ndarray, unit: float
) -> tuple[np.ndarray, np.ndarray]:
    s = samples
    rows = rows[s.lengths[rows] > 0.0]
    rows = rows[s.length_sigmas[rows] > _LEAST_RELATIVE_SIGMA * s.lengths[rows]]
    steps = s.truth[rows, :3, 3] - s.truth[s.length_from[rows], :3, 3]
    true = np.linalg.norm(steps, axis=1) / unit
    # A true length of 0, or a ratio that overflows, is an infinite error, outside every region.
    with np.errstate(divide="ignore", over="ignore"):
        errors = np.log(true / s.lengths[rows])
    return errors, (s.length_sigmas[rows] / s.lengths[rows]) ** 2


def _is_regular(covariance: np.ndarray) -> bool:
    variances = np.diag(covariance)
    if not (variances > 0.0).all():
        return False
    sigma = np.sqrt(variances)
    return bool(np.linalg.eigvalsh(covariance / sigma / sigma[:, None])[0] > _SINGULAR)


def _nees(errors: np.ndarray, covariances: np.ndarray, part: slice) -> np.ndarray:
    e = errors[:, part]
    return np.sum(e * np.linalg.solve(covariances[:, part, part], e[..., None])[..., 0], axis=1)


def _nees_any_scale(ways: np.ndarray, true_ways: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Smallest NEES of ``a * true_way - way`` over all scales ``a``."""
    C = covariances[:, 3:, 3:]
    by_way = np.linalg.solve(C, ways[..., None])[..., 0]
    by_true = np.linalg.solve(C, true_ways[..., None])[..., 0]
    cross, square = np.sum(true_ways * by_way, axis=1), np.sum(true_ways * by_true, axis=1)
    moved = square > 0.0  # a true displacement of 0 is 0 at every scale
    fitted = np.divide(cross**2, square, out=np.zeros_like(cross), where=moved)
    return np.sum(ways * by_way, axis=1) - fitted


def _figure(dof: int, nees: list[np.ndarray]) -> PathFigure:
    nees = [values for values in nees if len(values)]
    if not nees:
        nan = math.nan
        return PathFigure(
            dof=dof, poses=0, segments=0, mean_nees=nan, end_nees=nan, nees_low=nan, nees_high=nan
        )
    total = dof * len(nees)
    return PathFigure(
        dof=dof,
        poses=sum(map(len, nees)),
        segments=len(nees),
        mean_nees=float(np.mean([np.mean(values) for values in nees])),
        end_nees=float(np.mean([values[-1] for values in nees])),
        nees_low=chi2_quantile(0.025, total) / len(nees),
        nees_high=chi2_quantile(0.975, total) / len(nees),
    )
