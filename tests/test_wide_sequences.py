"""Fisheye beyond 180 degrees and 360 pictures, from rendered images to motions, end to end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from farpoint import Camera, PoseStatus, load_camera
from farpoint.bench.rendered import RenderedErrors, run_rendered
from farpoint.camera import Equirectangular, field_of_view
from farpoint.metrics import chi2_quantile
from farpoint.synthetic import RenderedSequence, street_drive
from farpoint.trajectory.files import Trajectory, read_tum


def covered(errors: RenderedErrors) -> tuple[float, float]:
    """Shares of the pairs whose rotation and direction are within their 95 % regions."""
    return (
        float(np.mean(errors.rotation_nees <= chi2_quantile(0.95, 3))),
        float(np.mean(errors.direction_nees <= chi2_quantile(0.95, 2))),
    )


def room_walk(data: Path, frames: int, start_s: float) -> tuple[Camera, Trajectory]:
    """TUM-VI's fisheye carried as in its first room, but in the street; 20 frames a second."""
    calibration = data / "calibrations" / "kalibr_tumvi.yaml"
    camera = load_camera(calibration, "cam0")
    chain = yaml.safe_load(calibration.read_text().split("\n", 1)[1])
    body_from_cam = np.linalg.inv(np.array(chain["cam0"]["T_cam_imu"]))
    body = read_tum(data / "trajectories" / "dataset-room1_512_16.txt")
    times = body.timestamps - body.timestamps[0]
    rows = np.searchsorted(times, start_s + np.arange(frames) / 20.0)
    street_from_room = np.eye(4)  # z up becomes y down; between the houses
    street_from_room[:3] = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 24]]
    poses = street_from_room @ body.world_from_body[rows] @ body_from_cam
    left, _, right = np.linalg.svd(poses[:, :3, :3])
    poses[:, :3, :3] = left @ right  # the calibration's rotation is rounded
    return camera, Trajectory(timestamps=times[rows], world_from_body=poses)


def test_a_195_degree_fisheye_carried_through_a_room(shared_data: Path):
    walks = [room_walk(shared_data, 25, start_s) for start_s in (20.0, 60.0)]
    camera, _ = walks[0]
    assert np.rad2deg(field_of_view(camera).diagonal_rad) > 195.0
    errors = run_rendered(*(RenderedSequence(camera, path, seed=7) for _, path in walks))
    assert set(errors.statuses) == {PoseStatus.OK}
    assert np.median(errors.rotation_deg) < 0.01
    assert max(errors.bound_ratios()) < 1.6
    # Steps of 3 cm far from everything: what tracks share is counted as far as halves show it.
    assert min(covered(errors)) > 0.8


def test_a_360_camera_driven_through_the_street():
    camera = Camera(model=Equirectangular(width=1024, height=512), size=(1024, 512))
    errors = run_rendered(RenderedSequence(camera, street_drive(13, 30.0, 4), seed=7))
    assert set(errors.statuses) == {PoseStatus.OK}
    assert np.median(errors.rotation_deg) < 0.01
    assert max(errors.bound_ratios()) < 1.3
    assert min(covered(errors)) > 0.9
