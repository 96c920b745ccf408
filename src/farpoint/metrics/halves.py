"""The split-half test of covariances, without truth.

The matches of a pair are split at random into two halves, and the motion is estimated from each
half. If the noise of the two halves is independent, the covariance of the difference between the
two motions is the sum of the covariances of the motions. Errors that both halves share cancel in
the difference: errors of the calibration, errors from a moving object tracked in both halves, and
errors common to neighbouring tracks. The test can therefore show that a covariance is too small,
but it cannot show that a covariance includes all errors. If neighbouring tracks stay in the same
half (`image_cells`, and parts of the image in `Odometry.split_half`), the errors common to these
tracks do not cancel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from farpoint._kernels.image_parts import split_parts
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.metrics.pairs import direction_error
from farpoint.metrics.statistics import Consistency, chi2_quantile, consistency, nees
from farpoint.pose import PoseStatus, RelativePose

__all__ = [
    "ConsistencyRatio",
    "HalvesEvaluation",
    "SplitHalf",
    "consistency_ratio",
    "evaluate_halves",
    "image_cells",
    "pose_difference",
    "split_half",
]

# Cosine of the angle between two directions, 89.4 degrees, from which on their difference counts as
# infinite. The covariance of the difference grows with the fourth power of the inverse cosine:
# beyond 1e8, rounding would make the matrix indefinite.
MIN_ALONG = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class SplitHalf:
    """Two estimates of one motion, from disjoint halves of its matches.

    Attributes
    ----------
    statuses : tuple of two PoseStatus
        Status of each half.
    difference : ndarray, shape (dof,)
        ``[dtheta, dbeta]`` from the first estimate to the second, rad. If only the rotations can be
        compared, the array has only ``dtheta``. If no quantity can be compared, the array is empty.
    covariance : ndarray, shape (dof, dof)
        Covariance of the difference, rad^2, from the covariances of both estimates.
    """

    statuses: tuple[PoseStatus, PoseStatus]
    difference: np.ndarray
    covariance: np.ndarray

    @property
    def dof(self) -> int:
        """Degrees of freedom of the difference: 5, 3 or 0."""
        return len(self.difference)

    @property
    def nees(self) -> float:
        """Normalised square of the difference; 0 where `dof` is 0."""
        if not self.dof:
            return 0.0
        return float(nees(self.difference[None], self.covariance[None])[0])


@dataclass(frozen=True, kw_only=True)
class ConsistencyRatio:
    """Sum of the normalised squares of many differences, compared with the expected sum.

    Attributes
    ----------
    count : int
        Number of differences that were compared.
    opposed : int
        Number of differences that are infinite, because the directions of the two halves differ by
        90 degrees or more. These differences are not in ``count``.
    dof : int
        Sum of the degrees of freedom of the compared differences.
    ratio : float
        Sum of the normalised squares, divided by `dof`: 1 for honest covariances, above 1 for
        covariances that are too small. NaN if nothing was compared.
    low, high : float
        95 % interval of `ratio` for honest covariances, Gaussian errors and independent
        differences.
    """

    count: int
    opposed: int
    dof: int
    ratio: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class HalvesEvaluation:
    """The split-half tests of a run.

    Attributes
    ----------
    pairs : int
        Number of frame pairs that were tested.
    compared, compared_in_rotation : int
        Number of pairs for which both halves have a direction, and of pairs that were compared in
        rotation only.
    ratio : ConsistencyRatio
        Ratio over all compared pairs.
    rotation, direction, pose : Consistency
        Comparison of the differences with their covariances, for 3, 2 and 5 degrees of freedom,
        rad. In these figures the differences take the place of the errors.
    """

    pairs: int
    compared: int
    compared_in_rotation: int
    ratio: ConsistencyRatio
    rotation: Consistency
    direction: Consistency
    pose: Consistency


def split_half(
    matches: Sequence[np.ndarray],
    estimate: Callable[..., RelativePose],
    *,
    seed: int,
    groups: np.ndarray | None = None,
) -> SplitHalf:
    """Estimate a motion from two random disjoint halves of its matches, and compare the estimates.

    Parameters
    ----------
    matches : sequence of ndarray
        Arrays with one row per match, such as ``(points0, points1)`` or ``(rays0, rays1)``,
        followed by covariances if the estimator takes them.
    estimate : callable
        Called as ``estimate(*arrays)`` with half of the rows of each array.
    seed : int
        Seed of the split; the same seed gives the same halves.
    groups : ndarray of int, shape (N,), optional
        Rows with the same number go to the same half, such as rows from one image cell
        (`image_cells`). By default every row is a group of its own.

    Raises
    ------
    InputError
        If the arrays differ in length.

    Examples
    --------
    >>> import farpoint as fp  # doctest: +SKIP
    >>> halves = [
    ...     split_half(pair, lambda p0, p1: fp.estimate_relative_pose(p0, p1, camera), seed=k)
    ...     for k, pair in enumerate(pairs)
    ... ]  # doctest: +SKIP
    >>> consistency_ratio(halves).ratio  # doctest: +SKIP
    """
    lengths = [len(rows) for rows in matches]
    if not lengths or min(lengths) != max(lengths):
        raise InputError(f"expected arrays of one length, got {lengths}", field="matches")
    if groups is not None and np.shape(groups) != (lengths[0],):
        raise InputError(f"expected shape ({lengths[0]},), got {np.shape(groups)}", field="groups")
    assigned = (
        np.arange(lengths[0]) if groups is None else np.unique(groups, return_inverse=True)[1]
    )
    # A mask keeps the order of the rows, in case the estimator depends on it.
    half = np.empty(lengths[0], np.int64)
    split_parts(assigned.ravel(), np.array([seed % 2**64], np.uint64), half)
    return pose_difference(
        estimate(*(rows[half == 0] for rows in matches)),
        estimate(*(rows[half == 1] for rows in matches)),
    )


def image_cells(points: np.ndarray, cell_px: float) -> np.ndarray:
    """Number (N,) of the square image cell, ``cell_px`` wide, that contains each point (N, 2).

    Raises
    ------
    InputError
        If the width is not positive.
    """
    if not (np.isfinite(cell_px) and cell_px > 0.0):
        raise InputError(f"expected a positive width, got {cell_px}", field="cell_px")
    cells = np.floor(np.asarray(points) / cell_px)
    return np.unique(cells, axis=0, return_inverse=True)[1].ravel()


def pose_difference(a: RelativePose, b: RelativePose) -> SplitHalf:
    """Compare two independent estimates of one motion, in the quantities that both contain.

    With ``R_true = Exp(dtheta_a) R_a = Exp(dtheta_b) R_b`` the difference of rotation ``log(R_b
    R_a^T)`` is ``dtheta_a - dtheta_b`` to first order. The direction of b is projected to the
    tangent plane of a, and the covariance of b is mapped to this plane. The covariance of the
    difference is then the sum of the two covariances.
    """
    difference, covariance = np.empty(0), np.empty((0, 0))
    if a.covariance is not None and b.covariance is not None:
        difference, covariance = _full_difference(a, b)
    elif a.rotation_covariance is not None and b.rotation_covariance is not None:
        difference = _rotation_difference(a, b)
        covariance = a.rotation_covariance + b.rotation_covariance
    return SplitHalf(statuses=(a.status, b.status), difference=difference, covariance=covariance)


def consistency_ratio(halves: Sequence[SplitHalf]) -> ConsistencyRatio:
    """`ConsistencyRatio` of many differences, except differences without degrees of freedom."""
    known = [half for half in halves if half.dof]
    compared = [half for half in known if np.isfinite(half.nees)]
    dof = sum(half.dof for half in compared)
    nan = float("nan")
    return ConsistencyRatio(
        count=len(compared),
        opposed=len(known) - len(compared),
        dof=dof,
        ratio=sum(half.nees for half in compared) / dof if dof else nan,
        low=chi2_quantile(0.025, dof) / dof if dof else nan,
        high=chi2_quantile(0.975, dof) / dof if dof else nan,
    )


def evaluate_halves(halves: Sequence[SplitHalf]) -> HalvesEvaluation:
    """Figures of the split-half tests of a run."""
    differences = np.full((len(halves), 5), np.nan)
    covariances = np.full((len(halves), 5, 5), np.nan)
    for k, half in enumerate(halves):
        differences[k, : half.dof] = half.difference
        covariances[k, : half.dof, : half.dof] = half.covariance
    known = [half.dof for half in halves]
    return HalvesEvaluation(
        pairs=len(halves),
        compared=known.count(5),
        compared_in_rotation=known.count(3),
        ratio=consistency_ratio(halves),
        rotation=consistency(differences[:, :3], covariances[:, :3, :3]),
        direction=consistency(differences[:, 3:], covariances[:, 3:, 3:]),
        pose=consistency(differences, covariances),
    )


def _rotation_difference(a: RelativePose, b: RelativePose) -> np.ndarray:
    assert a.rotation_cam1_from_cam0 is not None
    assert b.rotation_cam1_from_cam0 is not None
    return so3.log(b.rotation_cam1_from_cam0 @ a.rotation_cam1_from_cam0.T)


def _full_difference(a: RelativePose, b: RelativePose) -> tuple[np.ndarray, np.ndarray]:
    direction_a, basis_a, covariance_a = _direction_of(a)
    direction_b, basis_b, covariance_b = _direction_of(b)
    dbeta = direction_error(direction_a[None], basis_a[None], direction_b[None])[0]
    along = float(direction_a @ direction_b)
    if along <= MIN_ALONG:
        # An infinite difference, so that the covariance has no effect.
        apart = np.concatenate([_rotation_difference(a, b), [np.inf, np.inf]])
        return apart, covariance_a + covariance_b
    # projection @ basis_b: Jacobian of the central projection on the tangent plane of a, with
    # respect to the dbeta of b.
    projection = (basis_a.T - np.outer(dbeta, direction_a)) / along
    carry = np.eye(5)
    carry[3:, 3:] = projection @ basis_b
    difference = np.concatenate([_rotation_difference(a, b), dbeta])
    return difference, covariance_a + carry @ covariance_b @ carry.T


def _direction_of(pose: RelativePose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    assert pose.direction_cam1_from_cam0 is not None
    assert pose.direction_basis is not None
    assert pose.covariance is not None
    return pose.direction_cam1_from_cam0, pose.direction_basis, pose.covariance
