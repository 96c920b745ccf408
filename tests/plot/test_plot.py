"""What is drawn lies where geometry says; matplotlib is loaded on use."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest

import farpoint as fp
from farpoint.errors import InputError, MissingExtraError
from farpoint.synthetic import PointScene, PointSceneOptions, make_point_scene, paper_camera

mpl.use("Agg")
pyplot = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(autouse=True)
def closed_figures() -> Iterator[None]:
    yield
    pyplot.close("all")


@pytest.fixture(scope="module")
def scene() -> PointScene:
    options = PointSceneOptions(camera=paper_camera(), rotation_vector_rad=(0.02, 0.05, -0.03))
    return make_point_scene(options, seed=4)


@pytest.fixture(scope="module")
def pose(scene: PointScene) -> fp.RelativePose:
    pose = fp.estimate_relative_pose(scene.points0, scene.points1, scene.camera)
    assert pose.status is fp.PoseStatus.OK
    return pose


def without_direction(pose: fp.RelativePose) -> fp.RelativePose:
    return replace(
        pose,
        status=fp.PoseStatus.ROTATION_ONLY,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
    )


def drawn(ax, label: str) -> np.ndarray:
    """Points (N, 2) of the one line whose label begins so."""
    (line,) = [line for line in ax.lines if str(line.get_label()).startswith(label)]
    return np.column_stack(line.get_data())


def test_near_points_flow_away_from_the_epipole(scene: PointScene, pose: fp.RelativePose):
    ax = fp.plot.flow(pose, scene.points0, scene.points1, scene.camera)
    near = pose.labels == fp.TrackLabel.NEAR
    (x, y) = drawn(ax, "epipole")[0]
    heads = drawn(ax, "near")
    assert len(heads) == near.sum() > 10
    tails = scene.points0[near]
    long = np.linalg.norm(heads - tails, axis=1) > 5.0
    flow, away = (heads - tails)[long], (tails - (x, y))[long]
    cosine = np.sum(flow * away, 1) / np.linalg.norm(flow, axis=1) / np.linalg.norm(away, axis=1)
    assert np.sum(long) > 5
    assert np.quantile(np.abs(cosine), 0.1) > 0.95
    far = pose.labels == fp.TrackLabel.FAR
    assert np.median(np.linalg.norm(drawn(ax, "far") - scene.points0[far], axis=1)) < 1.0


def test_every_match_has_a_line_from_its_own_point(scene: PointScene, pose: fp.RelativePose):
    ax = fp.plot.flow(pose, scene.points0, scene.points1, scene.camera)
    broken = [np.column_stack(line.get_data()) for line in ax.lines if len(line.get_xdata()) > 2]
    starts = np.concatenate([line[::3] for line in broken if np.isnan(line[2]).all()])
    assert sorted(map(tuple, starts)) == sorted(map(tuple, scene.points0))


def test_without_a_direction_the_flow_is_drawn_and_says_so(
    scene: PointScene, pose: fp.RelativePose
):
    ax = fp.plot.flow(without_direction(pose), scene.points0, scene.points1, scene.camera)
    assert "ROTATION_ONLY" in ax.get_legend().get_title().get_text()
    assert len(drawn(ax, "near")) > 0


def test_the_epipole_is_the_pixel_of_the_heading_in_its_ellipse(
    scene: PointScene, pose: fp.RelativePose
):
    ax = fp.plot.epipole(pose, scene.camera)
    assert pose.heading_cam0 is not None
    pixel = scene.camera.project(pose.heading_cam0[None])[0]
    np.testing.assert_allclose(drawn(ax, "epipole")[0], pixel)
    ring = drawn(ax, "95 %")
    np.testing.assert_allclose(ring[0], ring[-1], atol=1e-9)
    assert np.all(ring.min(axis=0) < pixel)
    assert np.all(pixel < ring.max(axis=0))


def test_an_image_lies_behind_in_its_own_pixels(pose: fp.RelativePose):
    camera = paper_camera()
    assert camera.size is not None
    image = np.zeros(camera.size[::-1], np.uint8)
    ax = fp.plot.epipole(pose, camera, image=image)
    assert ax.images[0].get_array().shape == image.shape
    assert ax.get_xlim() == (-0.5, camera.size[0] - 0.5)
    assert ax.get_ylim() == (camera.size[1] - 0.5, -0.5)


def test_a_path_is_seen_from_above():
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3], poses[:, 2, 3] = np.arange(5), 7.0, 2.0 * np.arange(5)
    ax = fp.plot.trajectory(poses, label="mine")
    np.testing.assert_allclose(drawn(ax, "mine"), poses[:, [0, 2], 3])
    assert fp.plot.trajectory(poses, ax=ax) is ax


def test_results_are_a_path_too():
    results = list(fp.Odometry(paper_camera()).run([]))
    with pytest.raises(InputError, match="at least one"):
        fp.plot.trajectory(results)
    with pytest.raises(InputError, match="path: expected results"):
        fp.plot.trajectory([np.eye(4)])  # type: ignore[list-item]
    first = fp.Odometry(paper_camera()).process(None, 0.0, fault="none")
    ax = fp.plot.trajectory([first, first])
    assert ax.lines[0].get_xdata().tolist() == [0.0, 0.0]


def test_wrong_arguments_are_named(scene: PointScene, pose: fp.RelativePose):
    with pytest.raises(InputError, match=r"points1: expected shape"):
        fp.plot.flow(pose, scene.points0, scene.points1[:-1], scene.camera)
    with pytest.raises(InputError, match="pose: has no direction, its status is ROTATION_ONLY"):
        fp.plot.epipole(without_direction(pose), scene.camera)
    with pytest.raises(InputError, match="camera: knows no image size"):
        fp.plot.epipole(pose, replace(scene.camera, size=None))


def test_the_absence_of_matplotlib_names_the_extra(
    pose: fp.RelativePose, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(MissingExtraError, match=r"farpoint\[plot\]"):
        fp.plot.epipole(pose, paper_camera())


def test_matplotlib_is_loaded_by_the_first_picture():
    told = subprocess.run(
        [
            sys.executable,
            "-c",
            "import sys, farpoint; first = 'farpoint.plot' in sys.modules; farpoint.plot.flow; "
            "print(first, 'matplotlib' in sys.modules)",
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.split() == ["False", "False"]
