"""What every lens model must hold, one of each kind: there and back, derivatives, field, NaN."""

from __future__ import annotations

import time

import numpy as np
import pytest
from lens_checks import assert_jacobians_hold, pixel_grid, round_trip_px, whole_rows_are_nan
from lens_collection import CENTRE, LENSES, SYMMETRIC

from farpoint.camera import Arctangent, Camera, CameraModel, Equirectangular


@pytest.fixture(params=LENSES)
def camera(request: pytest.FixtureRequest) -> Camera:
    return Camera(model=LENSES[request.param], size=(640, 480))


@pytest.fixture(params=SYMMETRIC)
def symmetric(request: pytest.FixtureRequest) -> CameraModel:
    return SYMMETRIC[request.param]


def rays_at(theta: np.ndarray, azimuth: float = 0.0) -> np.ndarray:
    sine = np.sin(theta)
    return np.column_stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(theta)])


def sphere(count: int) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def test_pixels_come_back_over_the_whole_image(camera: Camera) -> None:
    error_px, share_seen = round_trip_px(camera)
    assert error_px < 1e-8
    assert share_seen > 0.5


def test_rays_come_back_from_the_whole_sphere(camera: Camera) -> None:
    rays = sphere(5000)
    pixels = camera.project(rays)
    assert whole_rows_are_nan(pixels)
    # Where a pixel is far wider than the sensor, it tells its ray to fewer digits.
    in_reach = np.linalg.norm(pixels - [320, 240], axis=1) < 5000
    assert in_reach.sum() > 600
    np.testing.assert_allclose(camera.unproject(pixels[in_reach]), rays[in_reach], atol=2e-7)
    near = np.linalg.norm(pixels - [320, 240], axis=1) < 200
    np.testing.assert_allclose(camera.unproject(pixels[near]), rays[near], rtol=0, atol=1e-11)


def test_depth_changes_no_pixel(camera: Camera) -> None:
    rays = camera.unproject(pixel_grid((640, 480), 20))
    rays = rays[np.isfinite(rays[:, 0])]
    for depth in (1e-3, 7.5, 1e6):
        np.testing.assert_allclose(camera.project(depth * rays), camera.project(rays), atol=1e-8)


def test_both_jacobians_match_central_differences(camera: Camera) -> None:
    pixels = np.random.default_rng(1).uniform([5, 5], [635, 475], (400, 2))
    spread = np.linalg.norm(camera.unproject_jacobian(camera.unproject(pixels)), axis=(1, 2))
    # Near the rim of the field the ray moves ever faster, too fast for differences.
    away_from_rim = pixels[spread < 3 * np.nanmin(spread)]
    assert len(away_from_rim) > 100
    assert_jacobians_hold(camera, away_from_rim)


def test_jacobians_hold_on_the_axis_and_beside_it(camera: Camera) -> None:
    axis_px = camera.project(np.array([[0.0, 0.0, 1.0]]))[0]
    steps = np.array([[0, 0], [1e-8, 1e-8], [0, 1e-5], [1e-2, 0]])
    assert_jacobians_hold(camera, axis_px + steps)


def test_ray_and_pixel_derivatives_are_inverse(camera: Camera) -> None:
    rays = camera.unproject(pixel_grid((640, 480), 15))
    # At the poles of a 360-degree picture the longitude has no derivative.
    rays = rays[~(np.abs(rays[:, 1]) > 1 - 1e-12)]
    forward = camera.model.project_jacobian(rays)
    backward = camera.unproject_jacobian(rays)
    seen = np.isfinite(backward[:, 0, 0])
    assert seen.sum() > 100
    identity = forward[seen] @ backward[seen]
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(2), identity.shape), atol=1e-8)
    across = np.einsum("ni,nij->nj", rays[seen], backward[seen])
    np.testing.assert_allclose(across, 0, atol=1e-13)
    np.testing.assert_allclose(
        camera.unproject_jacobian(2.5 * rays), backward, rtol=1e-9, atol=1e-12
    )


