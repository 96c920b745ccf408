"""The 6x6 covariance: against numerical derivatives, Monte Carlo, and pycolmap's own algebra."""

from __future__ import annotations

import numpy as np
import pytest
from made_pose import draws, made_pose, true_motion, without_direction

from farpoint import PoseOrder, RelativePose
from farpoint.errors import InputError
from farpoint.geometry import so3

SCALE, SCALE_SIGMA = 1.7, 0.03


def ros_error(pose: RelativePose, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """``[dp, dphi]`` of the pose of camera 1 in camera 0, fixed axes of camera 0."""
    R_est, t_est = pose.rotation_cam1_from_cam0, SCALE * pose.direction_cam1_from_cam0
    return np.concatenate([-R.T @ t + R_est.T @ t_est, so3.log(R.T @ R_est)])


def colmap_error(pose: RelativePose, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Twist ``[dtheta, dtau]`` on the left of cam1_from_cam0, to first order in the twist."""
    R_est, t_est = pose.rotation_cam1_from_cam0, SCALE * pose.direction_cam1_from_cam0
    dR = R @ R_est.T
    return np.concatenate([so3.log(dR), t - dR @ t_est])


ERRORS = {PoseOrder.ROS: ros_error, PoseOrder.COLMAP: colmap_error}


@pytest.mark.parametrize("order", list(PoseOrder))
@pytest.mark.parametrize("seed", range(3))
def test_the_covariance_is_carried_by_the_numerical_derivative(order: PoseOrder, seed: int):
    pose = made_pose(seed=seed)
    step = 1e-6
    jacobian = np.empty((6, 6))
    for k, unit in enumerate(np.eye(6)):
        ends = [
            ERRORS[order](pose, R, (SCALE + sign * step * unit[5]) * d)
            for sign in (1.0, -1.0)
            for R, d in [true_motion(pose, sign * step * unit[:5])]
        ]
        jacobian[:, k] = (ends[0] - ends[1]) / (2.0 * step)
    known = np.zeros((6, 6))
    known[:5, :5], known[5, 5] = pose.covariance, SCALE_SIGMA**2
    expected = jacobian @ known @ jacobian.T
    found = pose.pose_covariance(SCALE, SCALE_SIGMA, order)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("order", list(PoseOrder))
def test_errors_drawn_from_the_estimate_have_this_covariance(order: PoseOrder):
    pose, count = made_pose(sigma_rad=0.01, seed=4), 4000
    scales = SCALE + SCALE_SIGMA * np.random.default_rng(1).normal(size=count)
    errors = np.array(
        [
            ERRORS[order](pose, R, scale * d)
            for scale, tangent in zip(scales, draws(pose, count, seed=2), strict=True)
            for R, d in [true_motion(pose, tangent)]
        ]
    )
    claimed = pose.pose_covariance(SCALE, SCALE_SIGMA, order)
    whitened = np.linalg.solve(np.linalg.cholesky(claimed), errors.T)
    # The sampling error of an entry is 1 / sqrt(4000) = 0.016, of a variance 0.022.
    np.testing.assert_allclose(np.cov(whitened), np.eye(6), atol=0.09)


def test_the_two_orders_are_inverses_in_pycolmaps_algebra():
    pycolmap = pytest.importorskip("pycolmap")
    pose = made_pose(seed=5)
    R, t = pose.rotation_cam1_from_cam0, SCALE * pose.direction_cam1_from_cam0
    inverse_twist = pycolmap.get_covariance_for_inverse(
        pycolmap.Rigid3d(np.column_stack([R, t])),
        pose.pose_covariance(SCALE, SCALE_SIGMA, "colmap"),
    )
    # From a left twist of the inverse to fixed-axis errors: dp = dtau + dphi x p.
    p = -R.T @ t
    to_ros = np.zeros((6, 6))
    to_ros[:3, 3:] = to_ros[3:, :3] = np.eye(3)
    to_ros[:3, :3] = -so3.skew(p)
    ros = pose.pose_covariance(SCALE, SCALE_SIGMA)
    np.testing.assert_allclose(ros, to_ros @ inverse_twist @ to_ros.T, rtol=1e-9, atol=1e-12)


def test_a_length_known_exactly_leaves_no_error_along_the_direction():
    pose = made_pose()
    C = pose.pose_covariance(SCALE, 0.0, "colmap")
    along = pose.direction_cam1_from_cam0
    assert np.linalg.matrix_rank(C, tol=1e-12) == 5
    assert along @ C[3:, 3:] @ along == pytest.approx(0.0, abs=1e-18)


def test_nothing_without_a_direction():
    pose = without_direction(made_pose())
    assert pose.pose_covariance(SCALE, SCALE_SIGMA) is None


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ((0.0, 0.1), "scale"),
        ((np.nan, 0.1), "scale"),
        ((1.0, -0.1), "scale_sigma"),
        ((1.0, 0.1, "gtsam"), "order"),
    ],
)
def test_arguments_that_mean_nothing_are_refused(arguments: tuple, field: str):
    with pytest.raises(InputError, match=rf"^{field}: expected"):
        made_pose().pose_covariance(*arguments)
