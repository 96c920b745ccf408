"""The Cramer-Rao bound against a dense Fisher matrix and against maximum likelihood itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from farpoint.errors import InputError
from farpoint.geometry import so3, sphere
from farpoint.synthetic import (
    PointScene,
    PointSceneOptions,
    cramer_rao_bound,
    make_point_scene,
    paper_camera,
    paper_example,
    rotation_cramer_rao_bound,
)


def reproject(scene: PointScene, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Both images of all points, (2, N, 2), at a perturbed pose and perturbed scene points."""
    R = so3.exp(pose[:3]) @ scene.rotation_cam1_from_cam0
    direction = scene.direction_cam1_from_cam0
    assert direction is not None
    baseline = np.linalg.norm(scene.translation_cam1_from_cam0)
    translation = baseline * sphere.retract(direction, sphere.tangent_basis(direction), pose[3:])
    return np.stack(
        [scene.camera.project(points), scene.camera.project(points @ R.T + translation)]
    )


def true_points(scene: PointScene) -> np.ndarray:
    return (scene.true_rays0 * scene.depths[:, None])[~scene.is_outlier]


def dense_bound(scene: PointScene) -> np.ndarray:
    """The bound without any elimination: central differences by the pose and all points at once."""
    points = true_points(scene)
    count = len(points)

    def pixels(parameters: np.ndarray) -> np.ndarray:
        return reproject(scene, parameters[:5], parameters[5:].reshape(count, 3)).ravel()

    start = np.concatenate([np.zeros(5), points.ravel()])
    columns = []
    for k in range(len(start)):
        step = np.zeros_like(start)
        step[k] = 1e-5
        columns.append((pixels(start + step) - pixels(start - step)) / 2e-5)
    jacobian = np.stack(columns, axis=1)
    return np.linalg.inv(jacobian.T @ jacobian / scene.noise_px**2)[:5, :5]


def maximum_likelihood_error(scene: PointScene) -> np.ndarray:
    """``[dtheta, dbeta]`` from the truth to the fit of pose and points to the noisy pixels."""
    true = ~scene.is_outlier
    measured = np.stack([scene.points0[true], scene.points1[true]])
    points = true_points(scene)
    depth_scale = scene.depths[true, None]

    def residuals(parameters: np.ndarray) -> np.ndarray:
        moved = points + parameters[5:].reshape(-1, 3) * depth_scale
        return (reproject(scene, parameters[:5], moved) - measured).ravel()

    count = len(points)
    fit = least_squares(residuals, np.zeros(5 + 3 * count), method="lm", x_scale="jac")
    assert fit.success
    return fit.x[:5]


@pytest.mark.parametrize("seed", range(3))
def test_the_bound_is_the_inverse_of_the_dense_fisher_matrix(seed):
    options = replace(paper_example(), matches=30, outliers=6)
    scene = make_point_scene(options, seed=seed)
    bound, dense = cramer_rao_bound(scene), dense_bound(scene)
    scale = np.sqrt(np.outer(np.diag(dense), np.diag(dense)))
    np.testing.assert_allclose(bound / scale, dense / scale, atol=2e-4)


def test_maximum_likelihood_reaches_the_bound():
    trials = 80
    options = replace(paper_example(noise_px=0.1), matches=12, far_share=0.5)
    whitened = []
    for seed in range(trials):
        scene = make_point_scene(options, seed=seed)
        factor = np.linalg.cholesky(cramer_rao_bound(scene))
        whitened.append(np.linalg.solve(factor, maximum_likelihood_error(scene)))
    errors = np.array(whitened)
    # Each whitened coordinate is standard normal: its mean square over 80 trials is
    # 1 +- sqrt(2 / 80) = 0.16, the mean of all five 1 +- 0.071, its mean +- 0.11.
    assert np.mean(errors**2) == pytest.approx(1.0, abs=0.21)
    assert np.abs(np.mean(errors**2, axis=0) - 1.0).max() < 0.55
    assert np.abs(errors.mean(axis=0)).max() < 0.38


def test_the_bound_ignores_outliers_and_increases_with_the_noise():
    scene = make_point_scene(replace(paper_example(outliers=20), noise_px=0.1), seed=1)
    bound = cramer_rao_bound(scene)
    np.testing.assert_allclose(cramer_rao_bound(replace(scene, noise_px=0.2)), 4 * bound)
    moved = scene.points1.copy()
    moved[scene.is_outlier] += 3.0
    np.testing.assert_array_equal(cramer_rao_bound(replace(scene, points1=moved)), bound)


def test_points_at_infinity_tell_the_rotation_but_not_the_direction():
    at_infinity = (math.inf, math.inf)
    options = PointSceneOptions(camera=paper_camera(), outliers=0, far_range_m=at_infinity)
    scene = make_point_scene(options, seed=2)
    nearly = make_point_scene(replace(options, far_range_m=(1e7, 1e7)), seed=2)
    np.testing.assert_allclose(cramer_rao_bound(scene), cramer_rao_bound(nearly), rtol=1e-3)
    with pytest.raises(InputError, match="determine"):
        cramer_rao_bound(make_point_scene(replace(options, far_share=1.0), seed=2))


def test_the_rotation_bound_is_that_of_the_whole_motion_with_all_points_far():
    turning = PointSceneOptions(camera=paper_camera(), outliers=0, translation_m=(0.0, 0.0, 0.0))
    scene = make_point_scene(turning, seed=3)
    bound = rotation_cramer_rao_bound(scene)
    # Independent: sigma^2 of the difference of two rays is twice that of one, and a match tells
    # the two angles across its ray; f is large, so a ray's noise is nearly noise_px / f.
    rays = scene.true_rays0
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    rough = np.linalg.inv(across.sum(axis=0)) * 2 * (scene.noise_px / 727.0) ** 2
    np.testing.assert_allclose(np.diag(bound), np.diag(rough), rtol=0.25)
    with pytest.raises(InputError, match="without translation"):
        rotation_cramer_rao_bound(make_point_scene(paper_example()))
    with pytest.raises(InputError, match="with translation"):
        cramer_rao_bound(scene)


def test_no_noise_has_no_bound():
    with pytest.raises(InputError, match="noise"):
        cramer_rao_bound(make_point_scene(paper_example(noise_px=0.0)))