def test_height_increases_up_to_the_end_of_the_field(symmetric: CameraModel) -> None:
    """Seen is one cone about the axis; within it the height grows, at its end growth is over."""
    theta = np.linspace(0, 3.1415, 20001)
    for azimuth in (0.0, 2.1):
        away = symmetric.project(rays_at(theta, azimuth)) - [CENTRE["cx"], CENTRE["cy"]]
        height = np.linalg.norm(away, axis=1)
        seen = np.isfinite(height)
        end = int(seen.sum())
        assert seen[:end].all()
        assert np.all(np.diff(height[:end]) > 0)
        slope, first = height[end - 1] - height[end - 2], height[1]
        stops, has_no_bound, is_whole = slope < 0.1 * first, slope > 20 * first, end == len(theta)
        # Devernay and Faugeras end theirs at a right angle.
        is_right_angle = isinstance(symmetric, Arctangent) and abs(theta[end] - np.pi / 2) < 2e-4
        assert stops or has_no_bound or is_whole or is_right_angle


def test_behind_the_camera(camera: Camera) -> None:
    """Right behind there is nothing but for the sphere, and no point has no distance."""
    points = np.array([[0, 0, 0], [np.nan, 0, 1], [0, 0, -1.0]])
    pixels = camera.project(points)
    assert np.isnan(pixels[:2]).all()
    assert np.isnan(camera.model.project_jacobian(points[:2])).all()
    if not isinstance(camera.model, Equirectangular):
        assert np.isnan(pixels[2]).all()
        assert np.isnan(camera.model.project_jacobian(points[2:])).all()
        assert np.isnan(camera.unproject_jacobian(points[2:])).all()


def test_unseen_points_have_no_derivative(camera: Camera) -> None:
    points = sphere(3000)
    unseen = np.isnan(camera.project(points)[:, 0])
    jacobian = camera.model.project_jacobian(points)
    assert whole_rows_are_nan(jacobian)
    np.testing.assert_array_equal(np.isnan(jacobian[:, 0, 0]), unseen)
    np.testing.assert_array_equal(np.isnan(camera.unproject_jacobian(points)[:, 0, 0]), unseen)


def test_no_ray_from_a_pixel_that_is_no_number(camera: Camera) -> None:
    rays = camera.unproject(
        np.array([[np.nan, 1], [1, np.nan], [np.inf, 1], [1, -np.inf], [np.nan, np.nan]])
    )
    assert np.isnan(rays).all()
    assert whole_rows_are_nan(camera.unproject(np.array([[1e300, 1.0], [1.0, -1e300]])))


def test_large_batches_equal_small_ones(camera: Camera) -> None:
    pixels = np.random.default_rng(5).uniform(0, [640, 480], (20001, 2))
    some = [0, 9000, 20000]
    rays = camera.unproject(pixels)
    np.testing.assert_allclose(rays[some], camera.unproject(pixels[some]), rtol=0, atol=1e-14)
    assert camera.unproject(np.empty((0, 2))).shape == (0, 3)
    assert camera.project(np.empty((0, 3))).shape == (0, 2)
    assert camera.unproject_jacobian(np.empty((0, 3))).shape == (0, 3, 2)


def test_a_million_pixels_in_half_a_second(camera: Camera) -> None:
    pixels = np.random.default_rng(6).uniform(0, [640, 480], (1_000_000, 2))
    camera.unproject(pixels[:10])
    start = time.process_time()
    camera.unproject(pixels)
    assert time.process_time() - start < 0.5


def test_parameters_are_numbers_by_name(camera: Camera) -> None:
    parameters = camera.model.parameters
    assert all(isinstance(value, float) for value in parameters.values())
    assert camera.model.title
    assert hash(camera.model) == hash(LENSES[next(k for k in LENSES if LENSES[k] == camera.model)])
