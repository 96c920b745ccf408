"""Noise that grows with the parallax is found, weighed and told."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import point_scene, pose_error

from farpoint import PoseStatus, RelativePose, estimate_relative_pose
from farpoint.camera import Camera
from farpoint.pose.general_motion import fit_general_motion
from farpoint.pose.matches import matches_from_points
from farpoint.pose.options import DEFAULTS
from farpoint.synthetic import PointScene

MATCHES, SIGMA_PX = 300, 0.1


def scene_with_scaled_noise(seed: int, length_px: float) -> tuple[PointScene, np.ndarray, tuple]:
    """A scene, the 1-sigma noise of each match, and its points with that noise."""
    scene = point_scene(
        seed,
        matches=MATCHES,
        outliers=0,
        noise_px=0.0,
        far_share=0.3,
        translation_m=(0.1, 0.05, -0.2),
    )
    camera: Camera = scene.camera
    turned = camera.project(camera.unproject(scene.points0) @ scene.rotation_cam1_from_cam0.T)
    parallax = np.linalg.norm(scene.points1 - turned, axis=1)
    sigma = SIGMA_PX * (1.0 + (parallax / length_px) ** 2) ** 0.25
    noise = sigma[:, None] * np.random.default_rng([seed, 1]).normal(size=(2, MATCHES, 2))
    return scene, sigma, (scene.points0 + noise[0], scene.points1 + noise[1])


def estimated(seed: int, length_px: float, told: bool) -> tuple[PointScene, RelativePose]:
    scene, sigma, points = scene_with_scaled_noise(seed, length_px)
    noise = sigma[:, None, None] ** 2 * np.eye(2) if told else None
    noises = {"covariance0_px2": noise, "covariance1_px2": noise}
    pose = estimate_relative_pose(*points, scene.camera, **noises)
    assert pose.status is PoseStatus.OK
    return scene, pose


def test_the_estimate_is_nearly_as_good_as_if_the_noise_were_known_and_as_honest():
    errors, nees = {False: [], True: []}, []
    for seed in range(150):
        for told in errors:
            scene, pose = estimated(seed, 0.5, told)
            error = pose_error(pose, scene)
            errors[told].append(error @ error)
            if not told:
                nees.append(error @ np.linalg.solve(pose.covariance, error))
    # 1.04 and 5.2; were it taken for even, 2.1 and 6.1.
    assert np.mean(errors[False]) < 1.2 * np.mean(errors[True])
    # Five degrees of freedom; a mean of 150 scatters by 0.26.
    assert 4.2 < np.mean(nees) < 5.8


@pytest.mark.parametrize(("length_px", "grows"), [(0.5, True), (1e9, False)])
def test_only_noise_that_scales_with_parallax_is_changed(length_px, grows):
    scene, sigma, points = scene_with_scaled_noise(1, length_px)
    matches = matches_from_points(*points, scene.camera, scene.camera)
    fit = fit_general_motion(matches, 1.5, DEFAULTS, np.zeros(1, np.uint64))
    ratio = matches.precision / fit.matches.precision
    assert (fit.matches is not matches) == grows
    if grows:
        assert np.corrcoef(ratio, sigma**2)[0, 1] > 0.98
        assert np.exp(np.log(ratio).mean()) == pytest.approx(1.0, rel=1e-3)
