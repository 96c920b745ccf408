"""Factors for GTSAM: their residuals and noise, by derivatives taken through GTSAM itself."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from made_pose import draws, made_pose, true_motion, without_direction

from farpoint import RelativePose
from farpoint.errors import InputError, MissingExtraError
from farpoint.geometry import so3

SCALE, SCALE_SIGMA = 1.7, 0.03


@pytest.fixture(scope="module")
def gtsam():
    return pytest.importorskip("gtsam")


def graph_values(gtsam, R_cam1_from_cam0: np.ndarray, t: np.ndarray):
    """Both cameras somewhere in a world, the second where the motion says."""
    world_from_cam0 = gtsam.Pose3(gtsam.Rot3(so3.exp([0.4, -1.0, 2.0])), np.array([5.0, -3.0, 1.0]))
    cam0_from_cam1 = gtsam.Pose3(gtsam.Rot3(R_cam1_from_cam0.T), -R_cam1_from_cam0.T @ t)
    values = gtsam.Values()
    values.insert(0, world_from_cam0)
    values.insert(1, world_from_cam0.compose(cam0_from_cam1))
    return values


def whitened_jacobian(gtsam, factor, pose: RelativePose, scaled: bool) -> np.ndarray:
    """Derivative of the factor's whitened error by ``[dtheta, dbeta(, dscale)]``."""
    step = 1e-5
    columns = []
    for unit in np.eye(6 if scaled else 5):
        ends = []
        for sign in (1.0, -1.0):
            R, d = true_motion(pose, sign * step * unit[:5])
            length = SCALE + (sign * step * unit[5] if scaled else 0.0)
            ends.append(factor.whitenedError(graph_values(gtsam, R, length * d)))
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.column_stack(columns)


@pytest.mark.parametrize(
    "direction", [(-0.3, 0.1, -1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.2, 0.2, 1.0)]
)
@pytest.mark.parametrize("scaled", [False, True])
def test_the_noise_whitens_exactly_the_errors_of_the_estimate(gtsam, direction, scaled: bool):
    pose = made_pose(direction=direction, seed=3)
    scale = {"scale": SCALE, "scale_sigma": SCALE_SIGMA} if scaled else {}
    factor = pose.to_gtsam_factor(0, 1, **scale)
    kind = gtsam.BetweenFactorPose3 if scaled else gtsam.EssentialMatrixConstraint
    assert isinstance(factor, kind)
    J = whitened_jacobian(gtsam, factor, pose, scaled)
    known = np.zeros((len(J), len(J)))
    known[:5, :5] = pose.covariance
    if scaled:
        known[5, 5] = SCALE_SIGMA**2
    np.testing.assert_allclose(J @ known @ J.T, np.eye(len(J)), atol=1e-5)


@pytest.mark.parametrize("scaled", [False, True])
def test_the_estimate_itself_has_no_error(gtsam, scaled: bool):
    pose = made_pose(seed=6)
    scale = {"scale": SCALE, "scale_sigma": SCALE_SIGMA} if scaled else {}
    values = graph_values(
        gtsam, pose.rotation_cam1_from_cam0, SCALE * pose.direction_cam1_from_cam0
    )
    factor = pose.to_gtsam_factor(0, 1, **scale)
    np.testing.assert_allclose(factor.unwhitenedError(values), 0.0, atol=1e-12)


def test_the_error_of_the_truth_is_chi_square_of_five(gtsam):
    pose = made_pose(sigma_rad=0.01, seed=7)
    factor = pose.to_gtsam_factor(0, 1)
    squares = [
        2.0 * factor.error(graph_values(gtsam, R, SCALE * d))
        for tangent in draws(pose, 2000, seed=8)
        for R, d in [true_motion(pose, tangent)]
    ]
    assert np.mean(squares) == pytest.approx(5.0, abs=3.3 * np.sqrt(10.0 / 2000))


def test_a_graph_finds_the_motion_and_its_uncertainty(gtsam):
    pose = made_pose(sigma_rad=0.002, seed=9)
    R, d = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0
    graph, truth = gtsam.NonlinearFactorGraph(), graph_values(gtsam, R, SCALE * d)
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-9)
    graph.add(gtsam.PriorFactorPose3(0, truth.atPose3(0), tight))
    graph.add(pose.to_gtsam_factor(0, 1, scale=SCALE, scale_sigma=SCALE_SIGMA))
    start = graph_values(gtsam, so3.exp([0.05, 0.0, 0.02]) @ R, 1.1 * SCALE * d)
    found = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    assert found.atPose3(1).equals(truth.atPose3(1), 1e-6)
    claimed = gtsam.Marginals(graph, found).marginalCovariance(1)
    expected = pose.pose_covariance(SCALE, SCALE_SIGMA, "colmap")
    np.testing.assert_allclose(claimed, expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.usefixtures("gtsam")
def test_nothing_without_a_direction():
    assert without_direction(made_pose()).to_gtsam_factor(0, 1) is None


@pytest.mark.usefixtures("gtsam")
def test_a_length_known_exactly_is_no_factor():
    with pytest.raises(InputError, match=r"^scale_sigma: expected more than 0"):
        made_pose().to_gtsam_factor(0, 1, scale=1.0)


def test_without_gtsam_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(MissingExtraError, match=r"farpoint\[gtsam\]"):
        made_pose().to_gtsam_factor(0, 1)
