"""Fuse seen motions with an IMU on a simulated flight, and print what each is worth.

A body flies loops (or the path of a TUM file: --trajectory), an IMU on it is simulated, and for
every pair of images matches of points near and far, a fifth of them wrong, are given to
`estimate_relative_pose`. What it says goes into the filter with its own covariance.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

import farpoint as fp
from farpoint.fusion import ImuNoise, ImuSteps, InertialFilter, InertialState, StartSigmas
from farpoint.fusion.state import KNOWN, retract
from farpoint.geometry import so3, sphere
from farpoint.synthetic import (
    InertialPath,
    PointSceneOptions,
    SimulatedImu,
    make_point_scene,
    paper_camera,
)
from farpoint.trajectory.files import Trajectory, read_tum

IMU_HZ, STEPS_PER_IMAGE = 200, 20
NOISE, START = ImuNoise(), StartSigmas()
BODY_FROM_CAM = np.eye(4)  # the camera looks along the body's x axis
BODY_FROM_CAM[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
COLUMNS = ("attitude, deg", "direction, deg", "speed, m/s", "NEES / 12")


@dataclass(frozen=True, kw_only=True, eq=False)
class Image:
    """What lies between an image and the one before: felt, seen, and true."""

    steps: ImuSteps
    pose: fp.RelativePose
    state: InertialState


def loops(seconds: float) -> Trajectory:
    """Loops of a few metres at about 1.5 m/s, turning all the while."""
    times = np.arange(0.0, seconds + 1.0, 0.05)
    phase = 0.7 * times
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = so3.exp(np.column_stack([0.2 * np.sin(1.3 * phase), 0.1 * phase, phase]))
    poses[:, :3, 3] = np.column_stack(
        [2.0 * np.sin(phase), 1.5 * np.sin(2.0 * phase), 0.5 * np.cos(1.7 * phase)]
    )
    return Trajectory(timestamps=times, world_from_body=poses)


def flight(path: InertialPath, seconds: float, seed: int) -> tuple[InertialState, list[Image]]:
    """The first state and all that follows."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(seconds * IMU_HZ) + 1) / IMU_HZ
    biases = {
        "gyro_bias": START.gyro_bias * rng.normal(size=3),
        "accel_bias": START.accel_bias * rng.normal(size=3),
    }
    imu = SimulatedImu.on(path, times, NOISE, **biases, seed=seed)
    images = []
    for k, steps in enumerate(imu.steps.parts(STEPS_PER_IMAGE)):
        first, last = k * STEPS_PER_IMAGE, k * STEPS_PER_IMAGE + len(steps)
        cam0, cam1 = (path.pose(times[step]) @ BODY_FROM_CAM for step in (first, last))
        pose = seen(np.linalg.inv(cam1) @ cam0, seed=1000 * seed + k)
        images.append(Image(steps=steps, pose=pose, state=imu.true_state(path, last)))
    return imu.true_state(path, 0), images


def seen(cam1_from_cam0: np.ndarray, seed: int) -> fp.RelativePose:
    """Estimate the motion from 110 matches, 20 of them wrong, with noise of 0.22 px."""
    options = PointSceneOptions(
        camera=paper_camera(),
        rotation_vector_rad=tuple(so3.log(cam1_from_cam0[:3, :3])),
        translation_m=tuple(cam1_from_cam0[:3, 3]),
    )
    scene = make_point_scene(options, seed=seed)
    return fp.estimate_relative_pose(scene.points0, scene.points1, scene.camera)


def uncertain(truth: InertialState, seed: int) -> InertialState:
    """A first estimate as wrong as START says; of the biases nothing is known."""
    error = np.zeros(18)
    covariance = START.covariance()[KNOWN, KNOWN]
    error[KNOWN] = np.random.default_rng([seed, 1]).multivariate_normal(np.zeros(12), covariance)
    wrong = retract(truth, error)
    return InertialState.at(wrong.world_from_body, wrong.velocity)


