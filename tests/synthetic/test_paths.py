"""Paths move as cars and heads do, and keep to the street."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.synthetic import (
    ImagingOptions,
    RenderedSequence,
    carried,
    pure_rotation,
    render_drive,
    sideways,
    standing_still,
    street_drive,
)
from farpoint.synthetic.street import BLOCK_M, LANE_M, ROAD_M
from farpoint.trajectory.files import Trajectory, read_tum

CAMERA = Camera.pinhole(64, 48, 50.0, 50.0, 31.5, 23.5)


def steps(path: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Translation in the earlier camera, m, and rotation vector of each step, rad."""
    poses = path.world_from_body
    relative = np.linalg.inv(poses[:-1]) @ poses[1:]
    return relative[:, :3, 3], so3.log(relative[:, :3, :3])


@pytest.mark.parametrize("seed", range(4))
def test_a_drive_is_one_a_car_could_make(seed):
    fps = 10.0
    path = street_drive(1000, fps, seed)
    moved, turned = steps(path)
    speed = np.linalg.norm(moved, axis=1) * fps
    assert speed.min() > 2.0
    assert speed.max() < 13.0
    assert np.ptp(speed) > 3.0
    forward = moved[:, 2] / np.linalg.norm(moved, axis=1)
    assert forward.min() > np.cos(np.radians(6.0))  # it drives where it looks
    acceleration = np.diff(path.world_from_body[:, :3, 3], 2, axis=0) * fps**2
    assert np.linalg.norm(acceleration, axis=1).max() < 8.0
    assert np.degrees(np.abs(turned[:, 1]).max()) * fps > 20.0  # it takes turns
    sway = np.degrees(turned[:, [0, 2]])
    assert (sway.std(axis=0) > 0.03).all()
    assert np.abs(sway).max() < 2.0


@pytest.mark.parametrize("seed", range(4))
def test_a_drive_keeps_to_the_road(seed):
    position = street_drive(1000, seed=seed).world_from_body[:, :3, 3]
    aside = np.abs((position[:, [0, 2]] + BLOCK_M / 2) % BLOCK_M - BLOCK_M / 2)
    nearest = aside.min(axis=1)
    at_crossing = aside.max(axis=1) < ROAD_M
    assert (nearest[~at_crossing] < ROAD_M / 2 - 0.5).all()
    assert np.abs(position[:, 1] + 1.65).max() < 0.1


def test_a_longer_drive_begins_like_a_shorter_one():
    short, long = street_drive(50, seed=9), street_drive(400, seed=9)
    np.testing.assert_allclose(
        short.world_from_body, long.world_from_body[:50], rtol=0.0, atol=1e-9
    )


def test_twice_the_frames_a_second_is_the_same_drive():
    slow, fast = street_drive(50, 10.0, seed=9), street_drive(99, 20.0, seed=9)
    np.testing.assert_allclose(slow.world_from_body, fast.world_from_body[::2], atol=1e-9)


def test_plain_motions_are_plain():
    moved, turned = steps(pure_rotation(60))
    np.testing.assert_allclose(moved, 0.0, atol=1e-12)
    assert np.linalg.norm(turned, axis=1).max() > np.radians(0.4)
    moved, turned = steps(standing_still(5))
    np.testing.assert_array_equal(moved, 0.0)
    np.testing.assert_array_equal(turned, 0.0)
    moved, turned = steps(sideways(5, fps=30.0, speed_m_s=1.5))
    np.testing.assert_allclose(moved, [[0.05, 0.0, 0.0]] * 4, atol=1e-12)
    np.testing.assert_allclose(turned, 0.0, atol=1e-12)


