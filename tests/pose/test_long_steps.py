"""Real tracks over many frames, of which up to half are wrong in a similar way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from farpoint.bench.plain_script import PlainScript
from farpoint.bench.sequences import find_sequences, posed_sequence
from farpoint.geometry import so3
from farpoint.pose import estimate_relative_pose

pytest.importorskip("cv2")

STEP = 8  # frames, 8 m
PAIRS = 40


def test_the_motion_of_most_tracks_wins_over_a_motion_of_all_tracks_with_more_noise(
    shared_data: Path,
):
    # A motion that is wrong by 5 to 30 degrees leaves 1.5 to 5 px for all tracks; the right motion
    # leaves 0.5 px for 55 to 75 % of them. Each with its own noise, the wrong motion is likelier.
    recording = posed_sequence(find_sequences([shared_data / "kitti_a"])[0])
    assert recording is not None
    wrong = 0
    for first in range(PAIRS):
        script = PlainScript(recording.camera, 500)
        points0, points1 = script.match(recording.images[first], recording.images[first + STEP])
        pose = estimate_relative_pose(points0, points1, recording.camera)
        true = recording.cam1_from_cam0(first, first + STEP)[:3, :3]
        if pose.rotation_cam1_from_cam0 is not None:
            error = so3.angle_between(pose.rotation_cam1_from_cam0, true)
            wrong += np.degrees(error) > 5.0
    # With a noise of its own for each motion there are 10.
    assert wrong <= 7, wrong
