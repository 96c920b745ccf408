"""Direction of translation from pairwise intersections of derotated flow.

The method is that of Burschka and Mair (2008), eqs. 14-17.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint._kernels.direction import pairwise_direction
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.constants import EPIPOLE_ROUNDING_RAD
from farpoint.pose.matches import Matches

__all__ = ["EpipoleEstimate", "mean_epipole"]


@dataclass(frozen=True, kw_only=True, eq=False)
class EpipoleEstimate:
    """Direction of translation: the weighted mean of the pairwise intersections.

    Attributes
    ----------
    direction_cam1_from_cam0 : ndarray, shape (3,)
        Unit vector towards which near points flow.
    basis : ndarray, shape (3, 2)
        Tangent basis at the direction.
    covariance : ndarray, shape (2, 2)
        Covariance of the direction in ``basis``, rad^2. The covariance is estimated by the
        jackknife over matches, because all intersections with one match share the error of that
        match.
    """

    direction_cam1_from_cam0: np.ndarray
    basis: np.ndarray
    covariance: np.ndarray


def mean_epipole(
    matches: Matches, R_cam1_from_cam0: np.ndarray, saturation: float, supports: np.ndarray
) -> EpipoleEstimate | None:
    """Weighted mean of the intersections of all pairs of great circles, with signs.

    A derotated match moves along a great circle. Eqs. 14-17 intersect lines in the image; here
    great circles are intersected on the sphere, where an epipole at 90 degrees from the optical
    axis or behind the camera is no special case. The cross product of two normals weighs the
    intersection of two great circles by the sine of the angle between the circles.

    Parameters
    ----------
    matches : Matches
    R_cam1_from_cam0 : ndarray, shape (3, 3)
        Rotation that is removed from the flow.
    saturation : float
        Flow length L in the unit of the noise, px or ``noise_rad``. A match with flow of length l
        has the weight ``min(l / L, 1)``.
    supports : ndarray of bool, shape (N,)
        Matches to use.

    Returns
    -------
    EpipoleEstimate or None
        None if fewer than three matches have flow, or if all flow is along one great circle.
    """
    rays0, rays1 = matches.rays0, matches.rays1
    flow = np.linalg.norm(rays1 - rays0 @ R_cam1_from_cam0.T, axis=1)
    length = flow * np.sqrt(2.0 * matches.precision)
    weight = np.where(supports, np.minimum(length / saturation, 1.0), 0.0)
    used = np.flatnonzero(weight)
    if len(used) < 3:
        return None
    partial = np.empty((len(matches), 3))
    pairwise_direction(matches.pairs, weight, R_cam1_from_cam0, partial)
    total = 0.5 * partial.sum(axis=0)
    norm = np.linalg.norm(total)
    if not norm > 1e-12:
        return None
    direction = total / norm
    basis = tangent_basis(direction)
    n = len(used)
    others = total - partial[used]
    along = others @ direction
    if not (along > 1e-9 * norm).all():
        return None  # without one of the matches, the sign of the mean changes
    left_out = others @ basis / along[:, None]
    deviation = left_out - left_out.mean(axis=0)
    # The rounding variance bounds the covariance from below if all intersections coincide.
    covariance = (n - 1) / n * deviation.T @ deviation + EPIPOLE_ROUNDING_RAD**2 * np.eye(2)
    return EpipoleEstimate(direction_cam1_from_cam0=direction, basis=basis, covariance=covariance)
