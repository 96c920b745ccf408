"""Alignment and trajectory errors, held against evo and a plain reading of KITTI's kit."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from evo.core import geometry as evo_geometry
from evo.core import metrics as evo_metrics
from evo.core.trajectory import PosePath3D

from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.metrics import (
    KITTI_LENGTHS_M,
    absolute_errors,
    align_se3,
    align_sim3,
    evaluate_trajectory,
    kitti_segment_errors,
    path_length,
    relative_errors,
    scale_drift,
    sim3_misfit,
)


def drive(count: int, seed: int, step: float = 1.1) -> np.ndarray:
    """Poses of a winding drive."""
    rng = np.random.default_rng(seed)
    turns = so3.exp(np.cumsum(0.002 * rng.normal(size=(count, 3)), axis=0))
    poses = np.tile(np.eye(4), (count, 1, 1))
    for k in range(1, count):
        poses[k, :3, :3] = poses[k - 1, :3, :3] @ turns[k]
        poses[k, :3, 3] = poses[k - 1, :3, 3] + poses[k, :3, :3] @ [0.01, 0.02, step]
    return poses


def drifting(truth: np.ndarray, seed: int, scale: float = 0.4) -> np.ndarray:
    """An estimate in another world and scale, with errors that add up."""
    rng = np.random.default_rng(seed)
    world = np.eye(4)
    world[:3, :3] = so3.exp(rng.normal(size=3))
    world[:3, 3] = 10.0 * rng.normal(size=3)
    poses = [world]
    for before, after in itertools.pairwise(truth):
        motion = np.linalg.inv(before) @ after
        motion[:3, :3] = so3.exp(2e-3 * rng.normal(size=3)) @ motion[:3, :3]
        motion[:3, 3] = scale * (motion[:3, 3] + 0.05 * rng.normal(size=3))
        poses.append(poses[-1] @ motion)
    return np.array(poses)


def evo_path(poses: np.ndarray) -> PosePath3D:
    return PosePath3D(poses_se3=list(poses))


def evo_statistics(metric: evo_metrics.PE, truth: np.ndarray, poses: np.ndarray) -> dict:
    metric.process_data((evo_path(truth), evo_path(poses)))
    return metric.get_all_statistics()


@pytest.fixture(params=[1, 2, 3])
def pair(request: pytest.FixtureRequest) -> tuple[np.ndarray, np.ndarray]:
    truth = drive(250, request.param)
    return drifting(truth, request.param + 100), truth


@pytest.mark.parametrize("with_scale", [True, False])
def test_alignment_is_evos(pair: tuple[np.ndarray, np.ndarray], with_scale: bool):
    source, target = (poses[:, :3, 3] for poses in pair)
    found = (align_sim3 if with_scale else align_se3)(source, target)
    R, t, scale = evo_geometry.umeyama_alignment(source.T, target.T, with_scale)
    np.testing.assert_allclose(found.rotation, R, atol=1e-9)
    np.testing.assert_allclose(found.translation, t, atol=1e-9)
    assert found.scale == pytest.approx(scale, abs=1e-9)


def test_alignment_is_exact_on_exact_data_and_never_mirrors():
    rng = np.random.default_rng(3)
    source = rng.normal(size=(10, 3))
    R, t = so3.exp([0.5, -2.0, 1.0]), np.array([1.0, 2.0, 3.0])
    found = align_sim3(source, 2.5 * source @ R.T + t)
    np.testing.assert_allclose(found.rotation, R, atol=1e-12)
    np.testing.assert_allclose(found.translation, t, atol=1e-12)
    assert found.scale == pytest.approx(2.5, rel=1e-12)
    mirrored = align_sim3(source, source * [1.0, 1.0, -1.0])
    R, _, scale = evo_geometry.umeyama_alignment(source.T, (source * [1.0, 1.0, -1.0]).T, True)
    assert np.linalg.det(mirrored.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(mirrored.rotation, R, atol=1e-12)
    assert mirrored.scale == pytest.approx(scale, rel=1e-12)


@pytest.mark.parametrize("with_scale", [True, False])
def test_ate_is_evos(pair: tuple[np.ndarray, np.ndarray], with_scale: bool):
    estimate, truth = pair
    align = align_sim3 if with_scale else align_se3
    ours = absolute_errors(
        align(estimate[:, :3, 3], truth[:, :3, 3]).apply_to_poses(estimate), truth
    )
    theirs = evo_path(estimate)
    theirs.align(evo_path(truth), correct_scale=with_scale)
    metric = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    expected = evo_statistics(metric, truth, np.array(theirs.poses_se3))
    assert math.sqrt(np.mean(ours**2)) == pytest.approx(expected["rmse"], abs=1e-9)
    assert np.median(ours) == pytest.approx(expected["median"], abs=1e-9)
    assert ours.max() == pytest.approx(expected["max"], abs=1e-9)


@pytest.mark.parametrize("delta", [1, 7])
@pytest.mark.parametrize("overlapping", [True, False])
def test_rpe_is_evos(pair: tuple[np.ndarray, np.ndarray], delta: int, overlapping: bool):
    estimate, truth = pair
    ours = relative_errors(estimate, truth, delta_frames=delta, stride=1 if overlapping else delta)
    for relation, values in (
        (evo_metrics.PoseRelation.translation_part, ours.translation),
        (evo_metrics.PoseRelation.rotation_angle_rad, ours.rotation_rad),
    ):
        metric = evo_metrics.RPE(relation, delta, evo_metrics.Unit.frames, all_pairs=overlapping)
        expected = evo_statistics(metric, truth, estimate)
        assert len(values) == len(metric.error)
        assert math.sqrt(np.mean(values**2)) == pytest.approx(expected["rmse"], abs=1e-9)
        assert np.mean(values) == pytest.approx(expected["mean"], abs=1e-9)


def test_all_of_evaluate_trajectory_is_evos(pair: tuple[np.ndarray, np.ndarray]):
    estimate, truth = pair
    figures = evaluate_trajectory(estimate, truth, delta_frames=5)
    theirs = evo_path(estimate)
    _, _, scale = theirs.align(evo_path(truth), correct_scale=True)
    assert figures.scale == pytest.approx(scale, abs=1e-9)
    assert figures.path_length == pytest.approx(evo_path(truth).path_length, abs=1e-9)
    metric = evo_metrics.RPE(
        evo_metrics.PoseRelation.translation_part, 5, evo_metrics.Unit.frames, all_pairs=True
    )
    expected = evo_statistics(metric, truth, np.array(theirs.poses_se3))
    assert figures.rpe_translation.rmse == pytest.approx(expected["rmse"], abs=1e-9)


def kitti_kit(estimate: np.ndarray, truth: np.ndarray) -> list[tuple[int, float, float, float]]:
    """Transcription of what the development kit's ``calcSequenceErrors`` computes, in loops."""
    distance = [0.0]
    for before, after in itertools.pairwise(truth):
        distance.append(distance[-1] + math.dist(before[:3, 3], after[:3, 3]))
    errors = []
    for first in range(0, len(truth), 10):
        for length in KITTI_LENGTHS_M:
            last = next(
                (k for k in range(first, len(truth)) if distance[k] > distance[first] + length), -1
            )
            if last < 0:
                continue
            motion_true = np.linalg.inv(truth[first]) @ truth[last]
            motion = np.linalg.inv(estimate[first]) @ estimate[last]
            error = np.linalg.inv(motion) @ motion_true
            cosine = 0.5 * (np.trace(error[:3, :3]) - 1.0)
            angle = math.acos(max(min(cosine, 1.0), -1.0))
            errors.append((first, length, math.hypot(*error[:3, 3]) / length, angle / length))
    return errors


