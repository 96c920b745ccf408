"""The simulations of Burschka and Mair, "Direct Pose Estimation with a Monocular Camera" (2008)."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from farpoint.camera import Camera
from farpoint.synthetic.points import PointSceneOptions

__all__ = ["PAPER_NOISE_PX", "PAPER_OUTLIERS", "paper_camera", "paper_example", "paper_protocol"]

PAPER_NOISE_PX = math.sqrt(0.05)
"""1-sigma of the noise, px; the paper states the variance, 0.05 px^2."""

PAPER_OUTLIERS = 20
"""Number of outliers in the simulation table."""


def paper_camera() -> Camera:
    """640x480 camera with the focal length of the paper, 727 px."""
    return Camera.pinhole(640, 480, 727.0, 727.0, 319.5, 239.5)


def paper_example(*, noise_px: float = PAPER_NOISE_PX, outliers: int = 0) -> PointSceneOptions:
    """The motion of Fig. 4-5: near points at 1-4 m, far points at 25-35 m, a large rotation.

    The paper writes ``P' = R_p.T P - T_p`` with T_p = (0.3, 0.2, 0.4) m and
    ``R_p = Rz(5 deg) Ry(2 deg) Rx(10 deg)``, so ``R_cam1_from_cam0 = R_p.T`` and the translation is
    -T_p. After derotation by the true rotation the epipole is at ``x / z``, ``y / z`` of R_p T_p,
    which are (0.724, 0.370).
    """
    R_p = Rotation.from_euler("ZYX", (5.0, 2.0, 10.0), degrees=True)
    x, y, z = R_p.inv().as_rotvec()
    return PointSceneOptions(
        camera=paper_camera(),
        matches=110,
        outliers=outliers,
        far_share=0.5,
        near_range_m=(1.0, 4.0),
        far_range_m=(25.0, 35.0),
        rotation_vector_rad=(x, y, z),
        translation_m=(-0.3, -0.2, -0.4),
        noise_px=noise_px,
    )


def paper_protocol(
    rng: np.random.Generator, *, mean_matches: float = 89.8, outliers: int = PAPER_OUTLIERS
) -> PointSceneOptions:
    """One random pair of the simulation table: 89.8 matches on average, including 20 outliers.

    The paper gives these numbers and the variance of the noise. All other values are assumptions.
    The 89.8 matches are assumed to include the 20 outliers, which is the harder case. With
    ``mean_matches=109.8`` there are 20 outliers in addition to 89.8 inliers. The number of inliers
    has a Poisson distribution and is at least 10. 50 % of the inliers are near, at 1-4 m, and 50 %
    are far, at 200-1000 m. The rotation is up to 5 degrees about each axis. The translation has a
    random direction and a length of 1 to 5 cm.

    The assumed motions and far points are those that explain the results of the paper. The rotation
    errors of the paper about x, y and z are (0.0113, 0.0107, 0.0231) deg. These errors have the
    same ratios as the errors of a rotation from points that are known to be far. If all depths are
    unknown, the Cramer-Rao bound of the rotation about x and y is 0.026 deg, for any depths and any
    baseline, which is larger than the errors of the paper. Far points at 25-35 m would bias the
    rotation by more than the errors of the paper. The direction error of the paper, 2.59 deg,
    equals the Cramer-Rao bound for a baseline near 2 cm.

    Parameters
    ----------
    rng : numpy.random.Generator
        Random generator for the motion and the number of matches. Pass the same generator to
        `make_point_scene`.
    """
    turn = np.radians(rng.uniform(-5.0, 5.0, 3))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    translation = rng.uniform(0.01, 0.05) * direction
    true_matches = max(10, int(rng.poisson(mean_matches - outliers)))
    return PointSceneOptions(
        camera=paper_camera(),
        matches=true_matches + outliers,
        outliers=outliers,
        far_share=0.5,
        near_range_m=(1.0, 4.0),
        far_range_m=(200.0, 1000.0),
        rotation_vector_rad=(turn[0], turn[1], turn[2]),
        translation_m=(translation[0], translation[1], translation[2]),
        noise_px=PAPER_NOISE_PX,
    )
