"""Truth as people have it: of another body, in another order, from another program."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_kit import CAMERA, CommandLine, assert_refused, quick_run
from scipy.spatial.transform import Rotation

from farpoint.camera.files.extrinsics import read_body_from_cam
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.metrics.other_frame import fits_better, other_frame
from farpoint.synthetic.sequence import RenderedSequence, render_drive
from farpoint.trajectory.files import Trajectory, read_trajectory, write_tum

BODY_FROM_CAM = np.eye(4)
BODY_FROM_CAM[:3, :3] = Rotation.from_euler("xyz", [-90, 0, -90], degrees=True).as_matrix()
BODY_FROM_CAM[:3, 3] = 0.1, -0.2, 0.3


@pytest.fixture(scope="module")
def long_drive() -> RenderedSequence:
    return render_drive(CAMERA, frames=24, seed=8)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, long_drive: RenderedSequence) -> Path:
    place = tmp_path_factory.mktemp("run")
    return quick_run(place, [frame.image for frame in long_drive])


def write(path: Path, world_from_body: np.ndarray, order: str = "xyzw") -> Path:
    times = np.arange(len(world_from_body)) / 10
    write_tum(path, Trajectory(timestamps=times, world_from_body=world_from_body))
    if order == "wxyz":
        rows = [line.split() for line in path.read_text().splitlines()]
        path.write_text("".join(f"{' '.join([*r[:4], r[7], *r[4:7]])}\n" for r in rows))
    return path


def test_assumptions_are_printed_and_correct_truth_gets_no_warning(
    run: Path, tmp_path: Path, long_drive: RenderedSequence, farpoint: CommandLine
):
    said = farpoint(
        "evaluate", run, "--truth", write(tmp_path / "t.tum", long_drive.world_from_cam)
    )
    assert said.code == 0
    assert "true poses are taken for those of the camera, world_from_body" in said.out
    assert "true quaternions are in the order of the format (assumed)" in said.out
    assert "hint" not in said.out


def test_truth_of_a_body_gives_a_warning_and_can_be_specified(
    run: Path, tmp_path: Path, long_drive: RenderedSequence, farpoint: CommandLine
):
    body = long_drive.world_from_cam @ np.linalg.inv(BODY_FROM_CAM)
    truth = write(tmp_path / "body.tum", body)
    said = farpoint("evaluate", run, "--truth", truth)
    assert "hint: relative rotations agree only after a constant rotation" in said.out
    place = tmp_path / "sensor.yaml"
    place.write_text(f"T_BS:\n  rows: 4\n  cols: 4\n  data: {BODY_FROM_CAM.ravel().tolist()}\n")
    told = farpoint("evaluate", run, "--truth", truth, "--body-from-camera", place)
    assert "hint" not in told.out
    assert "a body that carries the camera" in told.out
    right = farpoint(
        "evaluate", run, "--truth", write(tmp_path / "c.tum", long_drive.world_from_cam)
    )
    table = [line for line in right.out.splitlines() if line.startswith("rotation")]
    assert table
    assert table == [line for line in told.out.splitlines() if line.startswith("rotation")]


def test_inverse_poses_and_another_order_are_hinted_at(
    run: Path, tmp_path: Path, long_drive: RenderedSequence, farpoint: CommandLine
):
    inverse = write(tmp_path / "inverse.tum", np.linalg.inv(long_drive.world_from_cam))
    assert (
        "hint: the inverse poses, cam_from_world"
        in farpoint("evaluate", run, "--truth", inverse).out
    )
    swapped = write(tmp_path / "swapped.tum", long_drive.world_from_cam, "wxyz")
    said = farpoint("evaluate", run, "--truth", swapped)
    assert "hint: quaternions in the order wxyz agree far better with the run" in said.out
    told = farpoint("evaluate", run, "--truth", swapped, "--truth-quaternion", "wxyz")
    assert "hint" not in told.out
    assert "true quaternions are w x y z (as given)" in told.out


@pytest.mark.parametrize(
    "header", ["# time x y z qw qx qy qz", "timestamp tx ty tz q_w q_x q_y q_z"]
)
def test_names_of_columns_tell_the_order(tmp_path: Path, long_drive: RenderedSequence, header: str):
    path = write(tmp_path / "t.tum", long_drive.world_from_cam, "wxyz")
    path.write_text(f"{header}\n{path.read_text()}")
    np.testing.assert_allclose(
        read_trajectory(path).world_from_body, long_drive.world_from_cam, atol=1e-9
    )


@pytest.mark.parametrize(
    "header", ["qw qx qy qz timestamp tx ty tz", "# time qx qy qz qw x y z", "t x y z qw qz qy qx"]
)
def test_names_of_columns_in_another_place_are_no_quaternion(tmp_path: Path, header: str):
    still = np.tile(np.eye(4), (3, 1, 1))  # by its numbers, 0 0 0 0 0 0 1 are of any order
    path = write(tmp_path / "t.tum", still)
    path.write_text(f"{header}\n{path.read_text()}")
    with pytest.raises(InputError, match="by its names qw is column"):
        read_trajectory(path)


def test_a_place_on_the_body_the_other_way_round_is_hinted_at(
    run: Path, tmp_path: Path, long_drive: RenderedSequence, farpoint: CommandLine
):
    truth = write(tmp_path / "body.tum", long_drive.world_from_cam @ np.linalg.inv(BODY_FROM_CAM))
    place = tmp_path / "place.txt"
    options = ("--truth", truth, "--body-from-camera", place)
    place.write_text(" ".join(map(str, BODY_FROM_CAM.ravel())))
    assert "hint" not in farpoint("evaluate", run, *options).out
    place.write_text(" ".join(map(str, np.linalg.inv(BODY_FROM_CAM).ravel())))
    assert "or the other way round" in farpoint("evaluate", run, *options).out


def test_a_body_needs_a_truth(run: Path, tmp_path: Path, farpoint: CommandLine):
    place = tmp_path / "place.txt"
    place.write_text(" ".join(map(str, np.eye(4).ravel())))
    assert_refused(farpoint("evaluate", run, "--body-from-camera", place), "--body-from-camera")


def test_places_of_cameras_on_bodies(tmp_path: Path):
    path = tmp_path / "place"
    inverse = np.linalg.inv(BODY_FROM_CAM)
    for text in (
        " ".join(map(repr, BODY_FROM_CAM.ravel().tolist())),
        "\n".join(", ".join(map(repr, row)) for row in BODY_FROM_CAM[:3].tolist()),
        f"sensor_type: camera\nT_BS:\n  data: {BODY_FROM_CAM.ravel().tolist()}\n",
        f"cam0:\n  T_cam_imu: {inverse.tolist()}\ncam1:\n  T_cam_imu: {np.eye(4).tolist()}\n",
    ):
        path.write_text(text)
        np.testing.assert_allclose(read_body_from_cam(path), BODY_FROM_CAM, atol=1e-12)
    for text, words in (
        ("camera_model: pinhole\n", "expected one of T_BS"),
        ("T_BS: [1, 2, 3]\n", "expected 12 or 16 numbers, got 3"),
        (" ".join(["2"] * 16), "expected a rigid motion"),
        (" ".join(["nan"] * 16), "expected a rigid motion"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            read_body_from_cam(path)


def test_no_other_frame_is_seen_in_noise():
    """200 drives of 30 turns each with noise of a tenth of them, and of none that turns at all."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        true = so3.exp(rng.normal(0, 0.01, (30, 3)))
        noisy = so3.exp(rng.normal(0, 0.001, (30, 3))) @ true
        assert other_frame(noisy, true) is None
        assert not fits_better(noisy, true, np.swapaxes(true, 1, 2))
        still = so3.exp(rng.normal(0, 0.001, (30, 3)))
        assert other_frame(still, so3.exp(rng.normal(0, 0.001, (30, 3)))) is None
