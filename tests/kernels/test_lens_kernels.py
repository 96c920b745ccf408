"""Lens kernels against linear algebra and OpenCV; also run without the compiler."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from farpoint.camera.kernels.constants import LENS_TABLE_STEPS
from farpoint.camera.kernels.lens import (
    distort,
    invert_projection,
    pinhole_ray_jacobian,
    pinhole_rays,
    straight_ray_jacobian,
    undistort,
)

K = np.array([0.9, 0.2, 1e-3, -5e-4, 0.02, 1.2, 0.4, 0.05, 1e-3, -2e-3, 5e-4, 1e-3])


def unit_rows(count: int) -> np.ndarray:
    rays = np.random.default_rng(0).normal(size=(count, 3))
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def test_inverse_of_a_projection_is_its_pseudo_inverse() -> None:
    rays = unit_rows(50)
    # Rows perpendicular to the ray, as depth changes no pixel.
    forward = np.random.default_rng(1).normal(size=(50, 2, 3))
    forward -= (forward @ rays[:, :, None]) * rays[:, None, :]
    expected = np.linalg.pinv(forward)
    jacobian = np.empty((50, 3, 2))
    invert_projection(rays, forward, jacobian)
    np.testing.assert_allclose(jacobian, expected, rtol=1e-10, atol=1e-12)
    # At 3 times the distance, a displacement of the point moves its pixel by 1/3.
    invert_projection(3.0 * rays, forward / 3.0, jacobian)
    np.testing.assert_allclose(jacobian, expected, rtol=1e-10, atol=1e-12)


def test_no_inverse_where_the_projection_is_flat() -> None:
    jacobian = np.zeros((2, 3, 2))
    with np.errstate(all="ignore"):
        invert_projection(
            unit_rows(2), np.stack([np.zeros((2, 3)), np.full((2, 3), np.nan)]), jacobian
        )
    assert np.isnan(jacobian).all()


def test_distorts_as_opencv_does_and_back() -> None:
    x, y = np.random.default_rng(2).uniform(-1.0, 1.0, (2, 200))
    out = np.empty((6, 200))
    distort(K, x, y, out)
    zero = np.zeros(3)
    points = np.column_stack([x, y, np.ones(200)])
    expected = cv2.projectPoints(points, zero, zero, np.eye(3), K)[0][:, 0]
    np.testing.assert_allclose(out[:2].T, expected, rtol=0, atol=1e-12)

    radii = np.linspace(0.0, 2.0, 50)
    rim = np.empty((6, 50))
    distort(np.concatenate([K[:2], [0, 0], K[4:8], np.zeros(4)]), radii, np.zeros(50), rim)
    visible = np.hypot(x, y) < 1.2
    assert 100 < visible.sum() < 200
    even = np.arange(1, 400) / (LENS_TABLE_STEPS - np.arange(1, 400))
    quotients = np.append(1.0, np.interp(even, rim[0], radii) / even)
    for scales in (quotients, np.ones(2)):  # with the second, nearly all radii are searched for
        back = np.empty((2, 200))
        undistort(K, out[0], out[1], (rim[0], radii, scales), 5.0, 1.2, back)
        found = back[:, visible]
        np.testing.assert_allclose(found, np.stack([x, y])[:, visible], rtol=0, atol=1e-10)
        assert np.isnan(back[:, ~visible]).all()


def test_rays_of_a_pinhole() -> None:
    pixels = np.array([[320.0, 240.0], [820.0, -160.0], [np.nan, 0.0], [0.0, np.inf]])
    rays = np.empty((4, 3))
    pinhole_rays(pixels, 500.0, 400.0, 320.0, 240.0, rays)
    expected = [[0.0, 0.0, 1.0], np.array([1.0, -1.0, 1.0]) / np.sqrt(3.0)]
    np.testing.assert_allclose(rays[:2], expected, rtol=0, atol=1e-15)
    assert np.isnan(rays[2:]).all()


@pytest.mark.parametrize(("point", "visible"), [((0.5, 0.2, 1), True), ((2, 0, 1), False)])
def test_derivative_of_a_pinholes_ray(point: tuple[float, ...], visible: bool) -> None:
    rays = np.array([point, np.negative(point)], dtype=float)
    jacobian = np.empty((2, 3, 2))
    pinhole_ray_jacobian(np.zeros(12), 1.5, 500.0, 400.0, rays, jacobian)
    assert np.isnan(jacobian[1]).all()
    assert np.isfinite(jacobian[0]).all() == visible
    if visible:
        x, y, _ = point
        step = 1e-6
        ahead, behind = (
            np.array([[x + sign * step / 500, y, 1], [x, y + sign * step / 400, 1]])
            for sign in (1, -1)
        )
        rows = [r / np.linalg.norm(r, axis=1, keepdims=True) for r in (ahead, behind)]
        expected = (rows[0] - rows[1]).T / (2 * step)
        np.testing.assert_allclose(jacobian[0], expected, rtol=0, atol=1e-9)


def test_without_distortion_the_derivative_is_that_of_none() -> None:
    rays = 3.0 * np.concatenate([unit_rows(50), [[1.0, 0.0, 0.0]]])
    expected, jacobian = np.empty((2, 51, 3, 2))
    with np.errstate(all="ignore"):
        pinhole_ray_jacobian(np.zeros(12), np.inf, 500.0, 400.0, rays, expected)
        straight_ray_jacobian(500.0, 400.0, rays, jacobian)
    np.testing.assert_array_equal(np.isnan(jacobian[:, 0, 0]), rays[:, 2] <= 0.0)
    np.testing.assert_allclose(jacobian, expected, rtol=1e-12, atol=1e-15)
