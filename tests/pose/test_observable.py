"""How far is far (eq. 6): the formula against the shift of a projected point."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from farpoint import Camera, far_distance, observable_motion
from farpoint.errors import InputError

FOCAL_PX = 727.0
CAMERA = Camera.pinhole(640, 480, FOCAL_PX, FOCAL_PX, 319.5, 239.5)


def shift_px(distance_z_m: float, phi_rad: float, gamma_rad: float, motion_m: float) -> float:
    """Image shift of a point at depth Z, ``phi`` off the axis, when the camera moves.

    The motion lies in the plane of axis and ray, ``gamma`` off the perpendicular to the ray.
    """
    point = distance_z_m * np.array([math.tan(phi_rad), 0.0, 1.0])
    across = np.array([math.cos(phi_rad), 0.0, -math.sin(phi_rad)])
    along = np.array([math.sin(phi_rad), 0.0, math.cos(phi_rad)])
    motion = motion_m * (math.cos(gamma_rad) * across + math.sin(gamma_rad) * along)
    pixels = CAMERA.project(np.stack([point, point - motion]))
    return float(np.linalg.norm(pixels[1] - pixels[0]))


@settings(max_examples=100, deadline=None)
@given(
    phi_rad=st.floats(-1.2, 1.2),
    gamma_rad=st.floats(-1.4, 1.4),
    motion_m=st.floats(1e-3, 1e-2),
)
def test_a_point_at_the_far_distance_shifts_by_one_pixel(phi_rad, gamma_rad, motion_m):
    limit = far_distance(observable_motion(motion_m, gamma_rad, phi_rad), FOCAL_PX)
    # To first order in motion over distance, which the formula takes for granted.
    small = motion_m / limit / math.cos(phi_rad)
    shift = shift_px(limit, phi_rad, gamma_rad, motion_m)
    assert shift == pytest.approx(1.0, rel=2.0 * small + 1e-9)
    assert shift_px(2.0 * limit, phi_rad, gamma_rad, motion_m) < 1.0


def test_numbers_worked_out_by_hand():
    assert observable_motion(0.5, 0.0, 0.0) == 0.5
    assert observable_motion(1.0, math.pi / 3, 0.0) == pytest.approx(0.5)
    assert observable_motion(1.0, 0.0, math.pi / 3) == pytest.approx(2.0)
    assert observable_motion(1.0, math.pi / 2, 0.3) == pytest.approx(0.0, abs=1e-15)
    assert far_distance(0.1, 700.0) == pytest.approx(70.0)
    assert far_distance(0.1, 700.0, shift_px=0.5) == pytest.approx(140.0)
    np.testing.assert_allclose(far_distance(np.array([0.1, 0.2]), 700.0), [70.0, 140.0])


@pytest.mark.parametrize("bad", [math.pi / 2, -2.0, math.nan])
def test_a_ray_that_does_not_meet_the_image_plane(bad):
    with pytest.raises(InputError, match="phi_rad"):
        observable_motion(1.0, 0.0, bad)


@pytest.mark.parametrize("field", ["focal_px", "shift_px"])
@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan])
def test_lengths_in_pixels_are_positive(field, bad):
    with pytest.raises(InputError, match=field):
        far_distance(0.1, **{"focal_px": 700.0, field: bad})
