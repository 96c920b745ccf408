"""Unified, FOV, division, Scaramuzza and 360-degree models against COLMAP and their papers."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lens_checks import whole_rows_are_nan

from farpoint.camera import (
    Arctangent,
    CameraModel,
    Division,
    Equirectangular,
    ExtendedUnified,
    Scaramuzza,
    Unified,
)
from farpoint.errors import InputError

FOCAL = {"fx": 300.5, "fy": 298.5, "cx": 318.25, "cy": 241.75}
D5 = (-0.21, 0.06, 8e-4, -5e-4, -0.01)
OCAM = (-206.5, 0.0, 2.2e-3, -4.9e-6, 1.87e-8)


def sphere(count: int) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def front(count: int) -> np.ndarray:
    points = sphere(2 * count)
    return points[points[:, 2] > 0.05]


def colmap_pixels(model: str, params: list[float], points: np.ndarray) -> np.ndarray:
    """COLMAP's projection, in OpenCV's pixels."""
    peer = pycolmap.Camera(model=model, width=640, height=480, params=params)
    return np.array([peer.img_from_cam(point) for point in points]).reshape(-1, 2) - 0.5


@pytest.mark.parametrize("omega", [0.05, 0.5, 0.93, 2.5])
def test_arctangent_projects_as_colmap_does(omega: float) -> None:
    lens = Arctangent(**FOCAL, omega=omega)
    params = [FOCAL["fx"], FOCAL["fy"], FOCAL["cx"] + 0.5, FOCAL["cy"] + 0.5, omega]
    expected = colmap_pixels("FOV", params, front(500))
    np.testing.assert_allclose(lens.project(front(500)), expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize(("k", "points"), [(-0.24, sphere(500)), (0.02, front(500))])
def test_division_projects_as_colmap_does(k: float, points: np.ndarray) -> None:
    lens = Division(**FOCAL, k=k)
    params = [FOCAL["fx"], FOCAL["fy"], FOCAL["cx"] + 0.5, FOCAL["cy"] + 0.5, k]
    pixels = lens.project(points)
    seen = np.isfinite(pixels[:, 0]) & (points[:, 2] > -0.98)
    assert seen.sum() > 350
    np.testing.assert_allclose(
        pixels[seen], colmap_pixels("DIVISION", params, points[seen]), rtol=1e-9, atol=1e-8
    )


def test_equirectangular_projects_as_colmap_does() -> None:
    lens = Equirectangular(width=640, height=320)
    expected = colmap_pixels("EQUIRECTANGULAR", [640, 320], sphere(1000))
    np.testing.assert_allclose(lens.project(sphere(1000)), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("xi", [0.0, 0.6, 1.0, 2.2])
def test_unified_is_the_sphere_that_eucm_contains(xi: float) -> None:
    """EUCM with beta = 1, which COLMAP has confirmed, is the same with other names."""
    scaled = FOCAL | {"fx": FOCAL["fx"] / (1 + xi), "fy": FOCAL["fy"] / (1 + xi)}
    one = Unified(**FOCAL, xi=xi).project(sphere(2000))
    two = ExtendedUnified(**scaled, alpha=xi / (1 + xi), beta=1.0).project(sphere(2000))
    np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("xi", [0.7, 1.0, 2.2])
def test_unified_is_meis_five_steps(xi: float) -> None:
    """Sphere, shift, plane, distortion (by OpenCV), camera matrix with skew."""
    lens = Unified(**FOCAL, xi=xi, distortion=D5, skew=0.4)
    points = 3.0 * front(500)
    on_sphere = points / np.linalg.norm(points, axis=1, keepdims=True)
    shifted = on_sphere + np.array([0, 0, xi])
    zero = np.zeros(3)
    distorted = cv2.projectPoints(shifted, zero, zero, np.eye(3), np.array(D5))[0][:, 0]
    matrix = np.array([[FOCAL["fx"], 0.4], [0.0, FOCAL["fy"]]])
    expected = distorted @ matrix.T + [FOCAL["cx"], FOCAL["cy"]]
    np.testing.assert_allclose(lens.project(points), expected, rtol=0, atol=1e-9)


def test_three_names_of_the_parabolic_mirror() -> None:
    """Division with k = -1/4, the sphere with xi = 1 and a quadratic f are one lens."""
    one = {"fx": 200.0, "fy": 200.0, "cx": 320.0, "cy": 240.0}
    division = Division(**one, k=-0.25).project(sphere(1000))
    unified = Unified(**(one | {"fx": 400.0, "fy": 400.0}), xi=1.0).project(sphere(1000))
    polynomial = Scaramuzza(coefficients=(-200.0, 0.0, 0.25 / 200.0), cx=320, cy=240)
    np.testing.assert_allclose(division, unified, rtol=1e-9, atol=1e-8)
    # It is used for 50 focal lengths.
    near = np.linalg.norm(division - [320, 240], axis=1) < 49 * 200
    assert near.mean() > 0.99
    np.testing.assert_allclose(polynomial.project(sphere(1000))[near], division[near], atol=1e-7)


def test_scaramuzza_unprojects_as_the_toolbox_does() -> None:
    """``cam2world`` by hand, in the toolbox's axes: x down the rows, y along the columns."""
    c, d, e, row, column = 1.002, 3e-3, -2e-3, 241.75, 318.25
    lens = Scaramuzza(coefficients=OCAM, cx=column, cy=row, c=c, d=d, e=e)
    pixels = np.random.default_rng(3).uniform(0, [640, 480], (500, 2))
    sensor = np.linalg.solve(
        np.array([[c, d], [e, 1.0]]), np.stack([pixels[:, 1] - row, pixels[:, 0] - column])
    )
    depth = np.polynomial.polynomial.polyval(np.hypot(*sensor), OCAM)
    expected = np.column_stack([sensor[1], sensor[0], -depth])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(lens.unproject(pixels), expected, rtol=0, atol=1e-12)


