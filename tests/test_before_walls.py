"""A drone before house fronts: where two views leave the direction open, the path goes on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from farpoint import Camera, Odometry, OdometryResult, PoseStatus
from farpoint.geometry import so3, sphere
from farpoint.metrics.path_consistency import PathSamples, evaluate_path
from farpoint.synthetic import RenderedSequence, carried
from farpoint.trajectory.files import read_tum


def flown(shared_data: Path, start_s: float, seed: int) -> RenderedSequence:
    """70 frames, 30 a second, of a racing drone, its camera ahead, low over the street."""
    body = read_tum(shared_data / "trajectories" / "indoor_forward_7_snapdragon_with_gt.txt")
    camera = Camera.pinhole(320, 240, 200.0, 200.0, 159.5, 119.5)
    return RenderedSequence(camera, carried(body, start_s, 70, 30.0), seed=seed)


@pytest.fixture(scope="module")
def flight(shared_data: Path) -> RenderedSequence:
    return flown(shared_data, 11.0, 1)


@pytest.fixture(scope="module")
def results(flight: RenderedSequence) -> list[OdometryResult]:
    return list(Odometry(flight.camera).run(flight))


def lengths_of(world_from_cam: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(world_from_cam[:, :3, 3], axis=0), axis=1)


def test_two_views_leave_many_of_the_motions_open(results: list[OdometryResult]):
    statuses = [result.pose.status for result in results if result.pose is not None]
    assert statuses.count(PoseStatus.ROTATION_ONLY) > 0.2 * len(statuses)
    assert PoseStatus.FAILED not in statuses


def squares(flight: RenderedSequence, results: list[OdometryResult]) -> list[float]:
    """Normalised squares of the errors of motions whose direction is given."""
    found = []
    for result in results[1:]:
        assert result.pose is not None
        if result.pose.status is PoseStatus.OK:
            motion = flight.cam1_from_cam0(result.frame0, result.frame1)
            turn = so3.log(motion[:3, :3] @ result.pose.rotation_cam1_from_cam0.T)
            tilt = result.pose.direction_basis.T @ sphere.normalize(motion[:3, 3])
            error = np.array([*turn, *tilt])
            found.append(float(error @ np.linalg.solve(result.pose.covariance, error)))
    return found


def test_a_direction_that_is_given_is_the_right_one(
    shared_data: Path, flight: RenderedSequence, results: list[OdometryResult]
):
    found = [squares(flight, results)]
    for seed in (3, 7):
        later = flown(shared_data, 20.0, seed)
        found.append(squares(later, list(Odometry(later.camera).run(later))))
    for nees in found:
        # 5 degrees of freedom. Where other motions are taken on the word of some of the matches,
        # three of fifty in the first of the later flights are those, a thousand sigma off; where
        # that of a plane is not asked for unless it comes as near as any rival, one in the other;
        # and there one again if it must come near before it is refined.
        assert np.max(nees) < 40.0
        assert np.mean(np.array(nees) < 11.07) > 0.85


def test_the_path_goes_on_at_its_scale(flight: RenderedSequence, results: list[OdometryResult]):
    found = np.array([result.world_from_cam for result in results])
    ratios = lengths_of(found) / lengths_of(flight.world_from_cam)
    assert ratios.min() > 0.0
    assert np.abs(np.log(ratios / np.median(ratios))).max() < 0.1


def test_the_path_is_as_sure_as_stated(flight: RenderedSequence, results: list[OdometryResult]):
    count = len(results)
    figures = evaluate_path(
        PathSamples(
            segments=np.array([result.segment for result in results]),
            world_from_cam=np.array([result.world_from_cam for result in results]),
            covariances=np.array([result.world_covariance for result in results]),
            truth=flight.world_from_cam,
            lengths=np.array([result.scale or np.nan for result in results]),
            length_sigmas=np.array([result.scale_sigma or np.nan for result in results]),
            length_from=np.maximum(np.arange(count) - 1, 0),
        )
    )
    assert figures is not None
    assert figures.orientation.kept
    assert figures.position_any_scale.kept
