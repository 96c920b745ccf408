"""Windows on planes that come nearer: what perspective does to matches, and its correction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tracks_textures import Waves, photo, refine

from farpoint.camera import Camera
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.path.perspective import without_perspective
from farpoint.tracks import CornerOptions, RefinementOptions, Tracks
from farpoint.tracks.corners import find_corners
from farpoint.tracks.tracks import Windows

SIZE = 280, 200
PINHOLE = Camera.pinhole(*SIZE, 220.0, 220.0, 140.0, 100.0)
FISHEYE = Camera(model=KannalaBrandt(fx=110.0, fy=110.0, cx=140.0, cy=100.0), size=SIZE)
TURN = np.array([[np.cos(0.01), 0, np.sin(0.01)], [0, 1, 0], [-np.sin(0.01), 0, np.cos(0.01)]])


def plane_drive(camera: Camera, normal, translation, seed: int):
    """Tracks on the plane ``normal . X = 1`` seen before and after the motion, and their truth."""
    scene = Waves(seed, SIZE[::-1])
    homography = TURN + np.outer(translation, normal)

    def updated(pixels, matrix):
        return camera.project(camera.unproject(pixels) @ matrix.T)

    grid = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=2).reshape(-1, 2)
    back = updated(grid / 1.0, np.linalg.inv(homography))
    rng = np.random.default_rng(seed)
    image0 = photo(scene.grey(), 1.0, rng)
    image1 = photo(np.nan_to_num(scene.at(back)).reshape(SIZE[::-1]), 1.0, rng)
    corners = find_corners(image0, np.empty((0, 2)), 150, 16, CornerOptions())
    points0 = corners + rng.uniform(-0.5, 0.5, corners.shape)
    truth = updated(points0, homography)
    options = RefinementOptions(max_iterations=30, tolerance_px=1e-3)
    points1, covariance_px2, found, windows = refine(image0, image1, points0, truth, options)
    tracks = Tracks(
        ids=np.arange(len(points0)),
        points0=points0,
        points1=points1,
        covariance_px2=covariance_px2,
        windows=windows,
    )
    return tracks.select(found), truth[found]


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
@pytest.mark.parametrize("normal", [(0.1, 0.8, 0.5), (0.6, 0.3, 0.6)], ids=["road", "wall"])
def test_what_is_taken_back_is_what_was_wrong(camera, normal):
    translation = np.array([0.01, 0.02, -0.2])
    direction = translation / np.linalg.norm(translation)
    wrong, shift = [], []
    for seed in range(5):
        tracks, truth = plane_drive(camera, np.array(normal), translation, seed)
        corrected = without_perspective(tracks, camera, TURN, direction)
        sigma = np.sqrt(0.5 * np.trace(tracks.covariance_px2, axis1=1, axis2=2))[:, None]
        wrong.append((tracks.points1 - truth) / sigma)
        shift.append((tracks.points1 - corrected.points1) / sigma)
    wrong, shift = np.concatenate(wrong).ravel(), np.concatenate(shift).ravel()
    slope, sigma = shift @ wrong / (shift @ shift), 1 / np.sqrt(shift @ shift)
    assert sigma < 0.08
    assert slope == pytest.approx(1.0, abs=0.25)


def test_matches_on_a_road_have_no_common_bias():
    normal, translation = np.array([0.1, 0.8, 0.5]), np.array([0.01, 0.02, -0.2])
    before, after = np.zeros(2), np.zeros(2)
    for seed in range(5):
        tracks, truth = plane_drive(PINHOLE, normal, translation, seed)
        corrected = without_perspective(
            tracks, PINHOLE, TURN, translation / np.linalg.norm(translation)
        )
        weights = 1 / np.trace(tracks.covariance_px2, axis1=1, axis2=2)
        before += np.average(tracks.points1 - truth, axis=0, weights=weights) / 5
        after += np.average(corrected.points1 - truth, axis=0, weights=weights) / 5
    assert np.linalg.norm(before) > 0.01
    assert np.linalg.norm(after) < 0.4 * np.linalg.norm(before)


def test_a_camera_that_only_turned_has_no_planes():
    tracks, _ = plane_drive(PINHOLE, np.zeros(3), np.zeros(3), 0)
    corrected = without_perspective(tracks, PINHOLE, TURN, None)
    assert corrected.windows is None
    assert without_perspective(corrected, PINHOLE, TURN, None) is corrected
    # What the turn itself bends is known exactly, and little.
    assert 0 < np.abs(corrected.points1 - tracks.points1).max() < 0.005


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=["pinhole", "fisheye"])
def test_a_window_that_no_plane_explains_is_doubted(camera):
    translation = np.array([0.01, 0.02, -0.2])
    tracks, _ = plane_drive(camera, np.array([0.1, 0.8, 0.5]), translation, 0)
    assert tracks.windows is not None
    direction = translation / np.linalg.norm(translation)
    # Along the flow, by which planes of any slope change a window, and across it.
    still = camera.project(camera.unproject(tracks.points0) @ TURN.T)
    along = tracks.points1 - still
    along /= np.linalg.norm(along, axis=1)[:, None]
    across = along[:, ::-1] * [-1.0, 1.0]

    def misfit_px2(change: np.ndarray) -> np.ndarray:
        warps = tracks.windows.warps + change[:, :, None] * np.array([0.6, 0.8])
        windows = replace(tracks.windows, warps=warps)
        judged = without_perspective(replace(tracks, windows=windows), camera, TURN, direction)
        extra = judged.covariance_px2 - tracks.covariance_px2
        np.testing.assert_allclose(extra, extra[:, :1, :1] * np.eye(2), atol=1e-12)
        return extra[:, 0, 0]

    plain = misfit_px2(0.0 * along)
    assert (plain > 0).all()
    assert np.median(plain) < 0.03**2
    np.testing.assert_allclose(np.median(misfit_px2(0.1 * along)), np.median(plain), rtol=0.1)
    assert np.median(misfit_px2(0.1 * across)) == pytest.approx((1.2 * 0.1) ** 2, rel=0.2)


@pytest.mark.parametrize(
    ("camera", "place"),
    [
        (
            Camera(model=KannalaBrandt(fx=60.0, fy=60.0, cx=140.0, cy=100.0), size=SIZE),
            (-90.0, 0.0),
        ),
        (Camera(model=Equirectangular(width=280, height=140), size=(280, 140)), (100.0, -0.5)),
    ],
    ids=["outside the field", "pole"],
)
def test_a_window_where_the_lens_has_no_derivatives_stays(camera, place):
    points = np.array([(150.0, 90.0), place])
    tracks = Tracks(
        ids=np.arange(2),
        points0=points,
        points1=points + 1.0,
        covariance_px2=np.tile(np.eye(2), (2, 1, 1)),
        windows=Windows(
            warps=np.tile(1.05 * np.eye(2), (2, 1, 1)), quadratic_bias=np.ones((2, 2, 2, 3))
        ),
    )
    corrected = without_perspective(tracks, camera, np.eye(3), np.array([0.0, 0.0, 1.0]))
    assert np.isfinite(corrected.points1).all()
    assert np.abs(corrected.points1 - tracks.points1).max() < 0.2
