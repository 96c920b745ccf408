"""A camera that turns by 90 degrees on the spot: the trajectory goes on; a cut ends it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from farpoint import Camera, Frame, Odometry, OdometryOptions, OdometryResult, PoseStatus
from farpoint.geometry import so3
from farpoint.synthetic import RenderedSequence, sideways
from farpoint.tracks import TrackerOptions
from farpoint.trajectory.files import Trajectory

CAMERA = Camera.pinhole(320, 240, 220.0, 220.0, 159.5, 119.5)  # 72 degrees wide
AHEAD, TURN, ASIDE = 12, 18, 12  # motions
STEP_M = 0.15


@pytest.fixture(scope="module")
def corner() -> RenderedSequence:
    """Along the street, a turn by 90 degrees on the spot, and on with the houses ahead."""
    count = AHEAD + TURN + ASIDE + 1
    way = STEP_M * np.concatenate(
        [np.arange(AHEAD), np.full(TURN + 1, AHEAD), AHEAD + 1 + np.arange(ASIDE)]
    )
    yaw = np.interp(np.arange(count), [AHEAD, AHEAD + TURN], [0.0, -math.pi / 2])
    start = sideways(1).world_from_body[0, :3, 3]
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = so3.exp(yaw[:, None] * [0.0, 1.0, 0.0])
    poses[:, :3, 3] = start + way[:, None] * [0.0, 0.0, 1.0]
    path = Trajectory(timestamps=np.arange(count) / 30.0, world_from_body=poses)
    return RenderedSequence(CAMERA, path, seed=4)


@pytest.fixture(scope="module")
def frames(corner: RenderedSequence) -> list[Frame]:
    return list(corner)


def run(frames: list[Frame]) -> list[OdometryResult]:
    options = OdometryOptions(tracker=TrackerOptions(max_tracks=300))
    return list(Odometry(CAMERA, options).run(frames))


def test_the_trajectory_goes_on_after_a_turn_on_the_spot(
    corner: RenderedSequence, frames: list[Frame]
):
    results = run(frames)
    statuses = [result.pose.status for result in results if result.pose is not None]
    assert PoseStatus.FAILED not in statuses
    assert statuses[AHEAD + 1 : AHEAD + TURN - 1].count(PoseStatus.OK) <= 1
    assert {result.segment for result in results} == {0}
    # No point is in view all along: the speed carries the scale, once, and this is said.
    guesses = [result for result in results if result.scale_is_guessed]
    assert len(guesses) == 1
    assert AHEAD + TURN <= guesses[0].frame1 <= AHEAD + TURN + 2
    assert guesses[0].scale_sigma / guesses[0].scale == pytest.approx(0.5, rel=0.1)
    last = results[-1]
    start = np.linalg.inv(corner.world_from_cam[0])
    truth = start @ corner.world_from_cam[-1]
    unit = np.linalg.norm((start @ corner.world_from_cam[1])[:3, 3])
    turned = so3.angle_between(last.world_from_cam[:3, :3], truth[:3, :3])
    assert math.degrees(turned) < 0.5
    # The speed was in fact the same, so the guess is nearly right; the path is one line.
    error = truth[:3, 3] / unit - last.world_from_cam[:3, 3]
    assert np.linalg.norm(error) < 0.1 * np.linalg.norm(truth[:3, 3] / unit)
    nees = error @ np.linalg.solve(last.world_covariance[3:6, 3:6], error)
    assert nees < 16.3  # 99.9 % of chi-square, 3 degrees of freedom


def test_a_cut_in_the_midst_of_the_turn_ends_the_segment(frames: list[Frame]):
    # The film goes on where the turn is over: no picture has anything in common with those before.
    cut = [*frames[: AHEAD + 3], *frames[AHEAD + TURN :]]
    results = run(cut)
    assert {result.segment for result in results[: AHEAD + 3]} == {0}
    assert {result.segment for result in results[AHEAD + 3 :]} == {1}
    assert not any(result.scale_is_guessed for result in results)


def test_a_blackout_during_the_turn_ends_the_segment(frames: list[Frame]):
    black = np.zeros_like(frames[0].image)
    dark = range(AHEAD + 2, AHEAD + TURN - 1)
    film = [
        Frame(
            index=frame.index,
            timestamp=frame.timestamp,
            image=black if frame.index in dark else frame.image,
            name=frame.name,
        )
        for frame in frames
    ]
    results = run(film)
    assert results[-1].segment == 1
    assert {result.segment for result in results[: AHEAD + 2]} == {0}
