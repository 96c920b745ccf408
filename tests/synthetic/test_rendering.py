"""Rendered images show the scene where it is: rays, fine sampling and real tracks agree."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from farpoint.camera import Camera
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.synthetic import (
    ImagingOptions,
    RenderedSequence,
    pure_rotation,
    sideways,
    standing_still,
    street_drive,
)
from farpoint.trajectory.files import Trajectory

CLEAN = ImagingOptions(noise_grey=0.0)
WINDOW = 21


def pinhole(scale: int = 1, width: int = 400, height: int = 300) -> Camera:
    """The same field of view whatever the size, on ``scale`` times as many pixels."""
    focal, shift = 0.8 * width * scale, 0.5 * (scale - 1)
    cx, cy = 0.5 * (width - 1) * scale + shift, 0.5 * (height - 1) * scale + shift
    return Camera.pinhole(width * scale, height * scale, focal, focal, cx, cy)


def image(sequence: RenderedSequence, index: int = 0) -> np.ndarray:
    frame = sequence.view(index).frame
    assert frame.image is not None
    return frame.image


def one_surface(depth: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Whether all of the window around each pixel has nearly one depth: no silhouette in it."""
    finite = np.where(np.isfinite(depth), depth, 1e5)
    kernel = np.ones((WINDOW + 4, WINDOW + 4), np.uint8)
    spread = cv2.dilate(finite, kernel) / cv2.erode(finite, kernel)
    column, row = np.rint(pixels).astype(int).T
    return spread[row, column] < 1.15


def track_errors(sequence: RenderedSequence, index0: int, index1: int) -> np.ndarray:
    """What OpenCV's Lucas-Kanade gets wrong, px (N, 2), at corners on one surface."""
    view0, image1 = sequence.view(index0), image(sequence, index1)
    assert view0.frame.image is not None
    corners = cv2.goodFeaturesToTrack(view0.frame.image, 1000, 0.01, 7)
    points0 = corners.reshape(-1, 2).astype(np.float64)
    truth = sequence.transfer(points0, index0, index1)
    good = np.isfinite(truth).all(axis=1) & one_surface(view0.depth, points0)
    points0, truth = points0[good], truth[good]
    start = truth + np.random.default_rng(0).normal(0.0, 0.5, truth.shape)
    tracked, status, _ = cv2.calcOpticalFlowPyrLK(
        view0.frame.image,
        image1,
        points0.astype(np.float32),
        start.astype(np.float32),
        winSize=(WINDOW, WINDOW),
        maxLevel=2,
        criteria=(3, 40, 1e-3),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    return (tracked.reshape(-1, 2) - truth)[status.ravel() > 0]


# Lucas-Kanade itself errs by up to 0.02 px, in a wave over the fraction of a pixel by which things
# move (bilinear interpolation): steps of many sizes average that out, an error of ours would stay.
@pytest.mark.parametrize(
    "path",
    [sideways(7, speed_m_s=0.35), pure_rotation(7, rate_deg_s=4.0)],
    ids=["translation", "rotation"],
)
def test_tracks_between_rendered_frames_lie_on_their_truth(path):
    sequence = RenderedSequence(pinhole(), path, imaging=CLEAN)
    errors = np.concatenate([track_errors(sequence, 0, index) for index in range(1, 7)])
    assert len(errors) > 500
    assert np.median(np.linalg.norm(errors, axis=1)) < 0.05
    assert np.abs(errors.mean(axis=0)).max() < 0.01


def test_an_image_is_what_fine_sampling_of_the_scene_gives():
    path = street_drive(60, seed=3)
    coarse = RenderedSequence(pinhole(1, 240, 180), path, imaging=CLEAN)
    fine = RenderedSequence(pinhole(4, 240, 180), path, imaging=CLEAN)
    differences, aliased = [], []
    for index in (0, 40):
        samples = image(fine, index).astype(np.float32)
        # The renderer's own filter: sigma of about half a pixel.
        blurred = cv2.GaussianBlur(samples, (0, 0), 2.0).reshape(180, 4, 240, 4)
        expected = blurred[:, 1:3, :, 1:3].mean(axis=(1, 3))
        differences.append(image(coarse, index) - expected)
        aliased.append(samples[1::4, 1::4] - expected)
    # One sample per pixel, which is what aliasing is, lies several times farther off.
    assert np.std(differences) < 2.5
    assert np.std(aliased) > 3.5 * np.std(differences)
    assert abs(np.mean(differences)) < 0.05


def test_depth_is_the_distance_along_the_ray():
    sequence = RenderedSequence(pinhole(1, 160, 120), street_drive(30, seed=2), seed=2)
    view = sequence.view(17)
    columns, rows = np.meshgrid(np.arange(160.0), np.arange(120.0))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1)
    np.testing.assert_allclose(view.depth.ravel(), sequence.distances(17, pixels), rtol=1e-9)
    pose = sequence.world_from_cam[17]
    down = (sequence.camera.unproject(pixels) @ pose[:3, :3].T)[:, 1]
    with np.errstate(divide="ignore"):
        ground = np.where(down > 0.0, -pose[1, 3] / down, np.inf)
    assert (view.depth.ravel() <= ground * (1 + 1e-12)).all()
    on_ground = np.isclose(view.depth.ravel(), ground, rtol=1e-12) & (down > 0.0)
    assert on_ground[pixels[:, 1] > 110].mean() > 0.5
    assert np.isinf(view.depth[:10]).any()  # sky
    far = (view.depth > 100) & np.isfinite(view.depth)
    assert far.any()
    assert (view.depth < 10).any()


