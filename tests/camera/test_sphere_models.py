"""EUCM and double sphere: COLMAP, one camera described four times, derivatives, and the rim."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lens_checks import assert_jacobians_hold, pixel_grid, round_trip_px, whole_rows_are_nan

from farpoint.camera import Camera, DoubleSphere, ExtendedUnified, load_camera
from farpoint.errors import InputError

FOCAL = {"fx": 158.286, "fy": 158.274, "cx": 254.96, "cy": 256.89}
# TUM-VI's lens in Basalt's two descriptions; then one of each that folds, and one that does not.
LENSES = {
    "tumvi ds": DoubleSphere(**FOCAL, xi=-0.17213086, alpha=0.59311775),
    "tumvi eucm": ExtendedUnified(
        fx=190.9, fy=190.8, cx=254.96, cy=256.89, alpha=0.628, beta=1.034
    ),
    "narrow ds": DoubleSphere(**FOCAL, xi=0.3, alpha=0.4),
    "narrow eucm": ExtendedUnified(**FOCAL, alpha=0.3, beta=0.8),
    "parabolic ds": DoubleSphere(**FOCAL, xi=0.0, alpha=0.5),
    "folding eucm": ExtendedUnified(**FOCAL, alpha=0.9, beta=1.2),
}


@pytest.fixture(params=LENSES)
def camera(request: pytest.FixtureRequest) -> Camera:
    return Camera(model=LENSES[request.param], size=(512, 512))


def full_sphere(count: int) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("name", [name for name in LENSES if "eucm" in name])
def test_eucm_projects_as_colmap_does_half_a_pixel_away(name: str) -> None:
    lens = LENSES[name]
    fx, fy, cx, cy, alpha, beta = lens.parameters.values()
    params = [fx, fy, cx + 0.5, cy + 0.5, alpha, beta]
    peer = pycolmap.Camera(model="EUCM", width=512, height=512, params=params)
    points = full_sphere(2000)
    points = points[points[:, 2] > 0.05]
    expected = np.array([peer.img_from_cam(point) for point in points]).reshape(-1, 2) - 0.5
    np.testing.assert_allclose(lens.project(points), expected, rtol=0, atol=1e-8)


def test_double_sphere_contains_the_unified_model() -> None:
    """With xi = 0 both are Geyer's sphere: EUCM with beta = 1, which COLMAP has confirmed."""
    points = full_sphere(2000)
    one = DoubleSphere(**FOCAL, xi=0.0, alpha=0.6).project(points)
    two = ExtendedUnified(**FOCAL, alpha=0.6, beta=1.0).project(points)
    np.testing.assert_allclose(one, two, rtol=0, atol=1e-9)


def test_double_sphere_is_two_projections() -> None:
    """The paper's geometry by hand: unit sphere, shift xi, unit sphere, shift, pinhole."""
    lens = LENSES["tumvi ds"]
    assert isinstance(lens, DoubleSphere)
    points = full_sphere(2000)
    seen = np.isfinite(lens.project(points)[:, 0])
    first = points[seen] + [0, 0, lens.xi]
    second = first / np.linalg.norm(first, axis=1, keepdims=True)
    # The pinhole stands alpha / (1 - alpha) behind the second centre.
    second[:, 2] += lens.alpha / (1 - lens.alpha)
    plane = second[:, :2] / second[:, 2:] / (1 - lens.alpha)
    expected = plane * [lens.fx, lens.fy] + [lens.cx, lens.cy]
    np.testing.assert_allclose(lens.project(points[seen]), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["cam0", "cam1"])
def test_three_descriptions_of_one_camera_agree_to_a_pixel(shared_data: Path, name: str) -> None:
    """Basalt fitted a double sphere, an EUCM and a fisheye to one camera.

    Its fourth file, a pinhole without distortion, has another principal point and no common field.
    """
    pixels = pixel_grid((752, 480))
    one, two, three = (
        load_camera(shared_data / "calibrations" / f"gt_calib_{kind}.json", name)
        for kind in ("ds", "eucm", "kb4")
    )
    rays = one.unproject(pixels)
    in_common = np.rad2deg(np.arccos(rays[:, 2])) < 55
    assert in_common.mean() > 0.98
    for other in (two, three):
        error_px = np.linalg.norm(other.project(rays) - pixels, axis=1)[in_common]
        assert error_px.max() < 1.0


def test_two_descriptions_of_a_fisheye_agree_to_a_pixel(shared_data: Path) -> None:
    """TUM-VI's lens as Kalibr's fisheye, and as Basalt's two, where the image has a circle."""
    folder = shared_data / "calibrations"
    pixels = pixel_grid((512, 512))
    for name in ("cam0", "cam1"):
        rays = load_camera(folder / "kalibr_tumvi.yaml", name).unproject(pixels)
        in_circle = np.rad2deg(np.arccos(rays[:, 2])) < 85
        for kind in ("ds", "eucm"):
            other = load_camera(folder / f"basalt_tumvi_512_{kind}_calib.json", name)
            error_px = np.linalg.norm(other.project(rays) - pixels, axis=1)[in_circle]
            assert error_px.max() < 1.0


