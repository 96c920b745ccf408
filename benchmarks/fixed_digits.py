"""Hash every number of a fixed set of runs: the same before and after a change of names alone.

``python benchmarks/fixed_digits.py`` prints a line for each part: cameras, two-view estimates, an
inertial filter, and rendered sequences through ``farpoint demo`` and ``farpoint evaluate``.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import farpoint as fp
from farpoint.aiding import CameraHeight, KnownSpeed, MetricScale
from farpoint.camera.arctangent import Arctangent
from farpoint.camera.division import Division
from farpoint.camera.double_sphere import DoubleSphere
from farpoint.camera.extended_unified import ExtendedUnified
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.unified import Unified
from farpoint.cli.demo import Demo
from farpoint.evaluate import evaluate_folder
from farpoint.fusion import ImuNoise, InertialFilter, InertialState, StartSigmas
from farpoint.geometry import so3
from farpoint.metrics import to_json
from farpoint.sinks import OutputOptions
from farpoint.synthetic import (
    InertialPath,
    OutlierKind,
    PointSceneOptions,
    SimulatedImu,
    make_point_scene,
    paper_camera,
    render_drive,
)
from farpoint.trajectory.files import Trajectory

FILES = ("motions.csv", "trajectory.tum", "trajectory.kitti", "positions.csv", "camera.yaml")
INTRINSICS = {"fx": 250.0, "fy": 251.0, "cx": 319.0, "cy": 239.0}
MODELS = (
    Pinhole(**INTRINSICS, distortion=(-0.2, 0.05, 1e-3, 2e-3)),
    KannalaBrandt(**INTRINSICS, k1=0.02, k2=-0.005),
    Arctangent(**INTRINSICS, omega=0.9),
    Division(**INTRINSICS, k=-0.2),
    Unified(**INTRINSICS, xi=0.9),
    DoubleSphere(**INTRINSICS, xi=-0.2, alpha=0.58),
    ExtendedUnified(**INTRINSICS, alpha=0.6, beta=1.1),
)


def cameras() -> Iterator[object]:
    """Rays, pixels, Jacobians and parameter covariances of a few models."""
    grid = np.stack(np.meshgrid(np.arange(0, 640, 37.5), np.arange(0, 480, 31.25)), -1)
    pixels = grid.reshape(-1, 2)
    for model in MODELS:
        camera = fp.Camera(model=model, size=(640, 480))
        camera = camera.with_uncertainty(focal=0.005, center_px=2.0, distortion_px=1.0)
        rays = camera.unproject(pixels)
        yield rays
        yield camera.project(rays + 0.01)
        yield camera.unproject_jacobian(rays)
        yield camera.parameter_covariance()


def estimates() -> Iterator[object]:
    """Two-view estimates of point scenes."""
    uncertain = paper_camera().with_uncertainty(focal=0.005, center_px=1.0)
    for seed in range(12):
        options = PointSceneOptions(
            camera=paper_camera(),
            matches=80 + 10 * seed,
            outliers=5 * (seed % 4),
            outlier_kind=list(OutlierKind)[seed % len(OutlierKind)],
            far_share=(0.0, 0.3, 0.6, 1.0)[seed % 4],
            rotation_vector_rad=(0.01 * seed, 0.02, -0.01),
        )
        scene = make_point_scene(options, seed=seed)
        camera = uncertain if seed % 3 == 2 else scene.camera
        pose = fp.estimate_relative_pose(scene.points0, scene.points1, camera, seed=seed)
        yield (scene.points0, scene.points1, pose.status.value, pose.labels, pose.noise_px)
        yield (pose.rotation_cam1_from_cam0, pose.rotation_covariance)
        yield (pose.direction_cam1_from_cam0, pose.covariance)


def inertial() -> Iterator[object]:
    """A filter over a simulated IMU and motions of two views."""
    times = np.arange(0.0, 3.0, 0.05)
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = so3.exp(np.column_stack([0.2 * np.sin(times), 0.1 * times, times]))
    poses[:, :3, 3] = np.column_stack([2.0 * np.sin(times), np.cos(times), 0.5 * times])
    path = InertialPath(Trajectory(timestamps=times, world_from_body=poses))
    stamps, start = np.arange(401) / 200.0, StartSigmas()
    imu = SimulatedImu.on(
        path, stamps, ImuNoise(), gyro_bias=np.full(3, 1e-3), accel_bias=np.full(3, 1e-2), seed=1
    )
    first = imu.true_state(path, 0)
    fused = InertialFilter(
        InertialState.at(first.world_from_body, first.velocity), start, ImuNoise(), np.eye(4)
    )
    for k, steps in enumerate(imu.steps.parts(20)):
        fused.predict(steps)
        last = 20 * k + len(steps)
        motion = np.linalg.inv(path.pose(stamps[last])) @ path.pose(stamps[20 * k])
        options = PointSceneOptions(
            camera=paper_camera(),
            rotation_vector_rad=tuple(so3.log(motion[:3, :3])),
            translation_m=tuple(motion[:3, 3]),
        )
        scene = make_point_scene(options, seed=k)
        fused.update(fp.estimate_relative_pose(scene.points0, scene.points1, scene.camera))
        yield fused.nees(imu.true_state(path, last))
        yield fused.travel_direction()


def sequence() -> Iterator[object]:
    """A rendered drive through `Odometry`, its scale from a speed and a height."""
    camera = fp.Camera.pinhole(320, 180, 245.0, 245.0, 159.5, 89.5)
    drive = render_drive(camera, frames=14, seed=3)
    odometry = fp.Odometry(camera.with_uncertainty(focal=0.02))
    steps = np.linalg.norm(np.diff(drive.world_from_cam[:, :3, 3], axis=0), axis=1)
    middles = 0.5 * (drive.timestamps[1:] + drive.timestamps[:-1])
    scale = MetricScale(
        [
            KnownSpeed(timestamps_s=middles, speeds=steps / 0.1),
            CameraHeight(height_m=float(-drive.world_from_cam[0, 1, 3])),
        ]
    )
    for result in odometry.run(drive):
        yield (result.tracks.points1, result.tracks.covariance_px2)
        yield (result.world_from_cam, result.world_covariance, result.scale, result.scale_sigma)
        estimate = scale.add(odometry.lens.camera, result)
        yield None if estimate is None else repr(estimate)
    yield (odometry.lens.sigma, odometry.lens.readout_s, odometry.lens.readout_sigma_s)
    fit = scale.fit()
    yield None if fit is None else [fit.at(float(t), 0) for t in drive.timestamps]


def demos() -> Iterator[object]:
    """Files of ``farpoint demo``, driven and handheld, and what ``evaluate`` computes of them."""
    output = OutputOptions(overlay=False, report=False)
    for handheld, frames in ((False, 12), (True, 8)):
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            out = Path(folder)
            with contextlib.redirect_stderr(io.StringIO()):
                Demo(out=out, handheld=handheld, frames=frames, output=output)()
            for name in FILES:
                yield (name, (out / name).read_text() if (out / name).exists() else None)
            numbers = to_json(evaluate_folder(out, out / "truth.tum").evaluation)
            yield list(leaves(numbers))


def leaves(value: object) -> Iterator[object]:
    """Numbers of nested records, without their names."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from leaves(item)
    elif not isinstance(value, str):
        yield value


def digest(parts: Iterator[object]) -> str:
    """A hash of arrays, numbers and texts, bit for bit."""
    found = hashlib.sha256()

    def add(value: object) -> None:
        if isinstance(value, (tuple, list)):
            for item in value:
                add(item)
        elif isinstance(value, dict):
            add(list(value.items()))
        elif isinstance(value, np.ndarray):
            found.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
        else:
            found.update(repr(value).encode())

    for part in parts:
        add(part)
    return found.hexdigest()[:16]


if __name__ == "__main__":
    for part in (cameras, estimates, inertial, sequence, demos):
        print(f"{part.__name__:10} {digest(part())}", flush=True)
