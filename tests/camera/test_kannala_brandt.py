"""The fisheye against OpenCV, COLMAP, its textbook formula beyond 90 degrees, and its fold."""

from __future__ import annotations

import math
import time

import cv2
import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lens_checks import assert_jacobians_hold, round_trip_px, whole_rows_are_nan

from farpoint.camera import Camera, KannalaBrandt
from farpoint.errors import InputError

# A TUM-VI camera: 195 degrees across its diagonal circle.
TUMVI = KannalaBrandt(
    fx=190.97847715128717,
    fy=190.9733070521226,
    cx=254.93170605935475,
    cy=256.8974428996504,
    k1=0.0034823894022493434,
    k2=0.0007150348452162257,
    k3=-0.0020532361418706202,
    k4=0.00020293673591811182,
)
CAMERA = Camera(model=TUMVI, size=(512, 512))
K = np.array([[TUMVI.fx, 0, TUMVI.cx], [0, TUMVI.fy, TUMVI.cy], [0, 0, 1]])
D = np.array([TUMVI.k1, TUMVI.k2, TUMVI.k3, TUMVI.k4])


def forward_points(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform([-2, -2, 0.3], [2, 2, 3], (count, 3))


def test_projects_as_opencv_does() -> None:
    points = forward_points(500)
    expected = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), K, D)[0][:, 0]
    np.testing.assert_allclose(CAMERA.project(points), expected, rtol=0, atol=1e-9)


