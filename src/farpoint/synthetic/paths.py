"""Camera paths through the street: a drive with turns, recorded motions, and simple motions.

Poses are ``world_from_cam`` in the world of `farpoint.synthetic.street`: x right, y down, z
forward, the ground at y = 0. The same arguments give the same poses, bit for bit.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from scipy.spatial.transform import Rotation

from farpoint.errors import InputError
from farpoint.metrics import poses_at_times
from farpoint.synthetic.street import BLOCK_M, LANE_M
from farpoint.trajectory.files import Trajectory

__all__ = [
    "CAMERA_HEIGHT_M",
    "START",
    "carried",
    "pure_rotation",
    "sideways",
    "standing_still",
    "street_drive",
    "times_of",
    "trajectory_of",
]

CAMERA_HEIGHT_M = 1.65
_START_M = 14.0  # z of the first position of all paths except `carried`
START = np.array([LANE_M, -CAMERA_HEIGHT_M, _START_M])
_BETWEEN_M = 20.0  # mean z of the positions of a recorded motion
_LEAST_HEIGHT_M = 1.0
# Rotation from axes x ahead, y left, z up to axes x right, y down, z ahead.
_CAMERA_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
_STEP_M = 0.05  # distance between the samples of a route
_SPEED = 9.0  # m/s on straight streets
_LATERAL_ACCELERATION = 2.2  # m/s^2 allowed in turns
_BRAKING_M = 6.0  # length of the minimum filter, and sigma of the Gaussian filter, of the speed
# Distance from the start of a right (1) or left (-1) turn to the intersection of the two lanes.
_REACH_M = {
    1: 9.0,
    -1: 13.0,
}


def street_drive(frames: int, fps: float = 10.0, seed: int = 0) -> Trajectory:
    """Drive on the right-hand lane with turns at crossings, braking, and sway of the vehicle.

    Parameters
    ----------
    frames : int
        Number of poses, at least 1.
    fps : float
        Frames per second. The speed is about 9 m/s on straight streets and 50 % of that in turns.
    seed : int
        Seed of the route and the sway.

    Raises
    ------
    InputError
        If an argument is out of its range.
    """
    times = times_of(frames, fps)
    if seed < 0:
        raise InputError(f"expected 0 or more, got {seed}", field="seed")
    route_rng, sway_rng = (np.random.default_rng((seed, stream)) for stream in (11, 12))
    heading = _headings(route_rng, 30.0 + 1.3 * _SPEED * times[-1])
    along = _STEP_M * np.arange(len(heading))
    right = cumulative_trapezoid(np.sin(heading), along, initial=0.0)
    forward = cumulative_trapezoid(np.cos(heading), along, initial=0.0)
    curvature = np.gradient(heading, _STEP_M)
    speed = _speeds(curvature, along, sway_rng)
    clock = cumulative_trapezoid(1.0 / speed, along, initial=0.0)
    at = CubicSpline(clock, along)(times)
    table = np.stack([right, forward, heading, speed**2 * curvature], axis=1)
    x, z, yaw, lateral = CubicSpline(along, table)(at).T
    braking = CubicSpline(clock, speed)(times, 1)
    sway = _sway(times, sway_rng)
    # The vehicle leans to the outside of a turn, and the front dips under braking.
    pitch = np.radians(sway[0] + 0.25 * braking - 1.0)
    roll = np.radians(sway[1] - 0.35 * lateral)
    aside = 0.15 * np.sin(2.0 * math.pi * at / 47.0 + sway_rng.uniform(0.0, 6.3))
    position = np.stack(
        [
            LANE_M + x + aside * np.cos(yaw),
            -CAMERA_HEIGHT_M + 0.025 * sway[2],
            _START_M + z - aside * np.sin(yaw),
        ],
        axis=1,
    )
    turns = np.stack([yaw + np.radians(0.4 * sway[3]), pitch, roll], axis=1)
    return trajectory_of(times, position, turns)


def carried(body: Trajectory, start_s: float, frames: int, fps: float) -> Trajectory:
    """Recorded motion of a hand or a drone, moved to the street; the camera looks forward.

    The camera looks along the x axis of the body.

    Parameters
    ----------
    body : Trajectory
        Poses ``world_from_body`` with time stamps. The axes of the world and of the body are x
        ahead, y left, z up.
    start_s : float
        Time of the first frame, s after the first pose of ``body``.
    frames : int
        Number of poses, at least 1.
    fps : float
        Frames per second.

    Returns
    -------
    Trajectory
        Poses ``world_from_cam`` above the road. The lowest pose is one metre above ground.

    Raises
    ------
    InputError
        If an argument is out of its range, or if ``body`` does not cover the time of all frames.
    """
    times = _finite(start_s, "start_s") + times_of(frames, fps)
    if body.timestamps is None:
        raise InputError("expected poses with their times", field="body")
    since = body.timestamps - body.timestamps[0]
    measured = poses_at_times(since, body.world_from_body, times)
    if np.isnan(measured).any():
        raise InputError(
            f"expected poses without a gap from {times[0]:g} to {times[-1]:g} s", field="body"
        )
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, :3, :3] = _CAMERA_FROM_BODY @ measured[:, :3, :3] @ _CAMERA_FROM_BODY.T
    ways = measured[:, :3, 3] @ _CAMERA_FROM_BODY.T
    lowest = ways[:, 1].max()
    middle = np.array([ways[:, 0].mean(), lowest + _LEAST_HEIGHT_M, ways[:, 2].mean()])
    poses[:, :3, 3] = ways - middle + np.array([LANE_M, 0.0, _BETWEEN_M])
    return Trajectory(timestamps=times, world_from_body=poses)


def pure_rotation(frames: int, fps: float = 30.0, *, rate_deg_s: float = 20.0) -> Trajectory:
    """Rotation without translation: oscillations of yaw, pitch and roll.

    Parameters
    ----------
    rate_deg_s : float
        Largest rate of the yaw, deg/s. The largest rates of pitch and roll are about half of this
        rate.
    """
    times = times_of(frames, fps)
    rate = math.radians(_finite(rate_deg_s, "rate_deg_s"))
    pace = np.array([0.9, 1.3, 1.7])  # rad/s
    turns = np.array([1.0, 0.45, 0.5]) * rate / pace * np.sin(pace * times[:, None])
    return trajectory_of(times, np.broadcast_to(START, (frames, 3)), turns)


def standing_still(frames: int, fps: float = 30.0) -> Trajectory:
    """Camera at rest that looks along the street."""
    times = times_of(frames, fps)
    return trajectory_of(times, np.broadcast_to(START, (frames, 3)), np.zeros((frames, 3)))


def sideways(frames: int, fps: float = 30.0, *, speed_m_s: float = 1.5) -> Trajectory:
    """Translation along the street at constant speed; the camera looks to the left."""
    times = times_of(frames, fps)
    position = START + times[:, None] * np.array([0.0, 0.0, _finite(speed_m_s, "speed_m_s")])
    turns = np.broadcast_to([-math.pi / 2, 0.0, 0.0], (frames, 3))
    return trajectory_of(times, position, turns)


def times_of(frames: int, fps: float) -> np.ndarray:
    """Times (N,) of the frames, s. An argument out of range raises an InputError."""
    if frames < 1:
        raise InputError(f"expected at least 1, got {frames}", field="frames")
    if _finite(fps, "fps") <= 0.0:
        raise InputError(f"expected more than 0, got {fps}", field="fps")
    return np.arange(frames) / fps


def _finite(value: float, field: str) -> float:
    if not math.isfinite(value):
        raise InputError(f"expected a finite number, got {value}", field=field)
    return value


def trajectory_of(times: np.ndarray, position: np.ndarray, turns: np.ndarray) -> Trajectory:
    """Poses from positions (N, 3) and angles (N, 3), rad: yaw to the right, pitch up, roll."""
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("YXZ", turns).as_matrix()
    poses[:, :3, 3] = position
    return Trajectory(timestamps=times, world_from_body=poses)


def _headings(rng: np.random.Generator, length_m: float) -> np.ndarray:
    """Headings (N,), rad to the right of z, every `_STEP_M` along ``length_m`` of a route."""
    unit = np.linspace(0.0, 1.0, 2001)
    ease = unit**3 * (10.0 - 15.0 * unit + 6.0 * unit**2)
    # Distance by which a turn of arc length 1 advances along each of the two streets.
    advance = np.trapezoid(np.cos(0.5 * math.pi * ease), unit)
    marks, values = [0.0], [0.0]
    place, heading, behind = 0.0, 0.0, _START_M
    while place < length_m:
        turn = int(rng.choice([-1, 1]))
        reach, turn_m = _REACH_M[turn], _REACH_M[turn] / advance
        # The two lanes intersect LANE_M before (right turn) or after (left turn) the middle of the
        # crossing.
        straight = BLOCK_M * int(rng.integers(1, 4)) - turn * LANE_M - behind - reach
        place += straight
        marks.extend(place + turn_m * unit)
        values.extend(heading + turn * 0.5 * math.pi * ease)
        place, heading = place + turn_m, heading + turn * 0.5 * math.pi
        behind = reach + turn * LANE_M
    steps = np.arange(0.0, length_m, _STEP_M)
    return np.interp(steps, marks, values)


def _speeds(curvature: np.ndarray, along: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Speed, m/s, at every step of the route. The speed is lower in turns and varies slightly."""
    allowed = np.sqrt(_LATERAL_ACCELERATION / np.maximum(np.abs(curvature), 1e-6))
    # The speed of a turn also applies _BRAKING_M / 2 before and after the turn.
    slowest = minimum_filter1d(np.minimum(_SPEED, allowed), int(_BRAKING_M / _STEP_M))
    speed = gaussian_filter1d(slowest, _BRAKING_M / _STEP_M, mode="nearest")
    for wave_m, share in ((61.0, 0.12), (23.0, 0.05)):
        speed *= 1.0 + share * np.sin(2.0 * math.pi * along / wave_m + rng.uniform(0.0, 6.3))
    return speed


def _sway(times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Four slow oscillations (4, N) with amplitudes of about 1 and unrelated frequencies."""
    frequencies = rng.uniform((0.2, 0.6, 1.1), (0.5, 1.0, 1.8), (4, 3))
    phases = rng.uniform(0.0, 2.0 * math.pi, (4, 3))
    waves = np.sin(2.0 * math.pi * frequencies[..., None] * times + phases[..., None])
    return 0.4 * np.sum(waves * np.array([0.5, 0.35, 0.25])[:, None] / 0.44, axis=1)