def test_segment_errors_are_kittis():
    truth = drive(330, seed=4)
    estimate = drifting(truth, seed=5, scale=1.0)
    ours = kitti_segment_errors(estimate, truth)
    expected = np.array(kitti_kit(estimate, truth))
    assert set(ours.length) == {100.0, 200.0, 300.0}
    np.testing.assert_array_equal(ours.first_frame, expected[:, 0])
    np.testing.assert_array_equal(ours.length, expected[:, 1])
    np.testing.assert_allclose(ours.translation_ratio, expected[:, 2], atol=1e-9)
    np.testing.assert_allclose(ours.rotation_rad_per_length, expected[:, 3], atol=1e-9)
    figures = evaluate_trajectory(estimate, truth).segments
    assert [s.length for s in figures] == [100.0, 200.0, 300.0, None]
    assert figures[-1].count == len(expected)


def test_a_segment_ends_beyond_its_length_not_at_it():
    truth = np.tile(np.eye(4), (250, 1, 1))
    truth[:, 2, 3] = np.arange(250.0)
    estimate = truth.copy()
    estimate[101, 0, 3] = 7.0
    ours = kitti_segment_errors(estimate, truth)
    assert ours.translation_ratio[0] == pytest.approx(0.07)
    np.testing.assert_array_equal(
        ours.translation_ratio, np.array(kitti_kit(estimate, truth))[:, 2]
    )


