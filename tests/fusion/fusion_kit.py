"""Flights whose truth is known: a path, an IMU on it, and motions seen with a known covariance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from made_pose import STATS

from farpoint import PoseStatus, RelativePose
from farpoint.fusion import (
    ImuNoise,
    ImuSteps,
    InertialFilter,
    InertialState,
    Innovation,
    StartSigmas,
)
from farpoint.fusion.state import ERROR_SIZE, KNOWN, retract
from farpoint.geometry import so3, sphere
from farpoint.synthetic import InertialPath, SimulatedImu
from farpoint.trajectory.files import Trajectory

IMU_HZ, STEPS_PER_IMAGE = 100, 10
NOISE, START = ImuNoise(), StartSigmas()
SEEN = np.diag(np.deg2rad([0.02, 0.02, 0.02, 1.0, 1.0]) ** 2)
"""Covariance of a seen motion, rad^2."""

BODY_FROM_CAM = np.eye(4)
"""The camera looks along the body's x axis, a little off the IMU."""
BODY_FROM_CAM[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
BODY_FROM_CAM[:3, 3] = [0.05, 0.02, 0.01]


@cache
def winding_path(seconds: float = 20.0) -> InertialPath:
    """Loops of a few metres at about 1.5 m/s, turning all the while."""
    times = np.arange(0.0, seconds, 0.05)
    phase = 0.7 * times
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = so3.exp(np.column_stack([0.2 * np.sin(1.3 * phase), 0.1 * phase, phase]))
    poses[:, :3, 3] = np.column_stack(
        [2.0 * np.sin(phase), 1.5 * np.sin(2.0 * phase), 0.5 * np.cos(1.7 * phase)]
    )
    return InertialPath(Trajectory(timestamps=times, world_from_body=poses))


def seen_pose(
    R_true: np.ndarray, t_true: np.ndarray, rng: np.random.Generator, claim: float = 1.0
) -> RelativePose:
    """The motion with errors drawn from `SEEN`, said to have ``claim`` times that covariance."""
    error = rng.multivariate_normal(np.zeros(5), SEEN)
    true = sphere.normalize(t_true)
    # The errors across and along a basis are alike in SEEN, so it matters not whose basis it is.
    direction = sphere.retract(true, sphere.tangent_basis(true), -error[3:])
    return RelativePose(
        status=PoseStatus.OK,
        reason="Made up.",
        rotation_cam1_from_cam0=so3.exp(-error[:3]) @ R_true,
        rotation_covariance=claim * SEEN[:3, :3],
        direction_cam1_from_cam0=direction,
        direction_basis=sphere.tangent_basis(direction),
        covariance=claim * SEEN,
        labels=np.empty(0, np.uint8),
        noise_px=None,
        stats=STATS,
    )


def turned_only(pose: RelativePose) -> RelativePose:
    return replace(
        pose,
        status=PoseStatus.ROTATION_ONLY,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
    )


def failed(pose: RelativePose) -> RelativePose:
    return replace(
        turned_only(pose),
        status=PoseStatus.FAILED,
        rotation_cam1_from_cam0=None,
        rotation_covariance=None,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight:
    """A path flown: the steps between images, and the true state and motion at each of them."""

    start: InertialState
    steps: list[ImuSteps]
    states: list[InertialState]
    motions: list[tuple[np.ndarray, np.ndarray]]


def fly(path: InertialPath, seed: int, *, begin_s: float = 0.0, seconds: float = 3.0) -> Flight:
    rng = np.random.default_rng(seed)
    times = begin_s + np.arange(round(seconds * IMU_HZ) + 1) / IMU_HZ
    imu = SimulatedImu.on(
        path,
        times,
        NOISE,
        gyro_bias=START.gyro_bias * rng.normal(size=3),
        accel_bias=START.accel_bias * rng.normal(size=3),
        seed=seed,
    )
    at_images = range(0, len(times), STEPS_PER_IMAGE)
    poses = [path.pose(times[k]) @ BODY_FROM_CAM for k in at_images]
    motions = [np.linalg.inv(b) @ a for a, b in pairwise(poses)]
    return Flight(
        start=imu.true_state(path, 0),
        steps=list(imu.steps.parts(STEPS_PER_IMAGE)),
        states=[imu.true_state(path, k) for k in at_images[1:]],
        motions=[(motion[:3, :3], motion[:3, 3]) for motion in motions],
    )


def uncertain_start(truth: InertialState, seed: int) -> InertialState:
    """A first estimate with an error drawn from START; of the biases nothing is known."""
    rng = np.random.default_rng([seed, 1])
    error = np.zeros(ERROR_SIZE)
    error[KNOWN] = rng.multivariate_normal(np.zeros(12), START.covariance()[KNOWN, KNOWN])
    known = replace(truth, gyro_bias=np.zeros(3), accel_bias=np.zeros(3))
    error[6:12] = 0.0
    wrong = retract(known, error)
    return InertialState.at(wrong.world_from_body, wrong.velocity)


def new_filter(flight: Flight, seed: int, gate: float = 1.0) -> InertialFilter:
    return InertialFilter(
        uncertain_start(flight.start, seed), START, NOISE, BODY_FROM_CAM, gate=gate
    )


def fused(
    flight: Flight, seed: int, *, claim: float = 1.0, blind: bool = False
) -> Iterator[tuple[InertialFilter, Innovation, InertialState]]:
    """The filter after every image, what it learnt there, and the true state."""
    rng = np.random.default_rng([seed, 2])
    filter_ = new_filter(flight, seed)
    for steps, state, motion in zip(flight.steps, flight.states, flight.motions, strict=True):
        pose = seen_pose(*motion, rng, claim)
        filter_.predict(steps)
        yield filter_, filter_.update(failed(pose) if blind else pose), state
