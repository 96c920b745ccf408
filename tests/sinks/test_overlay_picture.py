"""The picture: points in their colours and places, an ellipse that covers 95 %, legible sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from farpoint.camera import Camera, Equirectangular, KannalaBrandt
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.geometry.sphere import normalize, retract
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus, RelativePose, TrackLabel
from farpoint.sinks.overlay import draw_overlay
from farpoint.sinks.overlay.epipole import view_epipole
from farpoint.sinks.overlay.layout import Layout
from farpoint.sinks.overlay.palette import PALETTES, RED_GREEN, WHITE, Palette, PaletteName

MakeResult = Callable[..., OdometryResult]
SIZE = (640, 480)


def pose_of(result: OdometryResult) -> RelativePose:
    assert result.pose is not None
    return result.pose


def pane(picture: np.ndarray, index: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    return picture[Layout.of_image(*size).pane_slices(index)]


def near_pixel(pane_pixels: np.ndarray, pixel: np.ndarray, colour: tuple[int, int, int]) -> bool:
    """A pixel of this colour within 4 px."""
    x, y = np.rint(pixel).astype(int)
    window = pane_pixels[max(0, y - 4) : y + 5, max(0, x - 4) : x + 5].astype(int)
    return bool((np.abs(window - colour).max(axis=-1) < 60).any())  # thin lines are blended


def away_from_captions(points: np.ndarray) -> np.ndarray:
    return (points[:, 1] > 45) & (points[:, 1] < 435) & (points[:, 0] > 10) & (points[:, 0] < 630)


@pytest.mark.parametrize("palette", list(PALETTES))
def test_every_point_has_the_colour_of_its_label(
    camera: Camera, make_result: MakeResult, palette: PaletteName
) -> None:
    result, colours_of = make_result(3), PALETTES[palette]
    picture = draw_overlay(np.zeros((480, 640), np.uint8), result, camera, palette)
    assert picture.dtype == np.uint8
    labels, points1 = pose_of(result).labels, result.tracks.points1
    R = pose_of(result).rotation_cam1_from_cam0
    assert R is not None
    derotated = camera.project(camera.unproject(points1) @ R)
    colours = {
        TrackLabel.FAR: colours_of.far,
        TrackLabel.NEAR: colours_of.near,
        TrackLabel.OUTLIER: colours_of.outlier,
    }
    for index, places in ((0, points1), (1, derotated)):
        seen = away_from_captions(places)
        assert seen.sum() > 60
        for label, colour in colours.items():
            for place in places[seen & (labels == label)]:
                assert near_pixel(pane(picture, index), place, colour), (index, label, place)


def test_without_rotation_far_points_do_not_move(camera: Camera, make_result: MakeResult) -> None:
    result = make_result(3)
    R = pose_of(result).rotation_cam1_from_cam0
    assert R is not None
    far = pose_of(result).labels == TrackLabel.FAR
    derotated = camera.project(camera.unproject(result.tracks.points1) @ R)
    np.testing.assert_allclose(derotated[far], result.tracks.points0[far], atol=1e-3)
    assert np.abs(result.tracks.points1 - result.tracks.points0)[far].max() > 5.0


@pytest.mark.parametrize("heading", [(0.2, 0.05, 1.0), (-0.4, 0.2, 1.0)])
def test_flow_lines_meet_at_the_marked_epipole(
    camera: Camera, make_result: MakeResult, heading: tuple[float, float, float]
) -> None:
    result = make_result(3, heading=heading)
    view = view_epipole(pose_of(result), camera, SIZE)
    assert view is not None
    assert view.ahead_px is not None
    R = pose_of(result).rotation_cam1_from_cam0
    assert R is not None
    near = pose_of(result).labels == TrackLabel.NEAR
    tails = result.tracks.points0[near]
    flow = camera.project(camera.unproject(result.tracks.points1[near]) @ R) - tails
    normals = np.stack([-flow[:, 1], flow[:, 0]], axis=1)
    crossing, *_ = np.linalg.lstsq(normals, (normals * tails).sum(axis=1), rcond=None)
    np.testing.assert_allclose(view.ahead_px, crossing, atol=1e-6)
    picture = draw_overlay(None, result, camera)
    assert near_pixel(pane(picture, 1), view.ahead_px, WHITE)


@pytest.mark.parametrize("sigma_deg", [0.5, 4.0])
def test_the_ellipse_holds_95_percent_of_the_drawn_headings(
    camera: Camera, make_result: MakeResult, sigma_deg: float
) -> None:
    pose = pose_of(make_result(3, sigma_deg=sigma_deg))
    view = view_epipole(pose, camera, SIZE)
    assert view is not None
    R, t, basis = (
        pose.rotation_cam1_from_cam0,
        pose.direction_cam1_from_cam0,
        pose.direction_basis,
    )
    assert R is not None
    assert t is not None
    assert basis is not None
    assert pose.covariance is not None
    rng = np.random.default_rng(0)
    steps = rng.multivariate_normal(np.zeros(5), pose.covariance, size=6000)
    headings = [-(so3.exp(d[:3]) @ R).T @ retract(t, basis, d[3:]) for d in steps]
    pixels = camera.project(np.array(headings)).astype(np.float32)
    ring = view.ring_px.astype(np.float32)
    assert np.isfinite(ring).all()
    inside = [cv2.pointPolygonTest(ring, (float(x), float(y)), False) > 0 for x, y in pixels]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.012)
    picture = draw_overlay(None, make_result(3, sigma_deg=sigma_deg), camera)
    assert near_pixel(pane(picture, 1), view.ring_px[0], RED_GREEN.heading)


@pytest.mark.parametrize(
    ("heading", "corner"),
    [((1.0, 0.0, 0.1), (1, 0.5)), ((-1.0, 0.0, -0.2), (0, 0.5)), ((0.0, 1.0, 0.1), (0.5, 1))],
)
def test_an_epipole_outside_is_an_arrow_at_the_border(
    camera: Camera,
    make_result: MakeResult,
    heading: tuple[float, float, float],
    corner: tuple[float, float],
) -> None:
    result = make_result(3, heading=heading)
    view = view_epipole(pose_of(result), camera, SIZE)
    assert view is not None
    assert view.ahead_px is None
    drawn = pane(draw_overlay(None, result, camera), 1)
    rows, columns = np.nonzero((drawn == WHITE).all(axis=-1) & caption_mask(drawn))
    middle = np.array([columns.mean() / drawn.shape[1], rows.mean() / drawn.shape[0]])
    assert np.linalg.norm(middle - corner) < 0.12


def test_the_arrow_stays_in_the_pane_of_a_lens_that_looks_aside(make_result: MakeResult) -> None:
    aside = Camera.pinhole(640, 480, 500, 500, 60.0, 239.5)
    result = make_result(3, heading=(1.0, 0.0, -0.2), scene_camera=aside)
    drawn = pane(draw_overlay(None, result, aside), 1)
    _, columns = np.nonzero((drawn == WHITE).all(axis=-1) & caption_mask(drawn))
    assert columns.max() > 590


def caption_mask(drawn: np.ndarray) -> np.ndarray:
    mask = np.ones(drawn.shape[:2], bool)
    mask[:34] = False
    return mask


def test_backward_motion_marks_where_the_camera_comes_from(
    camera: Camera, make_result: MakeResult
) -> None:
    forward = view_epipole(pose_of(make_result(3, heading=(0.2, 0.05, 1.0))), camera, SIZE)
    backward = view_epipole(pose_of(make_result(3, heading=(-0.2, -0.05, -1.0))), camera, SIZE)
    assert forward is not None
    assert backward is not None
    assert forward.behind_px is None
    assert backward.ahead_px is None
    assert forward.ahead_px is not None
    np.testing.assert_allclose(backward.behind_px, forward.ahead_px)
    assert np.isfinite(backward.ring_px).all()
    centre = np.rint(forward.ahead_px).astype(int)
    upright, slanting = (
        pane(draw_overlay(None, make_result(3, heading=h, sigma_deg=0.05), camera), 1)
        for h in ((0.2, 0.05, 1.0), (-0.2, -0.05, -1.0))
    )
    tip = centre + np.array([12, 0])
    # The tips of the two crosses stand beyond the circle in different places.
    assert brightness(upright, tip) > 120
    assert brightness(slanting, tip) < 60


def brightness(pane_pixels: np.ndarray, pixel: np.ndarray) -> int:
    x, y = pixel
    return int(pane_pixels[y - 1 : y + 2, x - 1 : x + 2].max())


WIDE = {
    "a fisheye": Camera(
        model=KannalaBrandt(fx=190.0, fy=190.0, cx=255.5, cy=255.5, k1=0.0, k2=0.0, k3=0.0, k4=0.0),
        size=(512, 512),
    ),
    "all around": Camera(model=Equirectangular(width=640, height=320), size=(640, 320)),
}


@pytest.mark.parametrize("lens", list(WIDE))
def test_flow_follows_great_circles_from_the_epipole_to_its_antipode(
    make_result: MakeResult, lens: str
) -> None:
    camera = WIDE[lens]
    assert camera.size is not None
    result = make_result(3, heading=(1.0, 0.1, 0.4), scene_camera=camera)
    pose = pose_of(result)
    R, t = pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0
    assert R is not None
    assert t is not None
    # Everything twice as far away as the camera moves: long flow.
    close = camera.project(2.0 * camera.unproject(result.tracks.points0) @ R.T + t)
    result = replace(result, tracks=replace(result.tracks, points1=close))
    drawn = pane(draw_overlay(None, result, camera), 1, camera.size)
    scale = drawn.shape[1] / camera.size[0]
    near = pose.labels == TrackLabel.NEAR
    rays0 = camera.unproject(result.tracks.points0[near])
    rays1 = camera.unproject(result.tracks.points1[near]) @ R
    # Halfway along the arc, which lies off the chord where the lens bends it.
    middles = camera.project(normalize(rays0 + rays1))
    chords = (camera.project(rays0) + camera.project(rays1)) / 2.0
    bent = np.linalg.norm(middles - chords, axis=1) > 5.0 / scale
    free = middles[:, 1] > 50.0 / scale
    assert (bent & free).sum() >= 3
    for middle in middles[bent & free]:
        assert near_pixel(drawn, (middle + 0.5) * scale - 0.5, RED_GREEN.near)


def test_a_lens_that_looks_all_around_shows_both_ends_of_the_way(make_result: MakeResult) -> None:
    camera = WIDE["all around"]
    assert camera.size is not None
    result = make_result(3, heading=(1.0, 0.1, 0.4), scene_camera=camera, sigma_deg=3.0)
    view = view_epipole(pose_of(result), camera, camera.size)
    assert view is not None
    assert view.ahead_px is not None
    assert view.behind_px is not None
    np.testing.assert_allclose(
        camera.unproject(view.behind_px[None]), -camera.unproject(view.ahead_px[None]), atol=1e-9
    )
    drawn = pane(draw_overlay(None, result, camera), 1, camera.size)
    scale = drawn.shape[1] / camera.size[0]
    region = pose_of(result).heading_region(0.95)
    assert region is not None
    for end_px, ring in ((view.ahead_px, region), (view.behind_px, -region)):
        assert near_pixel(drawn, (end_px + 0.5) * scale - 0.5, WHITE)
        for pixel in camera.project(ring[::16]):
            assert near_pixel(drawn, (pixel + 0.5) * scale - 0.5, RED_GREEN.heading)


@pytest.mark.parametrize("status", list(PoseStatus))
@pytest.mark.parametrize("sigma_deg", [0.5, 60.0])
def test_every_status_draws_without_and_with_an_image(
    camera: Camera, make_result: MakeResult, status: PoseStatus, sigma_deg: float
) -> None:
    result = make_result(3, status, sigma_deg=sigma_deg)
    with_image = draw_overlay(np.full((480, 640), 90, np.uint8), result, camera)
    without = draw_overlay(None, result, camera)
    assert with_image.shape == without.shape
    assert not np.array_equal(pane(with_image, 0), pane(without, 0))
    np.testing.assert_array_equal(pane(with_image, 1), pane(without, 1))


def test_direction_is_never_drawn_where_it_is_not_known(
    camera: Camera, make_result: MakeResult
) -> None:
    for status in (PoseStatus.ROTATION_ONLY, PoseStatus.STATIC, PoseStatus.FAILED):
        drawn = pane(draw_overlay(None, make_result(3, status), camera), 1)
        assert not (drawn == RED_GREEN.heading).all(axis=-1).any()


@pytest.mark.parametrize("size", [(240, 180), (640, 480), (1241, 376), (1920, 1080), (480, 854)])
def test_layout_is_even_and_neither_tiny_nor_huge(size: tuple[int, int]) -> None:
    layout = Layout.of_image(*size)
    assert layout.width % 2 == layout.height % 2 == 0
    assert 960 <= layout.width <= 1920
    assert layout.pane[0] / layout.pane[1] == pytest.approx(size[0] / size[1], rel=0.01)
    # At 640 px wide on a phone the lines are still 15 px apart.
    assert layout.line_px * 640 / layout.width > 15


def test_an_image_of_another_size_is_fitted_and_the_picture_keeps_its_size(
    camera: Camera, make_result: MakeResult
) -> None:
    ours = draw_overlay(np.zeros((480, 640), np.uint8), make_result(2), camera)
    other = draw_overlay(np.zeros((100, 90, 3), np.uint8), make_result(2), camera)
    assert other.shape == ours.shape


def test_no_size_at_all_is_an_input_error(camera: Camera, make_result: MakeResult) -> None:
    with pytest.raises(InputError, match="image: expected an image"):
        draw_overlay(None, make_result(2), replace(camera, size=None))


def as_a_deuteranope_sees(colour: tuple[int, int, int]) -> np.ndarray:
    """Viénot, Brettel and Mollon, Color Res. Appl. 24(4), 1999, on linear light."""
    linear = (np.array(colour) / 255.0) ** 2.2
    lms = np.array([[17.8824, 43.5161, 4.11935], [3.45565, 27.1554, 3.86714], [0.03, 0.184, 1.467]])
    seen = lms @ linear
    seen[1] = 0.494207 * seen[0] + 1.24827 * seen[2]
    return 255.0 * np.clip(np.linalg.solve(lms, seen), 0.0, 1.0) ** (1 / 2.2)


def apart(palette: Palette) -> float:
    return float(
        np.abs(as_a_deuteranope_sees(palette.far) - as_a_deuteranope_sees(palette.near)).max()
    )


def test_the_alternative_colours_are_distinct_without_red_and_green() -> None:
    assert apart(PALETTES["orange-blue"]) > 120.0
    assert apart(PALETTES["orange-blue"]) > 1.5 * apart(RED_GREEN)


def test_a_palette_that_does_not_exist_is_an_input_error(
    camera: Camera, make_result: MakeResult
) -> None:
    with pytest.raises(InputError, match="palette: expected one of red-green, orange-blue"):
        draw_overlay(None, make_result(2), camera, "pink")  # type: ignore[arg-type]
