"""Cameras without a calibration: about the right focal length, and how far it may be off."""

from __future__ import annotations

import math

import numpy as np
import pytest

from farpoint.camera import Camera, EquivalentFocalLength, HorizontalField, camera_for
from farpoint.errors import InputError

CORNER = np.array([[1919.0, 1079.0]])


def angle_off_axis(camera: Camera, pixel: np.ndarray) -> float:
    return math.acos(camera.unproject(pixel)[0, 2])


@pytest.mark.parametrize("degrees", [20.0, 60.0, 90.0, 150.0])
def test_the_width_spans_the_field_of_view(degrees):
    camera = HorizontalField(degrees=degrees).camera(640, 480)
    assert camera.size == (640, 480)
    # Half a pixel beyond the centres of the outermost ones.
    edges = camera.unproject(np.array([[-0.5, 239.5], [639.5, 239.5]]))
    assert math.degrees(math.acos(edges[0] @ edges[1])) == pytest.approx(degrees)


@pytest.mark.parametrize(
    ("size", "millimetres", "focal_px"),
    [
        ((6000, 4000), 36.0, 6000.0),  # the frame of 36 x 24 mm itself
        ((4000, 6000), 36.0, 6000.0),  # held upright
        ((4000, 3000), 26.0, 26.0 / math.hypot(36.0, 24.0) * 5000.0),  # a phone: by the diagonal
    ],
)
def test_a_focal_length_in_35_mm_equivalents(size, millimetres, focal_px):
    camera = EquivalentFocalLength(millimetres=millimetres, source="EXIF").camera(*size)
    assert camera.model.parameters["fx"] == pytest.approx(focal_px)
    assert camera.model.parameters["fy"] == pytest.approx(focal_px)
    assert "EXIF" in str(camera.source)


def test_pixels_that_are_not_square_make_two_focal_lengths():
    """A pixel twice as wide as high is half as many to the radian across, as many upright."""
    guess = HorizontalField(degrees=60.0)
    camera, _ = camera_for(guess, 640, 480, pixel_aspect=2.0)
    square, _ = camera_for(guess, 640, 480)
    fx = square.model.parameters["fx"]
    assert camera.model.parameters["fx"] == pytest.approx(fx)
    assert camera.model.parameters["fy"] == pytest.approx(2.0 * fx)
    calibrated = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)
    assert camera_for(calibrated, 640, 480, pixel_aspect=2.0)[0] == calibrated


def test_only_a_guess_is_uncertain():
    assert HorizontalField(degrees=80.0).camera(1920, 1080).uncertainty is not None
    assert Camera.pinhole(640, 480, 500, 500, 319.5, 239.5).uncertainty is None


@pytest.mark.parametrize("degrees", [0.0, -60.0, 151.0, 195.0, math.nan, math.inf])
def test_a_field_of_view_that_no_pinhole_has(degrees):
    with pytest.raises(InputError, match=r"--fov: expected 1 to 150 degrees"):
        HorizontalField(degrees=degrees)


@pytest.mark.parametrize("millimetres", [0.0, -26.0, math.nan])
def test_a_focal_length_must_be_positive(millimetres):
    with pytest.raises(InputError, match="focal length"):
        EquivalentFocalLength(millimetres=millimetres, source="EXIF")