def test_round_trip_over_the_whole_image(camera: Camera) -> None:
    error_px, share_seen = round_trip_px(camera)
    assert error_px < 1e-8
    assert share_seen > 0.3


def test_jacobians_match_central_differences(camera: Camera) -> None:
    pixels = np.random.default_rng(1).uniform(5, 507, (400, 2))
    spread = np.linalg.norm(camera.unproject_jacobian(camera.unproject(pixels)), axis=(1, 2))
    # Near the rim of the field the ray moves ever faster, too fast for differences.
    away_from_rim = pixels[spread < 3 * np.nanmin(spread)]
    assert len(away_from_rim) > 100
    assert_jacobians_hold(camera, np.vstack([away_from_rim, [[254.96, 256.89]]]))


def test_height_increases_out_to_the_end_of_the_field(camera: Camera) -> None:
    """Seen is one cone around the axis; within it the height grows, at its end it stops."""
    theta = np.linspace(0, np.pi, 40001)
    rays = np.column_stack([np.sin(theta), np.zeros(len(theta)), np.cos(theta)])
    height = camera.project(rays)[:, 0]
    seen = np.isfinite(height)
    end = int(seen.sum())
    assert seen[:end].all()
    assert end < len(theta)
    assert np.all(np.diff(height[:end]) > 0)
    # Either it has stopped growing, or it grows without bound.
    slope = np.diff(height[end - 3 : end])
    first = np.diff(height[:2])[0]
    assert slope[-1] < 0.05 * first or slope[-1] > 1e3 * first
    np.testing.assert_allclose(
        camera.unproject(camera.project(rays[: end - 200])), rays[: end - 200], atol=1e-9
    )


def test_no_ray_where_nothing_is_imaged() -> None:
    lens = LENSES["folding eucm"]
    rim_px = 158.286 / np.sqrt(1.2 * (2 * 0.9 - 1))
    pixels = np.array([[254.96 + rim_px - 1e-6, 256.89], [254.96 + rim_px + 1e-6, 256.89]])
    assert np.isfinite(lens.unproject(pixels)[:, 0]).tolist() == [True, False]
    no_numbers = np.array([[np.nan, 1], [np.inf, 1], [1, -np.inf], [1e300, 1]])
    for lens in LENSES.values():
        assert np.isnan(lens.unproject(no_numbers)).all()
        assert np.isnan(lens.project(np.array([[0, 0, 0], [np.nan, 0, 1], [0, 0, -1]]))).all()


@pytest.mark.parametrize("name", ["tumvi ds", "tumvi eucm"])
def test_a_million_pixels_in_half_a_second(name: str) -> None:
    pixels = np.random.default_rng(6).uniform(0, 512, (1_000_000, 2))
    start = time.process_time()
    LENSES[name].unproject(pixels)
    assert time.process_time() - start < 0.5


@settings(max_examples=60, deadline=None)
@given(
    xi=st.floats(-0.95, 0.95),
    alpha=st.floats(0, 1),
    beta=st.floats(0.3, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_lens_comes_back_or_says_nan(xi: float, alpha: float, beta: float, seed: int) -> None:
    pixels = np.random.default_rng(seed).uniform(0, [512, 512], (100, 2))
    for lens in (
        DoubleSphere(**FOCAL, xi=xi, alpha=alpha),
        ExtendedUnified(**FOCAL, alpha=alpha, beta=beta),
    ):
        rays = lens.unproject(pixels)
        assert whole_rows_are_nan(rays)
        back = lens.project(rays)
        seen = np.isfinite(back[:, 0])
        np.testing.assert_allclose(back[seen], pixels[seen], rtol=0, atol=1e-7)
        # A ray that does not come back lies on the rim, where two rays share a pixel.
        assert np.sum(np.isfinite(rays[:, 0]) & ~seen) == 0


@pytest.mark.parametrize(
    ("model", "parameters", "field"),
    [
        (DoubleSphere, {"xi": 1.5, "alpha": 0.5}, "xi"),
        (DoubleSphere, {"xi": 0.5, "alpha": -0.1}, "alpha"),
        (ExtendedUnified, {"alpha": 1.1, "beta": 1}, "alpha"),
        (ExtendedUnified, {"alpha": 0.5, "beta": 0}, "beta"),
    ],
)
def test_parameters_out_of_range_are_named(model, parameters: dict, field: str) -> None:
    with pytest.raises(InputError, match="expected a") as caught:
        model(**FOCAL, **parameters)
    assert caught.value.field == field
