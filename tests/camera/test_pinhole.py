"""The pinhole against OpenCV, COLMAP, its own derivatives and the place where it folds over."""

from __future__ import annotations

import math
import time

import cv2
import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lens_checks import (
    assert_jacobians_hold,
    pixel_grid,
    project_jacobian_by_differences,
    round_trip_px,
    whole_rows_are_nan,
)

from farpoint.camera import Camera, Pinhole
from farpoint.errors import InputError

INTRINSICS = {"fx": 458.654, "fy": 457.296, "cx": 367.215, "cy": 248.375}
RATIONAL = (0.9, 0.2, 1e-3, -5e-4, 0.02, 1.2, 0.4, 0.05)
DISTORTIONS = {
    "none": (),
    "euroc": (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05),
    "tum1": (0.262383, -0.953104, -0.005358, 0.002628, 1.163314),
    "barrel": (-0.3, 0.1, 0.0, 0.0),
    "rational": RATIONAL,
    "prism": (*RATIONAL, 1e-3, -2e-3, 5e-4, 1e-3),
    "tilted": (*RATIONAL, 1e-3, -2e-3, 5e-4, 1e-3, 0.02, -0.03),
}
# These fold over inside the image: k1 alone at r = sqrt(1 / (3 * 0.5)) = 0.816.
FOLDING = {
    "radial": (-0.5, 0.0, 0.0, 0.0),
    "tangential": (-0.5, 0.1, 1e-2, -2e-2),
    "prism": (*(-0.4, 0.05, 2e-3, 1e-3, 0.0, 0.0, 0.0, 0.0), 1e-2, -5e-3, 2e-2, 1e-3),
}


def camera_with(distortion: tuple[float, ...]) -> Camera:
    return Camera.pinhole(752, 480, **INTRINSICS, distortion=distortion)


def camera_matrix(model: Pinhole) -> np.ndarray:
    return np.array([[model.fx, 0, model.cx], [0, model.fy, model.cy], [0, 0, 1.0]])


@pytest.fixture(params=DISTORTIONS)
def camera(request: pytest.FixtureRequest) -> Camera:
    return camera_with(DISTORTIONS[request.param])


def test_projects_as_opencv_does(camera: Camera) -> None:
    model = camera.model
    assert isinstance(model, Pinhole)
    points = np.random.default_rng(1).uniform([-1, -0.7, 1], [1, 0.7, 2.5], (500, 3))
    expected, _ = cv2.projectPoints(
        points,
        np.zeros(3),
        np.zeros(3),
        camera_matrix(model),
        np.array(model.distortion or [0.0] * 4),
    )
    np.testing.assert_allclose(camera.project(points), expected[:, 0], rtol=0, atol=1e-9)


def test_unprojects_as_opencv_does(camera: Camera) -> None:
    model = camera.model
    assert isinstance(model, Pinhole)
    pixels = pixel_grid((752, 480), 20)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 1000, 1e-13)
    # In OpenCV 4 another function takes as many steps as one asks for.
    undistort = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
    expected = undistort(
        pixels[:, None],
        camera_matrix(model),
        np.array(model.distortion or [0.0] * 4),
        R=None,
        P=None,
        criteria=criteria,
    )[:, 0]
    rays = camera.unproject(pixels)
    # OpenCV 4 ends elsewhere in two corners of one of these lenses.
    off = np.abs(rays[:, :2] / rays[:, 2:] - expected).max(axis=1)
    assert np.count_nonzero(~(off <= 1e-8)) <= (2 if cv2.__version__ < "5" else 0)


def test_projects_as_colmap_does_half_a_pixel_away() -> None:
    distortion = DISTORTIONS["euroc"]
    peer = pycolmap.Camera(
        model="OPENCV",
        width=752,
        height=480,
        params=[458.654, 457.296, 367.215 + 0.5, 248.375 + 0.5, *distortion],
    )
    points = np.random.default_rng(2).uniform([-1, -0.7, 1], [1, 0.7, 2.5], (200, 3))
    expected = np.array([peer.img_from_cam(point) for point in points]).reshape(-1, 2) - 0.5
    np.testing.assert_allclose(camera_with(distortion).project(points), expected, rtol=0, atol=1e-9)


def test_round_trip_over_the_whole_image(camera: Camera) -> None:
    error_px, share_seen = round_trip_px(camera)
    assert share_seen == 1.0
    assert error_px < 1e-8


def test_jacobians_match_central_differences(camera: Camera) -> None:
    assert_jacobians_hold(camera, np.random.default_rng(3).uniform(20, [730, 460], (200, 2)))


