"""The recording that the viewer shows, read back: everything in its place, at its time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from farpoint.camera import Camera
from farpoint.errors import InputError, MissingExtraError
from farpoint.geometry import so3
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus, TrackLabel
from farpoint.sinks import LiveViewer, ViewerOptions, open_viewer
from farpoint.sinks.viewer import window
from farpoint.sinks.viewer.world import sparse_points

chunk = pytest.importorskip("rerun.chunk")

MakeResult = Callable[..., OdometryResult]
IMAGE = np.full((480, 640), 60, np.uint8)
STATUSES = [PoseStatus.OK] * 4 + [PoseStatus.ROTATION_ONLY, PoseStatus.FAILED]
HALF_PX = 0.5  # Rerun's pixels begin where ours have their middle


@pytest.fixture(scope="module")
def results(make_result: MakeResult) -> list[OdometryResult]:
    return [make_result(frame, status) for frame, status in enumerate(STATUSES)]


def recorded(path: Path, camera: Camera, results: list[OdometryResult]) -> Path:
    sink = open_viewer(ViewerOptions(rrd=path), "drive", camera)
    for result in results:
        sink.write(result, IMAGE)
    sink.close()
    return path


@pytest.fixture(scope="module")
def recording(
    tmp_path_factory: pytest.TempPathFactory, camera: Camera, results: list[OdometryResult]
) -> Path:
    return recorded(tmp_path_factory.mktemp("rrd") / "drive.rrd", camera, results)


def column(path: Path, entity: str, component: str) -> dict[int, Any]:
    """What an entity holds of a component, by frame."""
    values: dict[int, Any] = {}
    for part in chunk.RrdReader(path).stream():
        table = part.to_record_batch().to_pydict()
        if part.entity_path == f"/{entity}" and not part.is_static and component in table:
            rows = zip(table["frame"], table[component], strict=True)
            values.update((frame, value) for frame, value in rows if value is not None)
    return values


def test_tracks_stand_on_their_pixels(recording: Path, results: list[OdometryResult]):
    for label, name in zip(TrackLabel, ("outliers", "far", "near"), strict=True):
        strips = column(recording, f"image/{name}", "LineStrips2D:strips")
        for frame in (1, 2, 3, 4):
            result = results[frame]
            assert result.pose is not None
            chosen = result.pose.labels == label
            expected = np.stack([result.tracks.points0, result.tracks.points1], axis=1)[chosen]
            np.testing.assert_allclose(np.array(strips[frame]) - HALF_PX, expected, atol=1e-3)
        assert strips[0] == []


def test_near_flow_runs_along_lines_through_the_epipole(recording: Path):
    near = column(recording, "flow/near", "LineStrips2D:strips")
    marker = column(recording, "flow/epipole/at", "LineStrips2D:strips")
    far = column(recording, "flow/far", "LineStrips2D:strips")
    for frame in (1, 2, 3):
        epipole = np.mean(marker[frame][1], axis=0)  # an arm of the cross
        tails, heads = np.array(near[frame]).swapaxes(0, 1)
        flow, away = heads - tails, tails - epipole
        across = flow[:, 0] * away[:, 1] - flow[:, 1] * away[:, 0]
        off_px = np.abs(across) / np.linalg.norm(away, axis=1)
        assert off_px.max() < 0.05
        assert np.linalg.norm(flow, axis=1).max() > 5.0
        assert np.linalg.norm(np.diff(np.array(far[frame]), axis=1), axis=-1).max() < 0.05


def test_without_a_direction_there_is_no_epipole(recording: Path):
    for part in ("region", "at"):
        strips = column(recording, f"flow/epipole/{part}", "LineStrips2D:strips")
        assert [len(strips[frame]) > 0 for frame in range(6)] == [False] + [True] * 3 + [False] * 2


def test_curves_carry_their_bands(recording: Path, results: list[OdometryResult]):
    rotation = column(recording, "rotation", "Scalars:scalars")
    heading = column(recording, "heading", "Scalars:scalars")
    for frame in (1, 2, 3):
        pose = results[frame].pose
        assert pose is not None
        assert pose.rotation_cam1_from_cam0 is not None
        value, low, high = np.array(rotation[frame]).reshape(3, 3)
        expected = np.rad2deg(so3.log(pose.rotation_cam1_from_cam0)) / 0.1  # s between frames
        np.testing.assert_allclose(value, expected, rtol=1e-6)
        np.testing.assert_allclose(high - value, value - low, rtol=1e-9)
        assert pose.rotation_covariance is not None
        sigma = np.rad2deg(np.sqrt(np.diag(pose.rotation_covariance))) / 0.1
        np.testing.assert_allclose(high - value, sigma, rtol=0.1)
    assert np.isfinite(rotation[4]).all()
    assert np.isnan(heading[4]).all()
    assert np.isnan(rotation[5]).all()


def test_the_path_goes_step_by_step(recording: Path, results: list[OdometryResult]):
    steps = column(recording, "world/path", "LineStrips3D:strips")
    for frame in range(1, len(STATUSES)):
        ends = [results[k].world_from_cam[:3, 3] for k in (frame - 1, frame)]
        np.testing.assert_allclose(steps[frame][0], ends, atol=1e-6)


def test_the_ellipsoid_holds_the_position(
    tmp_path: Path, camera: Camera, results: list[OdometryResult]
):
    rng = np.random.default_rng(5)
    root = rng.normal(size=(3, 3)) * [0.1, 0.4, 0.02]
    covariance = np.eye(7)
    covariance[3:6, 3:6] = root @ root.T
    shown = [results[0], replace(results[1], world_covariance=covariance), results[2]]
    path = recorded(tmp_path / "a.rrd", camera, shown)
    drawn = {
        name: column(path, "world/position", f"Ellipsoids3D:{name}")
        for name in ("centers", "half_sizes", "quaternions")
    }
    assert [len(drawn["centers"][frame]) for frame in range(3)] == [0, 1, 0]
    turn = Rotation.from_quat(drawn["quaternions"][1][0]).as_matrix()
    draws = rng.normal(size=(20000, 3)) @ root.T  # off the estimate, by the covariance
    inside = np.linalg.norm(draws @ turn / drawn["half_sizes"][1][0], axis=1) < 1.0
    assert abs(inside.mean() - 0.95) < 0.006
    np.testing.assert_allclose(drawn["centers"][1][0], shown[1].world_from_cam[:3, 3], atol=1e-6)


def test_sparse_points_project_onto_their_tracks(camera: Camera, results: list[OdometryResult]):
    result = results[1]
    assert result.pose is not None
    points = sparse_points(result, camera)
    near = result.pose.labels == TrackLabel.NEAR
    assert near.sum() * 0.8 < len(points) <= near.sum()
    cam_from_world = np.linalg.inv(result.world_from_cam)
    pixels = camera.project(points @ cam_from_world[:3, :3].T + cam_from_world[:3, 3])
    gaps = np.linalg.norm(pixels[:, None] - result.tracks.points1[near], axis=-1)
    assert gaps.min(axis=1).max() < 1e-6
    assert len(sparse_points(results[4], camera)) == 0


def test_status_and_values_are_recorded(recording: Path):
    states = column(recording, "status", "StateChange:state")
    assert {frame: state[0] for frame, state in states.items()} == {
        1: "OK",
        4: "ROTATION_ONLY",
        5: "FAILED",
    }
    words = column(recording, "values", "TextDocument:text")
    assert words[3][0].startswith("**OK**, frames 2 to 3")


def test_the_layout_is_in_the_file(recording: Path):
    assert chunk.RrdReader(recording).blueprints()


def test_dates_are_dates_and_other_times_count_from_a_start(
    tmp_path: Path, camera: Camera, results: list[OdometryResult]
):
    dated = [replace(result, timestamp=1.7e9 + result.timestamp) for result in results[:2]]
    for name, shown, kind in (("a", results[:2], "duration"), ("b", dated, "timestamp")):
        path = recorded(tmp_path / f"{name}.rrd", camera, shown)
        parts = [part for part in chunk.RrdReader(path).stream() if not part.is_static]
        types = {str(part.to_record_batch().schema.field("time").type) for part in parts}
        assert types == {f"{kind}[ns]"}


def test_frames_without_an_image_keep_their_place(
    tmp_path: Path, camera: Camera, results: list[OdometryResult]
):
    sink = open_viewer(ViewerOptions(rrd=tmp_path / "a.rrd"), "drive", camera)
    for index, result in enumerate(results[:3]):
        sink.write(result, None if index == 1 else IMAGE)
    sink.close()
    assert set(column(tmp_path / "a.rrd", "image", "EncodedImage:blob")) == {0, 2}
    assert 1 in column(tmp_path / "a.rrd", "image", "Clear:is_recursive")


def test_a_live_display_that_is_behind_leaves_frames_out(
    tmp_path: Path, camera: Camera, results: list[OdometryResult]
):
    display = LiveViewer(ViewerOptions(rrd=tmp_path / "a.rrd"), "drive", camera)
    shown = [replace(results[1], frame1=frame) for frame in range(60)]
    for result in shown:
        display.write(result, IMAGE)
    display.close()
    drawn = column(tmp_path / "a.rrd", "image", "EncodedImage:blob")
    assert 0 < display.left_out == 60 - len(drawn)


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path, camera: Camera):
    with pytest.raises(InputError, match=r"missing.a\.rrd: cannot be written"):
        open_viewer(ViewerOptions(rrd=tmp_path / "missing" / "a.rrd"), "drive", camera)


def test_the_absence_of_rerun_names_the_extra(
    tmp_path: Path, camera: Camera, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"farpoint\[rerun\]"):
        open_viewer(ViewerOptions(rrd=tmp_path / "a.rrd"), "drive", camera)


def test_the_window_is_for_this_machine_alone_and_sends_no_statistics(
    monkeypatch: pytest.MonkeyPatch,
):
    """The command that opens it, with a stand-in for the viewer that only listens."""
    started: dict[str, Any] = {}
    popen = subprocess.Popen
    listen = "import socket, sys, time; s = socket.create_server(('127.0.0.1', int(sys.argv[1])));"

    def instead(command: list[str], **options: Any) -> subprocess.Popen[bytes]:
        started.update(command=command, environment=options["env"])
        port = command[command.index("--port") + 1]
        started["process"] = popen([sys.executable, "-c", f"{listen} time.sleep(60)", port])
        return started["process"]

    monkeypatch.setattr(window.subprocess, "Popen", instead)
    url = window.open_window()
    try:
        command = started["command"]
        port = command[command.index("--port") + 1]
        assert url == f"rerun+http://127.0.0.1:{port}/proxy"
        assert command[command.index("--bind") + 1] == "127.0.0.1"
        assert started["environment"]["CI"] == "true"  # the viewer's own word for no statistics
    finally:
        started["process"].kill()
        started["process"].wait()


def test_a_window_that_does_not_open_says_what_to_do(monkeypatch: pytest.MonkeyPatch):
    popen = subprocess.Popen
    fails = [sys.executable, "-c", "raise SystemExit(1)"]
    monkeypatch.setattr(window.subprocess, "Popen", lambda *_, **__: popen(fails))
    with pytest.raises(InputError, match=r"--show: .* --rrd FILE records instead"):
        window.open_window()


def test_rerun_is_loaded_only_where_it_is_used():
    asked = "import sys, farpoint.cli; print('rerun' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "False"
