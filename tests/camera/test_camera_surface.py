"""The class users hold: what it accepts, what it refuses, and how it describes itself."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.camera import (
    Camera,
    CameraModel,
    Equirectangular,
    KannalaBrandt,
    Pinhole,
    describe,
    draw_radial_curve,
    field_of_view,
    radial_curve,
    valid_region,
)
from farpoint.errors import InputError

EUROC = (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)


@pytest.fixture
def camera() -> Camera:
    return Camera.pinhole(752, 480, 458.654, 457.296, 367.215, 248.375, EUROC)


def test_other_number_types_are_taken(camera: Camera) -> None:
    expected = camera.unproject(np.array([[100.0, 200.0], [300.0, 50.0]]))
    for pixels in ([[100, 200], [300, 50]], np.array([[100, 200], [300, 50]], np.float32)):
        np.testing.assert_array_equal(camera.unproject(pixels), expected)  # type: ignore[arg-type]
    np.testing.assert_array_equal(
        camera.project([[0, 0, 2]]),  # type: ignore[arg-type]
        [[367.215, 248.375]],
    )


def test_no_rows_give_no_rows(camera: Camera) -> None:
    assert camera.unproject(np.empty((0, 2))).shape == (0, 3)
    assert camera.project(np.empty((0, 3))).shape == (0, 2)
    assert camera.unproject_jacobian(np.empty((0, 3))).shape == (0, 3, 2)


@pytest.mark.parametrize(
    "pixels", [[1.0, 2.0], [[1.0, 2.0, 3.0]], [["a", "b"]], [[[1.0, 2.0]]], None]
)
def test_wrong_pixels_raise(camera: Camera, pixels: object) -> None:
    with pytest.raises(ValueError, match=r"pixels: expected .*\(N, 2\)"):
        camera.unproject(pixels)  # type: ignore[arg-type]


def test_wrong_points_raise(camera: Camera) -> None:
    with pytest.raises(ValueError, match=r"points: expected shape \(N, 3\), got \(1, 2\)"):
        camera.project(np.ones((1, 2)))
    with pytest.raises(ValueError, match=r"rays: expected shape \(N, 3\), got \(3,\)"):
        camera.unproject_jacobian(np.ones(3))


@pytest.mark.parametrize(("width", "height", "field"), [(0, 480, "width"), (752, 4.5, "height")])
def test_image_size_must_be_pixels(width: int, height: int, field: str) -> None:
    with pytest.raises(InputError, match="positive whole number") as caught:
        Camera.pinhole(width, height, 1, 1, 0, 0)
    assert caught.value.field == field


def test_size_is_fixed_once() -> None:
    open_camera = Camera(model=Pinhole(fx=1, fy=1, cx=0, cy=0), name="P0", source="KITTI")
    fixed = open_camera.with_size(1241, 376)
    assert (fixed.size, fixed.name, fixed.source) == ((1241, 376), "P0", "KITTI")
    assert fixed.with_size(1241, 376) == fixed
    with pytest.raises(InputError, match="images are 640x480 but the calibration is for 1241x376"):
        fixed.with_size(640, 480)


def test_unproject_jacobian_moves_rays_as_pixels_move(camera: Camera) -> None:
    pixels = np.random.default_rng(0).uniform(0, [752, 480], (300, 2))
    rays = camera.unproject(pixels)
    jacobian = camera.unproject_jacobian(rays)
    assert jacobian.shape == (300, 3, 2)
    np.testing.assert_allclose(np.einsum("ni,nij->nj", rays, jacobian), 0, atol=1e-15)
    step = np.array([0.3, -0.2])
    moved = camera.unproject(pixels + step)
    np.testing.assert_allclose(moved, rays + jacobian @ step, rtol=0, atol=1e-6)
    np.testing.assert_allclose(camera.unproject_jacobian(2.5 * rays), jacobian, rtol=1e-12)
    assert np.isnan(camera.unproject_jacobian(-rays)).all()


def test_field_of_view_of_a_right_angle() -> None:
    fov = field_of_view(Camera.pinhole(640, 480, 320, 240, 319.5, 239.5))
    assert np.rad2deg(fov.horizontal_rad) == pytest.approx(90, abs=1e-9)
    assert np.rad2deg(fov.vertical_rad) == pytest.approx(90, abs=1e-9)
    assert np.rad2deg(fov.diagonal_rad) == pytest.approx(2 * np.rad2deg(np.arctan(np.sqrt(2))))
    assert fov.complete


def test_field_of_view_needs_a_size() -> None:
    with pytest.raises(InputError, match="no image size"):
        field_of_view(Camera(model=Pinhole(fx=1, fy=1, cx=0, cy=0)))


def test_description_has_a_line_for_each_parameter(camera: Camera) -> None:
    lines = describe(camera).splitlines()
    assert lines[0] == "camera: pinhole with radial-tangential distortion (4 coefficients)"
    assert "image size: 752 x 480 px" in lines
    assert lines[3:5] == ["fx = 458.654", "fy = 457.296"]
    assert lines[10:12] == ["p2 = 1.76187114e-05", ""]
    assert lines[12].startswith("angle off the axis, deg")


def test_radial_curve_of_a_pinhole_is_an_arctangent() -> None:
    curve = radial_curve(Camera.pinhole(640, 480, 300, 300, 319.5, 239.5))
    assert curve.radius_px[0] == 0
    assert curve.radius_px[-1] == pytest.approx(400)
    np.testing.assert_allclose(curve.angle_rad, np.arctan(curve.radius_px / 300), atol=1e-7)


def test_radial_curve_ends_with_the_field_or_right_behind() -> None:
    folding = radial_curve(Camera.pinhole(1200, 900, 458, 458, 600, 450, (-0.5, 0, 0, 0)))
    fold = np.sqrt(1 / 1.5)
    assert folding.radius_px[-1] == pytest.approx(458 * fold * 2 / 3, abs=1)
    assert folding.angle_rad[-1] == pytest.approx(np.arctan(fold), abs=0.1)
    sphere = radial_curve(Camera(model=Equirectangular(width=640, height=320), size=(640, 320)))
    assert sphere.angle_rad[-1] == pytest.approx(np.pi)
    assert sphere.radius_px[-1] == pytest.approx(320)
    with pytest.raises(InputError, match="no image size"):
        radial_curve(Camera(model=Pinhole(fx=1, fy=1, cx=0, cy=0)))


def test_drawn_curve_departs_from_its_pinhole() -> None:
    """The equidistant fisheye is a straight line from 0 to the corner; its pinhole lies below."""
    camera = Camera(model=KannalaBrandt(fx=250, fy=250, cx=320, cy=240), size=(640, 480))
    lines = draw_radial_curve(camera).splitlines()
    plot = [line[7:].ljust(60) for line in lines[1:-2]]
    assert len(plot) == 13
    assert lines[1].startswith("   92 |")
    assert lines[-1].endswith("401 px")
    for column in range(60):
        stars = [row for row in range(13) if plot[row][column] == "*"]
        assert stars
        assert abs(stars[0] - 12 * (1 - column / 59)) <= 1
        assert not any(plot[row][column] == "." for row in range(stars[0]))
    assert "." in plot[6]
    straight = draw_radial_curve(Camera.pinhole(640, 480, 300, 300, 320, 240))
    assert "." not in "".join(straight.splitlines()[1:])


def test_valid_region_is_the_circle_of_the_field() -> None:
    camera = Camera.pinhole(1200, 900, 458, 458, 600, 450, (-0.5, 0, 0, 0))
    region = valid_region(camera)
    v, u = np.indices((900, 1200))
    distance = np.hypot(u - 600, v - 450)
    edge_px = 458 * np.sqrt(1 / 1.5) * 2 / 3
    assert region.shape == (900, 1200)
    assert region[distance < edge_px - 1e-6].all()
    assert not region[distance > edge_px + 1e-6].any()
    with pytest.raises(InputError, match="no image size"):
        valid_region(Camera(model=Pinhole(fx=1, fy=1, cx=0, cy=0)))


def test_description_says_what_is_missing() -> None:
    unsized = Camera(model=Pinhole(fx=1, fy=1, cx=0, cy=0))
    assert "the first frame fixes it" in describe(unsized)
    folding = Camera.pinhole(1200, 900, 458, 458, 600, 450, (-0.5, 0, 0, 0))
    assert "no ray exists for part of the image" in describe(folding)
    hopeless = Camera.pinhole(640, 480, 500, 500, 320, 240, (-1e6, 0, 0, 0))
    assert "the lens model ends beside its axis" in describe(hopeless)


def test_pinhole_is_a_camera_model() -> None:
    model: CameraModel = Pinhole(fx=1, fy=1, cx=0, cy=0)
    assert model.title == "pinhole without distortion"