def test_a_short_path_has_no_segments():
    truth = drive(50, seed=4)
    assert len(kitti_segment_errors(truth, truth).length) == 0
    assert evaluate_trajectory(truth, truth).segments == ()


def test_a_perfect_estimate_has_no_error(shared_data: Path):
    rows = np.loadtxt(shared_data / "kitti_00" / "poses.txt").reshape(-1, 3, 4)
    truth = np.tile(np.eye(4), (len(rows), 1, 1))
    truth[:, :3] = rows
    moved = align_sim3(drive(9, 1)[:, :3, 3], drive(9, 2)[:, :3, 3]).apply_to_poses(truth)
    moved[:, :3, 3] *= 0.1
    figures = evaluate_trajectory(moved, truth)
    assert figures.path_length == pytest.approx(path_length(truth))
    assert figures.ate_sim3.max < 1e-9
    assert figures.ate_se3.rmse > 1.0
    assert figures.rpe_translation.max < 1e-5  # KITTI's rotations are rounded to 7 digits
    assert figures.rpe_rotation_rad.max < 1e-6


@pytest.mark.parametrize("count", [2, 40])
def test_a_straight_line_has_no_unique_alignment(count: int):
    line = np.outer(np.arange(count), [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match=r"one line|at least 3"):
        align_sim3(line, line)


def test_the_misfit_is_the_ate_and_needs_no_unique_alignment():
    truth = drive(40, 3)
    estimate = drifting(truth, 4)
    source, target = estimate[:, :3, 3], truth[:, :3, 3]
    aligned = align_sim3(source, target).apply_to_poses(estimate)
    ate = np.sqrt(np.mean(absolute_errors(aligned, truth) ** 2))
    assert sim3_misfit(source, target) == pytest.approx(ate, rel=1e-9)
    # On a line the best similarity leaves what stands off it, and what is off along it.
    line = np.outer(np.arange(9.0), [1.0, 2.0, -1.0]) / np.sqrt(6.0)
    off = np.outer((-1.0) ** np.arange(9), [2.0, -1.0, 0.0]) / np.sqrt(5.0)
    assert sim3_misfit(0.3 * line, line) == pytest.approx(0.0, abs=1e-7)
    assert 0.05 < sim3_misfit(line + 0.1 * off, line) < 0.1
    assert sim3_misfit(np.zeros((9, 3)), line) == pytest.approx(
        np.sqrt(np.mean(np.arange(-4, 5.0) ** 2))
    )


def test_standing_still_has_no_unique_alignment():
    with pytest.raises(InputError, match="one line"):
        align_sim3(np.zeros((5, 3)), drive(5, 1)[:, :3, 3])


def test_unequal_trajectories_are_refused():
    with pytest.raises(InputError, match=r"^estimate: expected as many poses"):
        absolute_errors(drive(5, 1), drive(6, 1))
    with pytest.raises(InputError, match=r"^truth: expected shape \(N, 4, 4\)"):
        relative_errors(drive(5, 1), drive(5, 1)[:, :3])
    with pytest.raises(InputError, match=r"^delta_frames: expected at least 1"):
        relative_errors(drive(5, 1), drive(5, 1), delta_frames=0)


def test_the_drift_of_the_scale_is_that_from_the_first_fifth_to_the_last():
    truth = drive(101, seed=5)
    assert scale_drift(truth, truth) == pytest.approx(0.0, abs=1e-12)
    estimate = truth.copy()
    steps = np.diff(truth[:, :3, 3], axis=0) * np.linspace(2.0, 3.0, 100)[:, None]
    estimate[1:, :3, 3] = estimate[0, :3, 3] + np.cumsum(steps, axis=0)
    # Equal steps: means of the factors over the first twenty and the last.
    factors = np.linspace(2.0, 3.0, 100)
    assert scale_drift(estimate, truth) == pytest.approx(
        factors[80:].mean() / factors[:20].mean() - 1.0, rel=1e-6
    )
    assert evaluate_trajectory(estimate, truth).scale_drift == scale_drift(estimate, truth)


def test_standing_still_has_no_drift_of_the_scale():
    still = np.tile(np.eye(4), (5, 1, 1))
    assert math.isnan(scale_drift(still, still))