@pytest.mark.parametrize("name", FOLDING)
def test_folding_lens_sees_up_to_its_nearest_fold(name: str) -> None:
    """The field ends at the smallest radius at which OpenCV's map loses its orientation."""
    free = Pinhole(fx=1, fy=1, cx=0, cy=0, distortion=FOLDING[name])
    radii = np.linspace(1e-3, 3.0, 3000)
    folds, ends = [], []
    for azimuth in np.linspace(-np.pi, np.pi, 73):
        plane = radii[:, None] * [np.cos(azimuth), np.sin(azimuth)]
        points = np.column_stack([plane, np.ones(len(radii))])
        keeps = np.linalg.det(_plane_jacobian_by_opencv(points, free)) > 0
        seen = np.isfinite(free.project(points)[:, 0])
        folds.append(_first_false(keeps))
        ends.append(_first_false(seen))
        assert not np.any(seen[ends[-1] :])
    assert abs(min(folds) - min(ends)) <= 1
    assert len(set(ends)) == 1


@pytest.mark.parametrize("name", FOLDING)
def test_folding_lens_comes_back_where_it_sees(name: str) -> None:
    camera = Camera.pinhole(1200, 900, 458.0, 457.0, 600.0, 450.0, FOLDING[name])
    error_px, share_seen = round_trip_px(camera)
    assert error_px < 1e-8
    assert 0.1 < share_seen < 0.3


def _first_false(values: np.ndarray) -> int:
    return int(np.argmin(values)) if not values.all() else len(values)


def _distorted_by_opencv(points: np.ndarray, model: Pinhole) -> np.ndarray:
    zero = np.zeros(3)
    return cv2.projectPoints(points, zero, zero, np.eye(3), np.array(model.distortion))[0][:, 0]


def _plane_jacobian_by_opencv(points: np.ndarray, model: Pinhole) -> np.ndarray:
    step = 1e-6
    columns = [
        _distorted_by_opencv(points + step * axis, model)
        - _distorted_by_opencv(points - step * axis, model)
        for axis in np.eye(3)[:2]
    ]
    return np.stack(columns, axis=-1) / (2 * step)


@pytest.mark.parametrize("name", FOLDING)
def test_every_point_before_the_fold_comes_back(name: str) -> None:
    camera = camera_with(FOLDING[name])
    points = np.random.default_rng(4).uniform([-3, -3, 1], [3, 3, 1], (20000, 3))
    pixels = camera.project(points)
    seen = np.isfinite(pixels[:, 0])
    rays = camera.unproject(pixels[seen])
    # At the fold itself two rays meet in one pixel, to rounding.
    assert np.isnan(rays[:, 0]).mean() < 1e-3
    found = np.isfinite(rays[:, 0])
    plane = rays[found, :2] / rays[found, 2:]
    np.testing.assert_allclose(plane, points[seen][found, :2], rtol=0, atol=1e-5)


def test_analytic_fold_radius() -> None:
    """With k1 alone, r (1 + k1 r^2) grows until 3 k1 r^2 = -1; its height there is 2/3 r."""
    fold = math.sqrt(1 / 1.5)
    camera = Camera.pinhole(2000, 2000, 1000.0, 1000.0, 0.0, 0.0, (-0.5, 0, 0, 0))
    points = np.array([[fold * (1 - 1e-8), 0, 1], [fold * (1 + 1e-8), 0, 1]])
    assert np.isfinite(camera.project(points)).tolist() == [[True, True], [False, False]]
    edge_px = 1000.0 * fold * 2 / 3
    rays = camera.unproject(np.array([[edge_px - 1e-6, 0.0], [edge_px + 1e-6, 0.0]]))
    assert np.isfinite(rays[:, 0]).tolist() == [True, False]


def test_pole_of_the_rational_model_ends_the_field() -> None:
    """A denominator 1 - r^2 vanishes at 45 degrees: all pixels lie before it, no point beyond."""
    camera = camera_with((0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0))
    assert np.isfinite(camera.project(np.array([[0.999, 0, 1.0]]))).all()
    assert np.isnan(camera.project(np.array([[1.001, 0, 1.0]]))).all()
    error_px, share_seen = round_trip_px(camera)
    assert share_seen == 1.0
    assert error_px < 1e-8


def test_nothing_is_seen_behind_or_at_no_distance(camera: Camera) -> None:
    points = np.array([[0, 0, -1], [0.1, 0.2, -0.5], [1, 0, 0], [0, 0, 0], [np.nan, 0, 1.0]])
    assert np.isnan(camera.project(points)).all()
    assert np.isnan(camera.model.project_jacobian(points)).all()