def test_transfer_goes_there_and_back():
    sequence = RenderedSequence(pinhole(), street_drive(30, seed=4), seed=4)
    points0 = np.random.default_rng(1).uniform((0, 0), (399, 299), (3000, 2))
    points1 = sequence.transfer(points0, 5, 8)
    seen = np.isfinite(points1).all(axis=1)
    assert 0.5 < seen.mean() < 1.0
    back = sequence.transfer(points1[seen], 8, 5)
    again = np.isfinite(back).all(axis=1)
    assert again.mean() > 0.99  # rounding decides at silhouettes
    np.testing.assert_allclose(back[again], points0[seen][again], atol=1e-6)
    sky = np.isinf(sequence.distances(5, points0)) & seen
    turned = sequence.camera.unproject(points0[sky]) @ sequence.cam1_from_cam0(5, 8)[:3, :3].T
    np.testing.assert_allclose(points1[sky], sequence.camera.project(turned), atol=1e-9)


def values_at(grey: np.ndarray, points: np.ndarray) -> np.ndarray:
    return cv2.remap(grey, points[:, None].astype(np.float32), None, cv2.INTER_LINEAR)


def test_transferred_points_have_similar_windows():
    sequence = RenderedSequence(pinhole(), street_drive(30, seed=4), seed=4, imaging=CLEAN)
    points0 = np.random.default_rng(1).uniform((10, 10), (389, 289), (2000, 2))
    points1 = sequence.transfer(points0, 5, 7)
    seen = np.isfinite(points1).all(axis=1)
    greys = [
        values_at(image(sequence, index), points[seen])
        for index, points in ((5, points0), (7, points1))
    ]
    first, second = (grey.ravel().astype(float) for grey in greys)
    assert np.corrcoef(first, second)[0, 1] > 0.98
    assert np.median(np.abs(first - second)) < 2.5


@pytest.mark.parametrize(
    "camera",
    [
        Camera(model=KannalaBrandt(fx=90, fy=90, cx=159.5, cy=119.5, k1=0.02), size=(320, 240)),
        Camera(model=Equirectangular(width=480, height=240), size=(480, 240)),
    ],
    ids=["fisheye", "360"],
)
def test_another_lens_at_the_same_place_sees_the_same(camera):
    path = street_drive(10, seed=6)
    other = RenderedSequence(camera, path, imaging=CLEAN)
    straight = RenderedSequence(pinhole(1, 200, 150), path, imaging=CLEAN)
    points = np.random.default_rng(2).uniform((10, 10), (189, 139), (2000, 2))
    rays = straight.camera.unproject(points)
    # The fisheye is coarser by three: compare what both can resolve.
    blurred = cv2.GaussianBlur(image(straight), (0, 0), 1.8)
    expected = values_at(blurred, points)
    found = values_at(image(other), camera.project(rays))
    assert np.corrcoef(expected.ravel(), found.ravel())[0, 1] > 0.97
    np.testing.assert_allclose(
        other.distances(0, camera.project(rays)), straight.distances(0, points), rtol=1e-6
    )


def test_pixels_without_a_ray_are_black():
    # The height of this fisheye stops growing at 71 degrees, about 139 px from the centre.
    lens = KannalaBrandt(fx=170, fy=170, cx=159.5, cy=119.5, k1=-0.2169)
    sequence = RenderedSequence(Camera(model=lens, size=(320, 240)), standing_still(1))
    view = sequence.view(0)
    assert view.frame.image is not None
    radius = np.hypot(*np.meshgrid(np.arange(320) - 159.5, np.arange(240) - 119.5))
    assert np.isnan(view.depth[radius > 142]).all()
    assert not np.isnan(view.depth[radius < 136]).any()
    assert (view.frame.image[np.isnan(view.depth)] == 0).all()


def test_any_path_above_ground_can_be_rendered_even_through_houses():
    poses = np.tile(np.eye(4), (40, 1, 1))
    poses[:, :3, 3] = np.stack(
        [np.linspace(0.0, 60.0, 40), np.linspace(-1.0, -30.0, 40), np.linspace(0.0, 33.0, 40)], 1
    )
    path = Trajectory(timestamps=np.arange(40.0), world_from_body=poses)
    sequence = RenderedSequence(pinhole(1, 160, 120), path)
    for index in (0, 13, 39):
        depth = sequence.view(index).depth
        assert np.nanmin(depth) > 0.5
        assert np.isfinite(depth).mean() > 0.2


def test_noise_and_exposure_are_what_was_asked_for():
    path = standing_still(40, fps=5.0)
    camera = pinhole(1, 80, 60)
    clean = image(RenderedSequence(camera, path, imaging=CLEAN)).astype(float)
    noisy = image(RenderedSequence(camera, path, imaging=ImagingOptions(noise_grey=3.0)))
    between = (clean > 15) & (clean < 240)
    assert np.std((noisy - clean)[between]) == pytest.approx(np.hypot(3.0, 0.41), rel=0.05)
    swinging = RenderedSequence(
        camera, path, imaging=ImagingOptions(noise_grey=0.0, exposure_swing=0.2)
    )
    gains = [image(swinging, index)[between].mean() / clean[between].mean() for index in range(40)]
    assert 1.1 < max(gains) <= 1.2
    assert 0.8 <= min(gains) < 0.9


def test_the_same_seed_gives_the_same_frames_whatever_was_rendered_before():
    path = street_drive(6, seed=1)
    camera = pinhole(1, 160, 120)
    frames = list(RenderedSequence(camera, path, seed=1))
    alone = image(RenderedSequence(camera, path, seed=1), 4)
    other = image(RenderedSequence(camera, path, seed=2), 4)
    assert frames[4].image is not None
    assert frames[4].image.tobytes() == alone.tobytes()
    assert np.mean(alone != other) > 0.5