def test_projects_as_colmap_does_half_a_pixel_away() -> None:
    params = [TUMVI.fx, TUMVI.fy, TUMVI.cx + 0.5, TUMVI.cy + 0.5, *D]
    peer = pycolmap.Camera(model="OPENCV_FISHEYE", width=512, height=512, params=params)
    points = forward_points(200)
    expected = np.array([peer.img_from_cam(point) for point in points]).reshape(-1, 2) - 0.5
    np.testing.assert_allclose(CAMERA.project(points), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("theta_deg", [0.001, 30, 89.9, 90, 95, 110])
@pytest.mark.parametrize("azimuth_deg", [0, 77, 200])
def test_textbook_height_up_to_and_beyond_a_right_angle(
    theta_deg: float, azimuth_deg: float
) -> None:
    theta, azimuth = math.radians(theta_deg), math.radians(azimuth_deg)
    ray = [
        math.sin(theta) * math.cos(azimuth),
        math.sin(theta) * math.sin(azimuth),
        math.cos(theta),
    ]
    height = theta + sum(k * theta ** (2 * i + 3) for i, k in enumerate(D))
    expected = [
        TUMVI.fx * height * math.cos(azimuth) + TUMVI.cx,
        TUMVI.fy * height * math.sin(azimuth) + TUMVI.cy,
    ]
    np.testing.assert_allclose(CAMERA.project(np.array([ray]))[0], expected, rtol=0, atol=1e-10)
    np.testing.assert_allclose(CAMERA.unproject(np.array([expected]))[0], ray, rtol=0, atol=1e-12)


def test_round_trip_over_the_whole_image() -> None:
    error_px, share_seen = round_trip_px(CAMERA)
    assert error_px < 1e-8
    assert share_seen == 1.0


def test_jacobians_match_central_differences_everywhere() -> None:
    pixels = np.random.default_rng(1).uniform(5, 507, (400, 2))
    assert np.rad2deg(np.arccos(CAMERA.unproject(pixels)[:, 2].min())) > 100
    assert_jacobians_hold(CAMERA, pixels)
    steps = np.array([[1e-2, 0], [0, 1e-5], [1e-8, 1e-8], [0, 0]])
    assert_jacobians_hold(CAMERA, steps + np.array([TUMVI.cx, TUMVI.cy]))


def test_field_ends_at_the_largest_height() -> None:
    """With k1 alone the height theta + k1 theta^3 grows until 3 k1 theta^2 = -1."""
    end = 1.9
    lens = KannalaBrandt(fx=100, fy=100, cx=0, cy=0, k1=-1 / (3 * end**2))
    for theta, seen in ((end - 1e-6, True), (end + 1e-6, False)):
        pixel = lens.project(np.array([[math.sin(theta), 0, math.cos(theta)]]))
        assert np.isfinite(pixel).all() == seen
    top_px = 100 * end * 2 / 3
    rays = lens.unproject(np.array([[top_px - 1e-6, 0], [top_px + 1e-6, 0], [-5000, 0]]))
    assert np.isfinite(rays[:, 0]).tolist() == [True, False, False]
    assert np.isnan(lens.project_jacobian(np.array([[0.0, 0.1, -5.0]]))).all()


def test_every_coefficient_moves_the_end_of_the_field() -> None:
    for k in np.random.default_rng(7).uniform(-0.02, 0.01, (20, 4)):
        lens = KannalaBrandt(fx=1, fy=1, cx=0, cy=0, k1=k[0], k2=k[1], k3=k[2], k4=k[3])
        theta = np.linspace(1e-3, np.pi - 1e-3, 20001)
        height = theta + sum(k[i] * theta ** (2 * i + 3) for i in range(4))
        end = np.argmax(np.diff(height) <= 0) or len(theta)
        rays = np.column_stack([np.sin(theta), np.zeros(len(theta)), np.cos(theta)])
        seen = np.isfinite(lens.project(rays)[:, 0])
        assert abs(seen.sum() - end) <= 1


def test_whole_sphere_but_the_point_behind() -> None:
    """Without coefficients every direction has its pixel: the height is the angle itself."""
    lens = KannalaBrandt(fx=100, fy=100, cx=320, cy=240)
    almost_behind = lens.project(np.array([[1e-9, 0, -1], [0, 0, -1], [0, 0, 1], [0, 0, 0]]))
    np.testing.assert_allclose(almost_behind[0], [320 + 100 * np.pi, 240], atol=1e-6)
    assert np.isnan(almost_behind[[1, 3]]).all()
    np.testing.assert_array_equal(almost_behind[2], [320, 240])


def test_no_ray_from_a_pixel_that_is_no_number() -> None:
    rays = CAMERA.unproject(np.array([[np.nan, 10], [np.inf, 10], [10, -np.inf], [1e300, 0]]))
    assert np.isnan(rays).all()


def test_a_million_pixels_in_half_a_second() -> None:
    pixels = np.random.default_rng(6).uniform(0, 512, (1_000_000, 2))
    CAMERA.unproject(pixels[:10])
    start = time.process_time()
    CAMERA.unproject(pixels)
    assert time.process_time() - start < 0.5


@settings(max_examples=60, deadline=None)
@given(
    k=st.lists(st.floats(-0.2, 0.2), min_size=4, max_size=4),
    focal=st.floats(50, 1000),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_fisheye_comes_back_or_says_nan(k: list[float], focal: float, seed: int) -> None:
    lens = KannalaBrandt(fx=focal, fy=focal, cx=320, cy=240, k1=k[0], k2=k[1], k3=k[2], k4=k[3])
    pixels = np.random.default_rng(seed).uniform(0, [640, 480], (200, 2))
    rays = lens.unproject(pixels)
    assert whole_rows_are_nan(rays)
    seen = np.isfinite(rays[:, 0])
    np.testing.assert_allclose(lens.project(rays[seen]), pixels[seen], rtol=0, atol=1e-8)
    np.testing.assert_array_equal(lens.unproject(np.array([[320.0, 240.0]])), [[0, 0, 1]])


def test_parameters_out_of_range_are_named() -> None:
    with pytest.raises(InputError, match="finite") as caught:
        KannalaBrandt(fx=1, fy=1, cx=0, cy=0, k3=math.nan)
    assert caught.value.field == "k3"
