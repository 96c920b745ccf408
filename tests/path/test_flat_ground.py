"""A drone over flat ground seen obliquely: two views of every pair allow two motions."""

from __future__ import annotations

import numpy as np
from drive_kit import Cloud, Drive, motion_of, poses_of

from farpoint import PoseStatus

FRAMES, STEP_M, HEIGHT_M, PITCH = 30, 1.2, 30.0, np.radians(40.0)
DOWN = np.array([0.0, np.cos(PITCH), np.sin(PITCH)])
AHEAD = np.array([0.0, -np.sin(PITCH), np.cos(PITCH)])


def flight(relief_m: float) -> tuple[np.ndarray, Cloud]:
    """Poses, and points of the ground that are up to a few ``relief_m`` above and below it."""
    rng = np.random.default_rng(4)
    turns = np.radians(0.5) * np.sin(np.arange(FRAMES)[:, None] / [4.0, 6.0, 3.0])
    poses = poses_of(np.tile(STEP_M * AHEAD, (FRAMES, 1)), turns)
    poses[:, :3, 3] = STEP_M * np.arange(FRAMES + 1)[:, None] * AHEAD
    count = 2000
    points = rng.uniform(-60.0, 60.0, count)[:, None] * [1.0, 0.0, 0.0]
    points += rng.uniform(-20.0, 150.0, count)[:, None] * AHEAD
    points += (HEIGHT_M + relief_m * rng.normal(size=count))[:, None] * DOWN
    return poses, Cloud(poses=poses, points=points, noise_px=0.15)


def test_the_path_does_not_claim_to_stand_where_no_view_tells_its_motion():
    _, scene = flight(relief_m=0.0)
    drive = Drive()
    for tracks in scene.tracks():
        motion = motion_of(tracks)
        assert motion.status is PoseStatus.ROTATION_ONLY
        assert "Planar ambiguity" in motion.reason
        point = drive.add(tracks, motion)
        # Nothing is claimed about lengths, and no position is known to less than the unit.
        assert point.scale is None
        assert (np.sqrt(np.diag(point.covariance)[3:6]) > 1.0).all()
    sigma = np.sqrt(np.trace(drive.points[-1].covariance[3:6, 3:6]) / 3.0)
    early = np.sqrt(np.trace(drive.points[5].covariance[3:6, 3:6]) / 3.0)
    assert sigma > 2.0 * early  # it grows with the way


def test_the_path_goes_on_where_many_frames_tell_the_two_motions_apart():
    poses, scene = flight(relief_m=0.4)
    drive = Drive()
    for tracks in scene.tracks():
        drive.add(tracks)
    drive.finish()
    found = np.array([point.world_from_cam[:3, 3] for point in drive.settled])
    moved = found[-1] - found[len(found) // 2]
    true = poses[-1, :3, 3] - poses[len(found) // 2, :3, 3]
    cosine = moved @ true / np.linalg.norm(moved) / np.linalg.norm(true)
    assert np.degrees(np.arccos(cosine)) < 3.0