def claiming(pose: fp.RelativePose, factor: float) -> fp.RelativePose:
    """The same estimate with another covariance; with 0, not seen at all."""
    if factor == 0.0 or pose.rotation_covariance is None:
        return replace(pose, rotation_covariance=None, covariance=None)
    full = None if pose.covariance is None else factor * pose.covariance
    return replace(pose, rotation_covariance=factor * pose.rotation_covariance, covariance=full)


def filtered(start: InertialState, images: list[Image], factor: float) -> Iterator[list[float]]:
    """Errors after every image in the order of COLUMNS."""
    fused = InertialFilter(start, START, NOISE, BODY_FROM_CAM, gate=1.0)
    for image in images:
        fused.predict(image.steps)
        fused.update(claiming(image.pose, factor))
        estimate, true = fused.state.velocity_body, image.state.velocity_body
        turned = so3.angle_between(fused.state.world_from_body, image.state.world_from_body)
        off = sphere.angle_between(sphere.normalize(estimate), sphere.normalize(true))
        faster = np.linalg.norm(estimate) - np.linalg.norm(true)
        nees = fused.nees(image.state) / 12.0
        yield [np.rad2deg(turned), np.rad2deg(off), float(faster), nees]


def camera_alone(start: InertialState, images: list[Image], truths: list) -> Iterator[list[float]]:
    """The first attitude with the rotations chained to it, and each pair's own direction."""
    world_from_cam = start.world_from_body @ BODY_FROM_CAM[:3, :3]
    for image, cam1_from_cam0 in zip(images, truths, strict=True):
        if image.pose.rotation_cam1_from_cam0 is not None:
            world_from_cam = world_from_cam @ image.pose.rotation_cam1_from_cam0.T
        true = image.state.world_from_body @ BODY_FROM_CAM[:3, :3]
        direction = image.pose.direction_cam1_from_cam0
        off = np.nan
        if direction is not None:
            off = sphere.angle_between(direction, sphere.normalize(cam1_from_cam0[:3, 3]))
        turned = so3.angle_between(world_from_cam, true)
        yield [np.rad2deg(turned), np.rad2deg(off), np.nan, np.nan]


def true_motions(path: InertialPath, images: list[Image]) -> list[np.ndarray]:
    """``cam1_from_cam0`` (4, 4) of every pair."""
    times = np.concatenate([[0.0], np.cumsum([image.steps.dt.sum() for image in images])])
    poses = [path.pose(time) @ BODY_FROM_CAM for time in times]
    return [np.linalg.inv(b) @ a for a, b in pairwise(poses)]


def main() -> None:
    """Fly, and print the root mean squares over the second half of the flights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trajectory", type=Path, help="TUM file of the body, z up")
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--flights", type=int, default=10)
    options = parser.parse_args()
    file = options.trajectory
    path = InertialPath(loops(options.seconds) if file is None else read_tum(file))
    rows: dict[str, list] = {}
    for seed in range(options.flights):
        truth, images = flight(path, options.seconds, seed)
        start = uncertain(truth, seed)
        for name, errors in (
            ("camera alone", camera_alone(start, images, true_motions(path, images))),
            ("IMU alone", filtered(start, images, 0.0)),
            ("both", filtered(start, images, 1.0)),
            ("both, covariance / 10", filtered(start, images, 0.1)),
        ):
            rows.setdefault(name, []).append(list(errors))
    print(f"{'':22}" + "".join(f"{name:>16}" for name in COLUMNS))
    for name, flights in rows.items():
        second_half = np.array(flights)[:, len(flights[0]) // 2 :]
        with np.errstate(invalid="ignore"):
            rms = np.sqrt(np.nanmean(second_half[..., :2] ** 2, axis=(0, 1)))
        cells = [*rms, np.sqrt(np.mean(second_half[..., 2] ** 2)), np.mean(second_half[..., 3])]
        shown = ("-" if np.isnan(cell) else f"{cell:.3g}" for cell in cells)
        print(f"{name:22}" + "".join(f"{cell:>16}" for cell in shown))


if __name__ == "__main__":
    main()