def test_no_ray_from_a_pixel_that_is_no_number(camera: Camera) -> None:
    pixels = np.array([[np.nan, 10], [10, np.nan], [np.inf, 10], [10, -np.inf], [1e300, 1e300]])
    rays = camera.unproject(pixels)
    assert np.isnan(rays[:4]).all()
    assert whole_rows_are_nan(rays)


def test_large_batches_equal_small_ones(camera: Camera) -> None:
    pixels = np.random.default_rng(5).uniform(0, [752, 480], (20001, 2))
    rays = camera.unproject(pixels)
    np.testing.assert_array_equal(
        rays[[0, 9000, 20000]], camera.unproject(pixels[[0, 9000, 20000]])
    )
    np.testing.assert_array_equal(camera.project(rays)[-3:], camera.project(rays[-3:]))


@pytest.mark.parametrize("name", ["euroc", "tilted"])
def test_a_million_pixels_in_half_a_second(name: str) -> None:
    camera = camera_with(DISTORTIONS[name])
    pixels = np.random.default_rng(6).uniform(0, [752, 480], (1_000_000, 2))
    camera.unproject(pixels[:10])
    start = time.process_time()
    camera.unproject(pixels)
    assert time.process_time() - start < 0.5


finite = st.floats(-1, 1)


@settings(max_examples=60, deadline=None)
@given(
    k=st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3),
    p=st.lists(st.floats(-0.02, 0.02), min_size=2, max_size=2),
    focal=st.floats(50, 3000),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_lens_comes_back_or_says_nan(
    k: list[float], p: list[float], focal: float, seed: int
) -> None:
    camera = Camera.pinhole(640, 480, focal, focal, 320, 240, (k[0], k[1], *p, k[2]))
    pixels = np.random.default_rng(seed).uniform(0, [640, 480], (200, 2))
    rays = camera.unproject(pixels)
    assert whole_rows_are_nan(rays)
    seen = np.isfinite(rays[:, 0])
    np.testing.assert_allclose(camera.project(rays[seen]), pixels[seen], rtol=0, atol=1e-8)
    # The centre of distortion always has its ray, and depth changes no pixel.
    np.testing.assert_array_equal(camera.unproject([[320.0, 240.0]]), [[0, 0, 1]])
    np.testing.assert_allclose(camera.project(7.5 * rays[seen]), pixels[seen], rtol=0, atol=1e-7)


@settings(max_examples=30, deadline=None)
@given(x=finite, y=finite, depth=st.floats(0.1, 100))
def test_jacobian_is_blind_along_the_ray(x: float, y: float, depth: float) -> None:
    camera = camera_with(DISTORTIONS["euroc"])
    point = np.array([[x * depth, y * depth, depth]])
    jacobian = camera.model.project_jacobian(point)
    np.testing.assert_allclose(jacobian @ point[0], 0, atol=1e-9 * np.abs(jacobian).max() * depth)
    numeric = project_jacobian_by_differences(camera, point / depth)[0]
    np.testing.assert_allclose(jacobian[0] * depth, numeric, rtol=0, atol=1e-3)


@pytest.mark.parametrize(
    ("change", "field", "words"),
    [
        ({"fx": -1.0}, "fx", "positive"),
        ({"fy": 0.0}, "fy", "positive"),
        ({"fx": math.nan}, "fx", "finite"),
        ({"cx": math.inf}, "cx", "finite"),
        ({"cy": "wide"}, "cy", "a number"),
        ({"distortion": (0.1, 0.2)}, "distortion", "0, 4, 5, 8, 12 or 14"),
        ({"distortion": (0.1, 1e13, 0, 0)}, "distortion k2", "up to 1e"),
        ({"distortion": (0.1, math.nan, 0, 0)}, "distortion k2", "finite"),
    ],
)
def test_parameters_out_of_range_are_named(change: dict, field: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        Pinhole(**(INTRINSICS | change))
    assert caught.value.field == field


def test_parameters_are_listed_in_opencvs_order() -> None:
    model = Pinhole(**INTRINSICS, distortion=DISTORTIONS["tum1"])
    assert list(model.parameters) == ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"]
    assert model.parameters["k3"] == 1.163314


def test_equal_parameters_make_equal_models() -> None:
    one = Pinhole(**INTRINSICS, distortion=np.array(DISTORTIONS["tum1"]))  # type: ignore[arg-type]
    assert one == Pinhole(**INTRINSICS, distortion=DISTORTIONS["tum1"])
    assert hash(one) == hash(Pinhole(**INTRINSICS, distortion=DISTORTIONS["tum1"]))
