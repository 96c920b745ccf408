"""What an estimate is: a status, numbers with covariances, and a label for every match."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

import numpy as np

from farpoint.geometry.so3 import skew

__all__ = ["PoseStats", "PoseStatus", "RelativePose", "TrackLabel"]


class PoseStatus(Enum):
    """What could be observed; the values are the words written to files."""

    OK = "OK"
    """Rotation and direction of translation, both with covariance."""
    ROTATION_ONLY = "ROTATION_ONLY"
    """The rotation holds; the direction of translation is not observable."""
    STATIC = "STATIC"
    """No motion beyond the noise; the rotation (near identity) holds."""
    FAILED = "FAILED"
    """No rotation can be trusted."""


class TrackLabel(IntEnum):
    """What a match is to the estimate."""

    OUTLIER = 0
    """Contradicts the motion: a wrong match or a moving object."""
    FAR = 1
    """Moves by the rotation alone, within the noise."""
    NEAR = 2
    """Carries translation: its parallax stands out of the noise."""


@dataclass(frozen=True, kw_only=True)
class PoseStats:
    """How the estimate came about.

    Attributes
    ----------
    matches, far, near, outliers : int
        Number of matches given, and of each label.
    iterations : int
        Hypotheses tried by the consensus search.
    cost : float or None
        Mean negative log likelihood of a match at the estimate; None where nothing was fitted.
    sign_probability : float or None
        Probability that ``direction`` points the way it does along its line; None without one.
    search_s, refinement_s, covariance_s : float
        Time spent in each stage, seconds.
    """

    matches: int
    far: int
    near: int
    outliers: int
    iterations: int
    cost: float | None
    sign_probability: float | None
    search_s: float
    refinement_s: float
    covariance_s: float


@dataclass(frozen=True, kw_only=True, eq=False)
class RelativePose:
    """Motion between two views: ``X_cam1 = R_cam1_from_cam0 @ X_cam0 + s * direction``, s > 0.

    Perturbations are on the left and in camera 1: ``R_true = Exp(dtheta) @ R_est`` and
    ``direction_true = normalize(direction_est + direction_basis @ dbeta)``.

    Attributes
    ----------
    status : PoseStatus
        Which of the quantities below could be observed.
    reason : str
        One sentence for a person: what was seen and why this status.
    rotation_cam1_from_cam0 : ndarray, shape (3, 3), or None
        Present unless status is FAILED.
    rotation_covariance : ndarray, shape (3, 3), or None
        Covariance of ``dtheta``, rad^2; present unless status is FAILED.
    direction_cam1_from_cam0 : ndarray, shape (3,), or None
        Unit vector; present only when status is OK.
    direction_basis : ndarray, shape (3, 2), or None
        Orthonormal tangent basis at the direction; present only when status is OK.
    covariance : ndarray, shape (5, 5), or None
        Covariance of ``[dtheta (3), dbeta (2)]``, rad^2; present only when status is OK.
    labels : ndarray of uint8, shape (N,)
        A `TrackLabel` for every match; all OUTLIER when status is FAILED.
    noise_px : float or None
        Estimated 1-sigma noise of a match per coordinate of each image, pixels. With rays given
        instead of pixels it is a multiple of the ``noise_rad`` that was stated.
    stats : PoseStats
        How the estimate came about.
    """

    status: PoseStatus
    reason: str
    rotation_cam1_from_cam0: np.ndarray | None
    rotation_covariance: np.ndarray | None
    direction_cam1_from_cam0: np.ndarray | None
    direction_basis: np.ndarray | None
    covariance: np.ndarray | None
    labels: np.ndarray
    noise_px: float | None
    stats: PoseStats

    @property
    def heading_cam0(self) -> np.ndarray | None:
        """Direction of travel seen by camera 0, unit vector, shape (3,); its pixel is the epipole.

        ``-R.T @ direction``, or None unless status is OK.
        """
        if self.rotation_cam1_from_cam0 is None or self.direction_cam1_from_cam0 is None:
            return None
        return -self.rotation_cam1_from_cam0.T @ self.direction_cam1_from_cam0

    @property
    def heading_covariance(self) -> np.ndarray | None:
        """Covariance of `heading_cam0`, shape (3, 3), rad^2, of rank 2 (none along the heading).

        To first order ``dheading = -R.T @ ([direction]x @ dtheta + direction_basis @ dbeta)``.
        """
        R, t, B = self.rotation_cam1_from_cam0, self.direction_cam1_from_cam0, self.direction_basis
        if R is None or t is None or B is None or self.covariance is None:
            return None
        jacobian = -R.T @ np.hstack([skew(t), B])
        return jacobian @ self.covariance @ jacobian.T