def test_scaramuzza_projects_as_the_toolbox_does_but_for_its_fit() -> None:
    """``world2cam`` by hand, with an inverse polynomial fitted as the toolbox fits its own."""
    c, d, e, row, column = 1.002, 3e-3, -2e-3, 241.75, 318.25
    lens = Scaramuzza(coefficients=OCAM, cx=column, cy=row, c=c, d=d, e=e)
    radius = np.linspace(0, 380, 400)
    angle = np.arctan(np.polynomial.polynomial.polyval(radius, OCAM) / np.maximum(radius, 1e-9))
    inverse = np.polynomial.Polynomial.fit(angle, radius, 13)
    points = sphere(3000)
    pixels = lens.project(points)
    inside = np.linalg.norm(pixels - [column, row], axis=1) < 370
    assert inside.sum() > 1000
    x, y, z = points[inside, 1], points[inside, 0], -points[inside, 2]
    height = inverse(np.arctan(z / np.hypot(x, y))) / np.hypot(x, y)
    expected = np.column_stack(
        [y * height + e * x * height + column, c * x * height + d * y * height + row]
    )
    assert np.abs(pixels[inside] - expected).max() < 0.05


EDGES: list[tuple[CameraModel, float]] = [
    (Unified(**FOCAL, xi=2.0), 300.5 / math.sqrt(3)),
    (Arctangent(**FOCAL, omega=0.93), 300.5 * math.pi / 2 / 0.93),
    (Division(**FOCAL, k=0.11), 300.5 / math.sqrt(0.11)),
    (
        Scaramuzza(coefficients=(-200, 0, -1e-3), cx=FOCAL["cx"], cy=FOCAL["cy"]),
        200 / math.sqrt(0.2),
    ),
]


@pytest.mark.parametrize(("lens", "edge_px"), EDGES)
def test_where_the_field_ends(lens: CameraModel, edge_px: float) -> None:
    """The radius at which the angle stops growing, worked out by hand for each."""
    at = np.array([FOCAL["cx"], FOCAL["cy"]])
    steps = np.array([[edge_px - 1e-6, 0], [edge_px + 1e-6, 0], [edge_px * 3, 0]])
    rays = lens.unproject(at + steps)
    assert np.isfinite(rays[:, 0]).tolist() == [True, False, False]
    end_rad = math.acos(rays[0, 2])
    assert np.isfinite(lens.project(angled(end_rad - 1e-3))).all()
    assert np.isnan(lens.project(angled(end_rad + 1e-3))).all()


