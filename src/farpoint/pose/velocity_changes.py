"""Changes of the velocity between two views, estimated from the rows of a rolling shutter.

The estimate is the maximum of the posterior. In the covariance of the motion, however, the changes
count as unknown, with the 1-sigmas of their prior. A change of the angular velocity and a
translation displace the matches alike, and the information of the matches on the difference
between both is too large. Without the prior, the covariances of simulated walks are too small
(tests/test_velocities.py).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.constants import POSE_PARAMETERS, VELOCITY_CHANGES
from farpoint._kernels.velocity_changes import sum_by_changes
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose.general_motion import GeneralMotionFit, linearisation_point
from farpoint.pose.shutter import Shutter, VelocityPrior

__all__ = ["VelocityChanges"]

_MOTION, _CHANGES = slice(POSE_PARAMETERS), slice(POSE_PARAMETERS, None)


class VelocityChanges(NamedTuple):
    """Normal equations of the changes of the velocity, in units of the 1-sigmas of their prior.

    At the motion, the derivative of the likelihood by the motion is zero, and the motion is
    eliminated by a Schur complement.

    Attributes
    ----------
    shutter : Shutter
        The shutter with which the rows were corrected.
    sigmas : ndarray, shape (6,)
        1-sigmas of the prior.
    information : ndarray, shape (6, 6)
        Information of the matches on the changes.
    slope : ndarray, shape (6,)
        Derivative of the negative log likelihood by the changes.
    motion_by_change : ndarray, shape (5, 6)
        Derivative of the motion ``[dtheta, dbeta]`` by the changes.
    basis : ndarray, shape (3, 2)
        Tangent basis of ``dbeta``, in the axes of camera 1.
    """

    shutter: Shutter
    sigmas: np.ndarray
    information: np.ndarray
    slope: np.ndarray
    motion_by_change: np.ndarray
    basis: np.ndarray

    @classmethod
    def of(cls, shutter: Shutter, prior: VelocityPrior, fit: GeneralMotionFit) -> VelocityChanges:
        """The equations at a motion that was fitted after correction of the rows."""
        size, matches, sigmas = POSE_PARAMETERS + VELOCITY_CHANGES, fit.matches, prior.sigmas
        H, g = np.empty((size, size)), np.empty(size)
        per_match = matches.pairs, fit.per_match[0]
        point = linearisation_point(fit, matches.outlier_half_width, *per_match)
        phases = shutter.phase0[matches.index], shutter.phase1[matches.index]
        sum_by_changes(point, fit.probability, *phases, shutter.share, H, g)
        H = np.tril(H) + np.tril(H, -1).T
        by_change = -np.linalg.pinv(H[_MOTION, _MOTION], hermitian=True) @ H[_MOTION, _CHANGES]
        information = H[_CHANGES, _CHANGES] + H[_CHANGES, _MOTION] @ by_change
        return cls(
            shutter,
            sigmas,
            np.outer(sigmas, sigmas) * information,
            sigmas * g[_CHANGES],
            by_change * sigmas,
            tangent_basis(fit.direction_cam1_from_cam0),
        )

    def step(self, tempering: float) -> tuple[Shutter, float]:
        """The shutter after a Gauss-Newton step of the changes, and the length of the step.

        The length is in sigmas of the posterior. The information of the matches is divided by
        ``tempering``, because the errors of neighbouring matches are correlated.
        """
        changes, sigmas = self.shutter.changes, self.sigmas
        z = np.divide(changes, sigmas, out=np.zeros(VELOCITY_CHANGES), where=sigmas > 0.0)
        posterior = self.information / tempering + np.eye(VELOCITY_CHANGES)
        slope = self.slope / tempering + z
        step = np.linalg.solve(posterior, slope)
        length = math.sqrt(max(float(slope @ step), 0.0))
        return self.shutter._replace(changes=changes - sigmas * step), length

    def covariance(self, basis: np.ndarray | None) -> np.ndarray:
        """Covariance (5, 5) of the motion, rad^2, due to the prior uncertainty of the changes.

        ``dbeta`` is in the tangent ``basis`` (3, 2) of a motion. For None, which is a motion
        without a direction, the covariance is that of the fitted motion.
        """
        by_change = self.motion_by_change
        if basis is not None:
            by_change = np.vstack([by_change[:3], basis.T @ self.basis @ by_change[3:]])
        return by_change @ by_change.T