def test_a_sequence_is_a_source_of_frames(tmp_path):
    sequence = render_drive(CAMERA, frames=3, fps=20.0, seed=7)
    frames = list(sequence)
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert [frame.timestamp for frame in frames] == [0.0, 0.05, 0.1]
    assert {(frame.image.shape, frame.image.dtype.str) for frame in frames} == {((48, 64), "|u1")}
    assert sequence.count == len(sequence) == 3
    assert sequence.name == "drive-7"
    sequence.write_truth(tmp_path / "truth.tum")
    truth = read_tum(tmp_path / "truth.tum")
    np.testing.assert_array_equal(truth.timestamps, sequence.timestamps)
    np.testing.assert_allclose(truth.world_from_body, sequence.world_from_cam, atol=1e-12)
    motion = sequence.cam1_from_cam0(0, 2)
    np.testing.assert_allclose(
        sequence.world_from_cam[2] @ motion, sequence.world_from_cam[0], atol=1e-12
    )


def below_ground() -> Trajectory:
    path = standing_still(2)
    path.world_from_body[:, 1, 3] = 0.5
    return path


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("frames", lambda: street_drive(0)),
        ("fps", lambda: street_drive(5, fps=0.0)),
        ("fps", lambda: sideways(5, fps=float("nan"))),
        ("speed_m_s", lambda: sideways(5, speed_m_s=float("inf"))),
        ("rate_deg_s", lambda: pure_rotation(5, rate_deg_s=float("nan"))),
        ("noise_grey", lambda: ImagingOptions(noise_grey=-1.0)),
        ("exposure_swing", lambda: ImagingOptions(exposure_swing=float("nan"))),
        ("seed", lambda: street_drive(5, seed=-1)),
        ("seed", lambda: RenderedSequence(CAMERA, standing_still(2), seed=-1)),
        ("camera", lambda: RenderedSequence(Camera(model=CAMERA.model), standing_still(2))),
        ("path", lambda: RenderedSequence(CAMERA, below_ground())),
        (
            "path",
            lambda: RenderedSequence(
                CAMERA, Trajectory(timestamps=None, world_from_body=np.eye(4)[None])
            ),
        ),
    ],
)
def test_what_cannot_be_rendered_says_why(field, make):
    with pytest.raises(InputError) as error:
        make()
    assert error.value.field == field


def measured(seconds: float, *, gap_s: tuple[float, float] = (9e9, 9e9)) -> Trajectory:
    """Fly ahead and up at 100 poses a second, turning left; axes x ahead, y left, z up."""
    times = np.arange(0.0, seconds, 0.01)
    times = times[(times < gap_s[0]) | (times > gap_s[1])]
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = so3.exp(np.outer(times, [0.0, 0.0, 0.2]))
    poses[:, :3, 3] = np.outer(times, [1.0, 0.0, 0.3]) + np.array([3.0, -7.0, 1.0])
    return Trajectory(timestamps=1e9 + times, world_from_body=poses)


def test_what_is_carried_moves_as_it_was_measured():
    path = carried(measured(4.0), 1.0, 21, 10.0)
    assert len(path) == 21
    positions = path.world_from_body[:, :3, 3]
    # Ahead is z in the street, up is -y, and the lowest point is a metre above ground.
    np.testing.assert_allclose(np.diff(positions, axis=0), [[0.0, -0.03, 0.1]] * 20, atol=1e-6)
    assert positions[:, 1].max() == pytest.approx(-1.0)
    np.testing.assert_allclose(positions[:, [0, 2]].mean(axis=0), [LANE_M, 20.0], atol=1e-9)
    turned = so3.log(path.world_from_body[:, :3, :3])
    np.testing.assert_allclose(turned[:, 1], -0.2 * (1.0 + np.arange(21) / 10.0), atol=1e-6)


def test_what_was_not_measured_cannot_be_carried():
    with pytest.raises(InputError, match=r"body: expected poses without a gap from 3 to 5 s"):
        carried(measured(4.0), 3.0, 21, 10.0)
    with pytest.raises(InputError, match=r"without a gap from 0.5 to 2.5 s"):
        carried(measured(4.0, gap_s=(1.0, 2.0)), 0.5, 21, 10.0)
    untimed = Trajectory(timestamps=None, world_from_body=measured(1.0).world_from_body)
    with pytest.raises(InputError, match="poses with their times"):
        carried(untimed, 0.0, 2, 10.0)