def angled(theta_rad: float) -> np.ndarray:
    return np.array([[math.sin(theta_rad), 0.0, math.cos(theta_rad)]])


def test_sphere_of_360_degrees_closes_upon_itself() -> None:
    lens = Equirectangular(width=640, height=320)
    corners = {
        (319.5, 159.5): (0, 0, 1),
        (479.5, 159.5): (1, 0, 0),
        (159.5, 159.5): (-1, 0, 0),
        (639.5, 159.5): (0, 0, -1),
        (319.5, -0.5): (0, -1, 0),
        (319.5, 319.5): (0, 1, 0),
    }
    np.testing.assert_allclose(
        lens.unproject(np.array(list(corners))), list(corners.values()), atol=1e-15
    )
    beyond = lens.unproject(np.array([[640.0 + 9.25, 50.0], [9.25, 50.0]]))
    np.testing.assert_allclose(beyond[0], beyond[1], rtol=0, atol=1e-14)
    assert np.isnan(lens.unproject(np.array([[10, -0.6], [10, 319.6]]))).all()


@settings(max_examples=40, deadline=None)
@given(
    xi=st.floats(0, 5),
    omega=st.floats(0.01, 3),
    k=st.floats(-2, 2),
    bends=st.lists(st.floats(-1, 1), min_size=3, max_size=3),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_lens_comes_back_or_says_nan(
    xi: float, omega: float, k: float, bends: list[float], seed: int
) -> None:
    pixels = np.random.default_rng(seed).uniform(0, [640, 480], (100, 2))
    coefficients = (-200.0, *(bend * 200.0 ** (1 - power) for power, bend in enumerate(bends, 1)))
    for lens in (
        Unified(**FOCAL, xi=xi),
        Unified(**FOCAL, xi=xi, distortion=(0.2 * k, 0.02 * k, 1e-3, -1e-3)),
        Arctangent(**FOCAL, omega=omega),
        Division(**FOCAL, k=k),
        Scaramuzza(coefficients=coefficients, cx=320, cy=240),
    ):
        rays = lens.unproject(pixels)
        assert whole_rows_are_nan(rays)
        seen = np.isfinite(rays[:, 0])
        back = lens.project(rays[seen])
        # A ray that does not come back lies on the rim, where two rays share a pixel.
        assert np.isnan(back[:, 0]).sum() <= 1
        found = np.isfinite(back[:, 0])
        np.testing.assert_allclose(back[found], pixels[seen][found], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("make", "field", "words"),
    [
        (lambda: Unified(**FOCAL, xi=-0.1), "xi", "from 0"),
        (lambda: Unified(**FOCAL, xi=1.0, skew=math.nan), "skew", "finite"),
        (lambda: Unified(**FOCAL, xi=1.0, distortion=(1, 2)), "distortion", "4"),
        (lambda: Arctangent(**FOCAL, omega=0.0), "omega", "from 1e-06"),
        (lambda: Arctangent(**FOCAL, omega=3.5), "omega", "from 1e-06"),
        (lambda: Division(**FOCAL, k=math.inf), "k", "finite"),
        (lambda: Scaramuzza(coefficients=(), cx=0, cy=0), "a0", "got none"),
        (lambda: Scaramuzza(coefficients=(200.0,), cx=0, cy=0), "a0", "negative"),
        (lambda: Scaramuzza(coefficients=(-2, math.nan), cx=0, cy=0), "a1", "finite"),
        (lambda: Scaramuzza(coefficients=(-2,), cx=0, cy=0, c=1, d=2, e=3), "c", "greater"),
        (lambda: Equirectangular(width=0, height=5), "width", "positive"),
    ],
)
def test_parameters_out_of_range_are_named(make, field: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert caught.value.field == field
