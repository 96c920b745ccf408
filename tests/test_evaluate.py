"""A folder as ``farpoint run`` writes it against truth files of every kind."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_pose import STATS
from path_kit import drawn_path

from farpoint.errors import InputError
from farpoint.evaluate import EvaluationOptions, FolderEvaluation, evaluate_folder, write_pairs
from farpoint.geometry import so3, sphere
from farpoint.metrics import (
    AssociationOptions,
    PathSamples,
    SplitHalf,
    evaluate_path,
    relative_motions,
    to_json,
    to_text,
)
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus, RelativePose
from farpoint.sinks.halves import HalvesFile
from farpoint.sinks.motions import MotionsFile
from farpoint.sinks.positions import PositionsFile
from farpoint.sinks.trajectory import TrajectoryFile
from farpoint.tracks import Tracks
from farpoint.trajectory.files import Trajectory, read_trajectory, write_kitti, write_tum

SIGMA = np.array([1e-3, 1e-3, 1e-3, 1e-2, 1e-2])
"""1-sigma errors of the simulated motions, rad."""


def simulated_pose(
    R_true: np.ndarray, t_true: np.ndarray, error: np.ndarray, status: PoseStatus
) -> RelativePose:
    """A motion with these errors, as far as its status gives one."""
    ok, lost = status is PoseStatus.OK, status is PoseStatus.FAILED
    true = t_true / max(float(np.linalg.norm(t_true)), 1e-12)
    direction = sphere.retract(true, sphere.tangent_basis(true), error[3:])
    return RelativePose(
        status=status,
        reason="simulated",
        rotation_cam1_from_cam0=None if lost else so3.exp(-error[:3]) @ R_true,
        rotation_covariance=None if lost else np.diag(SIGMA[:3] ** 2),
        direction_cam1_from_cam0=direction if ok else None,
        direction_basis=sphere.tangent_basis(direction) if ok else None,
        covariance=np.diag(SIGMA**2) if ok else None,
        labels=np.empty(0, np.uint8),
        noise_px=None,
        stats=STATS,
    )


def write_run(
    folder: Path,
    world_from_cam: np.ndarray,
    timestamps: np.ndarray,
    *,
    statuses: dict[int, PoseStatus] | None = None,
    sigmas: float = 1.0,
) -> None:
    """The two files of a run over these frames: errors of ``sigmas`` times SIGMA, seeded."""
    rng = np.random.default_rng(42)
    folder.mkdir(exist_ok=True)
    rotations, translations = relative_motions(world_from_cam[:-1], world_from_cam[1:])
    with (
        MotionsFile(folder / "motions.csv") as motions,
        TrajectoryFile(folder / "trajectory.tum") as trajectory,
    ):
        for k, stamp in enumerate(timestamps):
            status = (statuses or {}).get(k, PoseStatus.OK)
            before = max(k - 1, 0)
            error = sigmas * SIGMA * rng.normal(size=5)
            pose = (
                simulated_pose(rotations[k - 1], translations[k - 1], error, status) if k else None
            )
            world = np.linalg.inv(world_from_cam[0]) @ world_from_cam[k]
            world[:3, 3] *= 0.5
            result = OdometryResult(
                frame0=before,
                frame1=k,
                timestamp0=float(timestamps[before]),
                timestamp=float(stamp),
                pose=pose,
                tracks=Tracks.empty(),
                world_from_cam=world,
                scale=None,
                scale_sigma=None,
            )
            motions.write(result, None)
            trajectory.write(result, None)


def first_frame() -> OdometryResult:
    return OdometryResult(
        frame0=0,
        frame1=1,
        timestamp0=0.0,
        timestamp=0.1,
        pose=None,
        tracks=Tracks.empty(),
        world_from_cam=np.eye(4),
        scale=None,
        scale_sigma=None,
    )


def winding(times: np.ndarray) -> np.ndarray:
    """A smooth path with turns, as a function of time, s."""
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = so3.exp(np.outer(np.sin(0.3 * times), [0.1, 0.8, 0.05]))
    poses[:, :3, 3] = np.column_stack(
        [20.0 * np.sin(0.2 * times), 0.3 * np.sin(times), 8.0 * times]
    )
    return poses


TIMES = 1_000.0 + 0.1 * np.arange(120)
POSES = winding(TIMES - TIMES[0])


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    write_run(folder, POSES, TIMES)
    return folder


def kitti_truth(path: Path) -> Path:
    write_kitti(path, Trajectory(timestamps=None, world_from_body=POSES))
    return path


def dense_truth(path: Path, start_s: float = -1.0, body_from_cam: np.ndarray | None = None) -> Path:
    """Truth at 200 Hz, from ``start_s`` after the first frame, of the camera or another body."""
    times = start_s + np.arange(0.0, 15.0, 0.005)
    poses = winding(times)
    if body_from_cam is not None:
        poses = poses @ np.linalg.inv(body_from_cam)
    write_tum(path, Trajectory(timestamps=TIMES[0] + times, world_from_body=poses))
    return path


def check_figures(found: FolderEvaluation) -> None:
    """What the simulated errors must show, whatever kind of truth told them."""
    motions, trajectory = found.evaluation.motions, found.evaluation.trajectory
    assert motions.statuses["OK"] == motions.pairs == motions.pairs_with_truth == 119
    assert motions.pose.mean_nees == pytest.approx(5.0, abs=3.3 * np.sqrt(10.0 / 119))
    assert motions.rotation.mean_nees == pytest.approx(3.0, abs=3.3 * np.sqrt(6.0 / 119))
    assert motions.direction_rad.rmse == pytest.approx(np.sqrt(2.0) * 1e-2, rel=0.2)
    assert trajectory is not None
    assert trajectory.scale == pytest.approx(2.0, rel=1e-4)
    assert trajectory.ate_sim3.rmse < 1e-3


def test_kitti_truth_goes_by_frames(run: Path, tmp_path: Path):
    check_figures(evaluate_folder(run, kitti_truth(tmp_path / "poses.txt")))


def test_tum_truth_goes_by_times(run: Path, tmp_path: Path):
    found = evaluate_folder(run, dense_truth(tmp_path / "truth.tum", start_s=-1.0013))
    check_figures(found)


def test_truth_may_follow_another_body(run: Path, tmp_path: Path):
    body_from_cam = np.eye(4)
    body_from_cam[:3, :3] = so3.exp([0.3, 1.0, -2.0])
    body_from_cam[:3, 3] = [0.2, -0.1, 0.4]
    truth = dense_truth(tmp_path / "truth.tum", body_from_cam=body_from_cam)
    check_figures(evaluate_folder(run, truth, body_from_cam=body_from_cam))
    wrong = evaluate_folder(run, truth).evaluation.motions
    assert wrong.rotation.mean_nees > 100.0


def test_too_bold_a_covariance_is_seen(tmp_path: Path):
    write_run(tmp_path / "run", POSES, TIMES, sigmas=2.0)
    motions = evaluate_folder(tmp_path / "run", kitti_truth(tmp_path / "poses.txt")).evaluation
    assert motions.motions.pose.mean_nees > motions.motions.pose.nees_high
    assert motions.motions.pose.coverage95.high < 0.95


def test_truth_that_begins_later_counts_from_there(run: Path, tmp_path: Path):
    found = evaluate_folder(run, dense_truth(tmp_path / "truth.tum", start_s=2.05))
    motions, trajectory = found.evaluation.motions, found.evaluation.trajectory
    assert (motions.pairs, motions.pairs_with_truth) == (119, 98)
    assert np.flatnonzero(found.errors.has_truth)[0] == 21
    assert trajectory is not None
    assert trajectory.poses == 99


def test_every_status_is_counted_for_what_it_gives(tmp_path: Path):
    statuses = {
        5: PoseStatus.ROTATION_ONLY,
        6: PoseStatus.STATIC,
        7: PoseStatus.FAILED,
        8: PoseStatus.FAILED,
    }
    write_run(tmp_path / "run", POSES, TIMES, statuses=statuses)
    motions = evaluate_folder(
        tmp_path / "run", kitti_truth(tmp_path / "poses.txt")
    ).evaluation.motions
    assert motions.statuses == {"OK": 115, "ROTATION_ONLY": 1, "STATIC": 1, "FAILED": 2}
    assert (motions.rotation.count, motions.pose.count) == (117, 115)


def test_short_steps_have_no_direction_to_compare(run: Path, tmp_path: Path):
    steps = np.linalg.norm(np.diff(POSES[:, :3, 3], axis=0), axis=1)
    limit = float(np.median(steps))
    options = EvaluationOptions(min_translation=limit)
    motions = evaluate_folder(run, kitti_truth(tmp_path / "poses.txt"), options).evaluation.motions
    assert motions.directions_not_counted == np.count_nonzero(steps < limit)
    assert motions.direction_rad.count == 119 - motions.directions_not_counted
    assert motions.rotation_rad.count == 119


def test_standing_still_has_motions_but_no_trajectory(tmp_path: Path):
    still = np.tile(np.eye(4), (10, 1, 1))
    statuses = dict.fromkeys(range(10), PoseStatus.STATIC)
    write_run(tmp_path / "run", still, TIMES[:10], statuses=statuses)
    write_tum(tmp_path / "truth.tum", Trajectory(timestamps=TIMES[:10], world_from_body=still))
    found = evaluate_folder(tmp_path / "run", tmp_path / "truth.tum").evaluation
    assert found.motions.rotation.count == 9
    assert found.trajectory is None
    assert found.trajectory_fault == "positions lie on one line: no unique alignment"


def test_without_truth_the_claims_and_the_halves_are_left(run: Path):
    found = evaluate_folder(run)
    motions = found.evaluation.motions
    assert (motions.pairs, motions.pairs_with_truth, motions.pose.count) == (119, 0, 0)
    assert motions.direction_sigma_rad.median == pytest.approx(np.sqrt(2.0) * 1e-2)
    assert (found.evaluation.trajectory, found.evaluation.trajectory_fault) == (None, None)
    assert found.evaluation.halves is None
    claimed = SplitHalf(
        statuses=(PoseStatus.OK, PoseStatus.OK), difference=SIGMA, covariance=np.diag(SIGMA**2)
    )
    with HalvesFile(run / "halves.csv") as file:
        file.write(first_frame(), claimed)
    halves = evaluate_folder(run).evaluation.halves
    assert halves is not None
    assert (halves.pairs, halves.pose.mean_nees) == (1, pytest.approx(5.0))
    text = to_text(evaluate_folder(run).evaluation)
    assert "two halves of the matches, 1 pairs: 1 compared" in text
    assert "opposite" not in text
    assert "\nrotation, deg" not in text
    assert "\nclaimed rotation, deg" in text
    opposed = replace(claimed, difference=np.array([0.0, 0.0, 0.0, np.inf, 0.0]))
    with HalvesFile(run / "halves.csv") as file:
        for halves in (claimed, opposed):
            file.write(first_frame(), halves)
    text = to_text(evaluate_folder(run).evaluation)
    assert "difference over covariance, all together: 1 (" in text
    assert "\nopposite directions, not counted: 1 pairs\n" in text


def write_path(folder: Path, path: PathSamples) -> None:
    """The files of a run along this path; motions tell lengths alone."""
    write_run(folder, path.truth, TIMES[0] + 0.1 * np.arange(len(path.truth)))
    with (
        MotionsFile(folder / "motions.csv") as motions,
        PositionsFile(folder / "positions.csv") as positions,
    ):
        for k in range(len(path.truth)):
            length, sigma = float(path.lengths[k]), float(path.length_sigmas[k])
            result = OdometryResult(
                frame0=int(path.length_from[k]),
                frame1=k,
                timestamp0=TIMES[0] + 0.1 * int(path.length_from[k]),
                timestamp=TIMES[0] + 0.1 * k,
                pose=simulated_pose(np.eye(3), np.ones(3), np.zeros(5), PoseStatus.OK)
                if k
                else None,
                tracks=Tracks.empty(),
                world_from_cam=path.world_from_cam[k],
                scale=None if np.isnan(length) else length,
                scale_sigma=None if np.isnan(sigma) else sigma,
                world_covariance=path.covariances[k],
                segment=int(path.segments[k]),
            )
            motions.write(result, None)
            positions.write(result, None)


def test_the_covariance_of_the_path_is_evaluated_from_its_files(run: Path, tmp_path: Path):
    path = drawn_path(segments=6)
    write_path(tmp_path / "path", path)
    write_kitti(tmp_path / "truth", Trajectory(timestamps=None, world_from_body=path.truth))
    evaluation = evaluate_folder(tmp_path / "path", tmp_path / "truth").evaluation
    found, expected = evaluation.path, evaluate_path(path)
    assert found is not None
    assert expected is not None
    for name in ("orientation", "position", "pose", "position_any_scale"):
        assert getattr(found, name).mean_nees == pytest.approx(getattr(expected, name).mean_nees)
    assert found.lengths.count == expected.lengths.count > 200
    assert found.lengths.mean_nees == pytest.approx(expected.lengths.mean_nees)
    text = to_text(evaluation)
    assert "covariance of the path" in text
    assert "too sure" not in text
    bold = replace(path, covariances=path.covariances / 4.0)
    write_path(tmp_path / "bold", bold)
    text = to_text(evaluate_folder(tmp_path / "bold", tmp_path / "truth").evaluation)
    assert text.count("too sure") == 4
    assert json.loads(to_json(evaluation))["path"]["pose"]["segments"] == 6
    # A folder without covariances has no such figures.
    assert evaluate_folder(run, kitti_truth(tmp_path / "poses.txt")).evaluation.path is None


def test_pairs_are_written_with_their_frames(run: Path, tmp_path: Path):
    found = evaluate_folder(run, kitti_truth(tmp_path / "poses.txt"))
    write_pairs(tmp_path / "pairs.csv", found)
    with (tmp_path / "pairs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 119
    assert (rows[3]["frame0"], rows[3]["frame1"]) == ("3", "4")
    assert float(rows[3]["timestamp1"]) == TIMES[4]
    assert float(rows[3]["pose_nees"]) == pytest.approx(found.errors.pose_nees[3], rel=1e-8)


def breaks_times(_run: Path, truth: Path) -> None:
    write_tum(truth, Trajectory(timestamps=np.arange(5.0), world_from_body=POSES[:5]))


def leaves_gaps(_run: Path, truth: Path) -> None:
    stamps = np.array([TIMES[0] - 5.0, TIMES[-1] + 5.0])
    write_tum(truth, Trajectory(timestamps=stamps, world_from_body=POSES[:2]))


def loses_motions(run: Path, _truth: Path) -> None:
    (run / "motions.csv").unlink()


def empties_motions(run: Path, _truth: Path) -> None:
    text = (run / "motions.csv").read_text()
    (run / "motions.csv").write_text(text.splitlines(keepends=True)[0])


def loses_trajectory(run: Path, _truth: Path) -> None:
    (run / "trajectory.tum").unlink()


def loses_truth(_run: Path, truth: Path) -> None:
    truth.unlink()


def claims_no_variance(run: Path, _truth: Path) -> None:
    lines = (run / "motions.csv").read_text().splitlines()
    cells = lines[4].split(",")
    cells[lines[0].split(",").index("cov_00")] = "0.0"
    lines[4] = ",".join(cells)
    (run / "motions.csv").write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (breaks_times, r"truth\.tum: timestamps: times do not overlap: estimates 1000\.0.* 4\.0"),
        (leaves_gaps, r"truth\.tum: timestamps: times overlap only in gaps over 0\.2 s"),
        (loses_motions, r"motions\.csv: cannot be read"),
        (empties_motions, r"motions\.csv: expected at least one pair"),
        (loses_trajectory, r"trajectory\.tum: no such file"),
        (loses_truth, r"truth\.tum: no such file"),
        (claims_no_variance, r"motions\.csv: .*positive"),
    ],
)
def test_what_cannot_be_used_is_named(
    run: Path, tmp_path: Path, damage: Callable[[Path, Path], None], message: str
):
    truth = dense_truth(tmp_path / "truth.tum")
    damage(run, truth)
    with pytest.raises(InputError, match=message) as caught:
        evaluate_folder(run, truth)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"min_translation": -1.0}, "min_translation"),
        ({"min_translation": float("nan")}, "min_translation"),
        ({"delta_frames": 0}, "delta_frames"),
    ],
)
def test_options_are_checked(changes: dict, field: str):
    with pytest.raises(InputError, match=rf"^{field}: expected"):
        EvaluationOptions(**changes)


def test_real_truth_of_all_three_kinds(shared_data: Path, tmp_path: Path):
    """Real recordings between whose poses the frames fall; the errors are ours and known."""
    for name, rate_hz, files in (
        ("kitti_00", 10.0, "poses.txt"),
        ("tum_fr1_rpy", 30.0, "groundtruth.txt"),
        ("trajectories", 30.0, "dataset-room1_512_16.txt"),
    ):
        truth = shared_data / name / files
        reference = read_trajectory(truth)
        options = EvaluationOptions(
            min_translation=0.01, association=AssociationOptions(max_gap_s=0.2)
        )
        if reference.timestamps is None:
            stamps, poses = np.arange(100) / rate_hz, reference.world_from_body[:100]
        else:
            # Frames on every sixth true pose; the evaluation reads the times, not the rows.
            rows = np.arange(0, 600, 6)
            stamps, poses = reference.timestamps[rows], reference.world_from_body[rows]
        write_run(tmp_path / name, poses, stamps)
        found = evaluate_folder(tmp_path / name, truth, options).evaluation
        assert found.motions.pairs_with_truth == 99
        assert found.motions.rotation.mean_nees == pytest.approx(3.0, abs=3.3 * np.sqrt(6.0 / 99))
        assert found.trajectory is not None
        assert found.trajectory.scale == pytest.approx(2.0, rel=1e-6)
        assert found.trajectory.ate_sim3.rmse < 1e-5
