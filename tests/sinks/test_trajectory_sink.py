"""trajectory.tum: the poses of the frames, a line each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from farpoint.odometry import OdometryResult
from farpoint.sinks.trajectory import TrajectoryFile
from farpoint.trajectory.files import read_tum


def test_every_frame_is_a_pose_the_first_one_too(
    tmp_path: Path, make_result: Callable[..., OdometryResult]
) -> None:
    results = [make_result(k) for k in range(6)]
    path = tmp_path / "trajectory.tum"
    with TrajectoryFile(path) as file:
        for count, result in enumerate(results, start=1):
            file.write(result, None)
            assert len(read_tum(path)) == count
    read = read_tum(path)
    np.testing.assert_array_equal(read.timestamps, [result.timestamp for result in results])
    np.testing.assert_allclose(
        read.world_from_body, [result.world_from_cam for result in results], atol=1e-15
    )
