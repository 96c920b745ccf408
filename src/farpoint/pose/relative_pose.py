"""Public functions: the motion between two views, from pixels or from rays."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera
from farpoint.pose.matches import matches_from_rays
from farpoint.pose.options import DEFAULTS, RelativePoseOptions
from farpoint.pose.result import RelativePose
from farpoint.pose.two_views import estimate
from farpoint.pose.views import Views, estimate_views

__all__ = ["estimate_relative_pose", "estimate_relative_pose_from_rays"]


def estimate_relative_pose(
    points0: np.ndarray,
    points1: np.ndarray,
    camera0: Camera,
    camera1: Camera | None = None,
    *,
    options: RelativePoseOptions | None = None,
    seed: int = 0,
    covariance0_px2: np.ndarray | None = None,
    covariance1_px2: np.ndarray | None = None,
    readout_s: float | None = None,
    interval_s: float | None = None,
) -> RelativePose:
    """Motion between two views of calibrated cameras, with its covariance.

    Parameters
    ----------
    points0, points1 : ndarray, shape (N, 2)
        Matching pixels in image 0 and image 1; the centre of the top-left pixel is (0, 0).
    camera0 : Camera
        Camera of image 0, and of image 1 unless ``camera1`` is given. The uncertainty of a camera
        (`Camera.with_uncertainty`) widens the covariance.
    camera1 : Camera, optional
        Camera of image 1.
    options : RelativePoseOptions, optional
        The defaults suit tracks of a video as well as matches of two photographs.
    seed : int
        Seed of the random samples; the same inputs, options and seed give the same result, bit for
        bit.
    covariance0_px2, covariance1_px2 : ndarray, shape (N, 2, 2), optional
        Covariance of the noise of each point, px^2. A factor common to all covariances is
        estimated, so only their ratios matter. If the covariances of only one image are given, the
        noise of the other image is isotropic with the median of the given variances.
    readout_s : float, optional
        Read-out time of a rolling shutter from the first to the last row, s; negative if the last
        row is read first. The read-out time is taken as equal for both images, and the velocities
        of the camera as constant between the two views. The result is the motion between the times
        at which the middle rows are read. Default: the read-out time of ``camera0``, if
        ``interval_s`` is given; the 1-sigma of this default widens the covariance.
    interval_s : float, optional
        Time between the two views, s.

    Returns
    -------
    RelativePose
        Too few or contradicting matches raise no error. ``status`` shows which quantities are
        observable.

    Raises
    ------
    ValueError
        Wrong shapes, unequal counts, NaN or infinite values, a read-out time without an interval or
        longer than the interval. The message names the argument.

    Notes
    -----
    The estimate of Burschka and Mair, "Direct Pose Estimation with a Monocular Camera", Robot
    Vision 2008, LNCS 4931, is refined to the maximum likelihood.

    Examples
    --------
    >>> import numpy as np
    >>> from farpoint import Camera, estimate_relative_pose
    >>> camera = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)
    >>> estimate_relative_pose(np.empty((0, 2)), np.empty((0, 2)), camera).status
    <PoseStatus.FAILED: 'FAILED'>
    """
    views = Views(
        points0,
        points1,
        camera0,
        camera1 or camera0,
        covariance0_px2,
        covariance1_px2,
        readout_s,
        interval_s,
    )
    return estimate_views(views, options or DEFAULTS, seed)


def estimate_relative_pose_from_rays(
    rays0: np.ndarray,
    rays1: np.ndarray,
    *,
    noise_rad: float,
    options: RelativePoseOptions | None = None,
    seed: int = 0,
) -> RelativePose:
    """Motion between two views of any central camera, from rays (N, 3) in camera 0 and camera 1.

    ``options``, ``seed`` and the result have the same meaning as in `estimate_relative_pose`.
    ``noise_rad`` is the 1-sigma noise of a ray, rad, along each of two axes perpendicular to the
    ray. The attribute ``noise_px`` of the result is the estimated noise as a multiple of
    ``noise_rad``.
    """
    options = options or DEFAULTS
    matches = matches_from_rays(rays0, rays1, noise_rad)
    return estimate(matches, max(options.matching_tolerance_px, 3.0), options, seed)
