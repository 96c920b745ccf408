"""The result of an estimate: status, numbers with covariances, and a label for every match."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry.so3 import skew
from farpoint.geometry.sphere import confidence_ring
from farpoint.pose.gtsam_factors import between_factor, essential_matrix_constraint
from farpoint.pose.html_repr import html_table, pose_rows
from farpoint.pose.metric import PoseOrder, pose_covariance_in, twist_covariance

__all__ = ["PoseStats", "PoseStatus", "RelativePose", "TrackLabel"]


class PoseStatus(Enum):
    """Which quantities of a motion are observable. Files contain the values, such as ``OK``."""

    OK = "OK"
    """Rotation and direction of translation, both with covariance."""
    ROTATION_ONLY = "ROTATION_ONLY"
    """The rotation is valid; the direction of translation is not observable."""
    STATIC = "STATIC"
    """No motion beyond the noise; the rotation (near identity) is valid."""
    FAILED = "FAILED"
    """No rotation can be trusted."""


class TrackLabel(IntEnum):
    """Label of a match."""

    OUTLIER = 0
    """The match contradicts the motion: a mismatch or a moving object."""
    FAR = 1
    """The point moves by the rotation alone, within the noise."""
    NEAR = 2
    """The point shows translation: the parallax of the point exceeds the noise."""


@dataclass(frozen=True, kw_only=True)
class PoseStats:
    """Diagnostics of an estimate.

    Attributes
    ----------
    matches, far, near, outliers : int
        Number of given matches, and number of matches with each label.
    iterations : int
        Number of samples drawn by the search.
    cost : float or None
        Mean negative log likelihood of a match at the estimate; None if no motion was fitted.
    sign_probability : float or None
        Probability of the direction as compared with the opposite direction; None without a
        direction.
    sharing : float
        Design effect: factor by which the covariance is multiplied because residuals of
        neighbouring matches are correlated; 1 for independent residuals.
    half_ratio : float or None
        Split-half ratio: squared difference between the poses from two halves of the matches,
        divided by the value that the covariances predict. None without splits
        (`RelativePoseOptions.half_splits`).
    residual_correlation : float or None
        Correlation of the residuals of neighbouring matches; 0 for independent errors. None without
        a refinement.
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
    sharing: float
    half_ratio: float | None
    residual_correlation: float | None = None
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
        Which of the quantities below are observable.
    reason : str
        Explanation of the status in one or two sentences for a human reader.
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
        Estimated 1-sigma noise of a match per coordinate of each image, pixels. For an estimate
        from rays, the noise is given as a multiple of ``noise_rad``.
    stats : PoseStats
        Diagnostics.
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
        """Direction of travel in the axes of camera 0, unit vector, shape (3,).

        The heading is ``-R.T @ direction``, and the pixel of the heading is the epipole. None
        unless status is OK.
        """
        if self.rotation_cam1_from_cam0 is None or self.direction_cam1_from_cam0 is None:
            return None
        return -self.rotation_cam1_from_cam0.T @ self.direction_cam1_from_cam0

    @property
    def heading_covariance(self) -> np.ndarray | None:
        """Covariance of `heading_cam0`, shape (3, 3), rad^2; None unless status is OK.

        The rank is 2: the variance along the heading is zero. To first order
        ``dheading = -R.T @ ([direction]x @ dtheta + direction_basis @ dbeta)``.
        """
        R, t, B = self.rotation_cam1_from_cam0, self.direction_cam1_from_cam0, self.direction_basis
        if R is None or t is None or B is None or self.covariance is None:
            return None
        jacobian = -R.T @ np.hstack([skew(t), B])
        return jacobian @ self.covariance @ jacobian.T

    def heading_region(self, confidence: float = 0.95) -> np.ndarray | None:
        """Boundary, on the sphere, of the region that contains the true heading.

        Parameters
        ----------
        confidence : float
            Probability that the region contains the true heading, between 0 and 1.

        Returns
        -------
        ndarray, shape (K, 3), or None
            Unit rays in camera 0 along a closed curve: the last ray equals the first. None unless
            status is OK.
        """
        if not 0.0 < confidence < 1.0:
            raise InputError(
                f"expected a probability between 0 and 1, got {confidence}", field="confidence"
            )
        heading, covariance = self.heading_cam0, self.heading_covariance
        if heading is None or covariance is None:
            return None
        return confidence_ring(heading, covariance, confidence)

    def epipole_ellipse_px(self, camera: Camera, confidence: float = 0.95) -> np.ndarray | None:
        """Boundary, in image 0, of the region that contains the epipole.

        The boundary is the projection of `heading_region`: an ellipse if the region is small and
        the lens has no distortion. If only the direction opposite to the heading is in view, as for
        a pinhole camera that travels backwards, the region surrounds that opposite direction.

        Parameters
        ----------
        camera : Camera
            Camera of image 0.
        confidence : float
            Probability that the region contains the epipole, between 0 and 1.

        Returns
        -------
        ndarray, shape (K, 2), or None
            Pixels along a closed curve: the last pixel equals the first. NaN where the lens does
            not see the boundary. None unless status is OK.
        """
        ring, heading = self.heading_region(confidence), self.heading_cam0
        if ring is None or heading is None:
            return None
        ahead, behind = np.isfinite(camera.project(np.stack([heading, -heading])))[:, 0]
        return camera.project(-ring if behind and not ahead else ring)

    def pose_covariance(
        self, scale: float, scale_sigma: float, order: PoseOrder | str = PoseOrder.ROS
    ) -> np.ndarray | None:
        """Covariance of the metric motion, given the length of the translation.

        Parameters
        ----------
        scale, scale_sigma : float
            Length of the translation and its 1-sigma, from another sensor, in m or any other unit
            of length. The error of the length is taken as independent of the errors of this motion.
            A sigma of 0 gives a covariance of rank 5.
        order : PoseOrder or str
            ``"ros"``: ``[translation, rotation]`` of the pose of camera 1 in camera 0.
            ``"colmap"``: ``[rotation, translation]`` of ``cam1_from_cam0``. See `PoseOrder` for
            the axes and the side of the perturbation.

        Returns
        -------
        ndarray, shape (6, 6), or None
            Covariance: rotation in rad^2, translation in the squared unit of ``scale``, and the
            cross-covariance in rad times the unit of ``scale``. None unless status is OK.

        Raises
        ------
        InputError
            If the scale is not positive, its sigma negative, or the order unknown.
        """
        if order not in list(PoseOrder):
            raise InputError(f"expected 'ros' or 'colmap', got {order!r}", field="order")
        R, d, B = self.rotation_cam1_from_cam0, self.direction_cam1_from_cam0, self.direction_basis
        if R is None or d is None or B is None or self.covariance is None:
            return None
        twist = twist_covariance(d, B, self.covariance, scale, scale_sigma)
        return pose_covariance_in(PoseOrder(order), R, twist)

    def to_gtsam_factor(
        self, key0: int, key1: int, *, scale: float | None = None, scale_sigma: float = 0.0
    ) -> Any:
        """GTSAM factor of this motion, between two variables ``world_from_cam``.

        Parameters
        ----------
        key0, key1 : int
            Keys of the ``gtsam.Pose3`` of camera 0 and camera 1.
        scale, scale_sigma : float, optional
            Length of the translation and its 1-sigma, if known.

        Returns
        -------
        gtsam.EssentialMatrixConstraint, gtsam.BetweenFactorPose3 or None
            Without a scale, an EssentialMatrixConstraint: rotation and direction, 5 degrees of
            freedom. With a scale, a BetweenFactorPose3: 6 degrees of freedom. None unless status is
            OK.

        Raises
        ------
        MissingExtraError
            If gtsam is not installed.
        InputError
            If a scale is given, and the scale or its sigma is not positive.
        """
        R, d, B = self.rotation_cam1_from_cam0, self.direction_cam1_from_cam0, self.direction_basis
        if R is None or d is None or B is None or self.covariance is None:
            return None
        if scale is None:
            return essential_matrix_constraint(key0, key1, R, d, B, self.covariance)
        twist = twist_covariance(d, B, self.covariance, scale, scale_sigma)
        return between_factor(key0, key1, R, scale * d, twist)

    def _repr_html_(self) -> str:
        """Table for notebooks: status, reason, and the numbers with their 1-sigma."""
        return html_table(f"RelativePose: {self.status.value}", pose_rows(self))
