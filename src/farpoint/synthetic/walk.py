"""Path of a handheld camera: a person walks along the street and looks around."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_positive
from farpoint.synthetic.paths import START, times_of, trajectory_of
from farpoint.trajectory.files import Trajectory

__all__ = ["HandheldOptions", "handheld_walk"]

_HEIGHT_M = 1.5
_FACING_DEG = 35.0  # mean viewing direction, to the right of the direction of the walk
_TREMOR_HZ = (1.5, 6.0)
_LOOK_HZ = (0.25, 0.6)
_WAVES = 3  # number of sinusoids, at random frequencies, in each oscillation


@dataclass(frozen=True, kw_only=True)
class HandheldOptions:
    """Options of the motion of a handheld camera: a steady walk plus sums of sinusoids.

    Attributes
    ----------
    speed_m_s : float
        Speed of the walk, m/s, -5 to 5; 0 for a standing person.
    step_hz : float
        Steps per second. The body bobs once per step and sways once per two steps.
    bob_m : float
        Amplitude of the bob and of the sway, m, 0 to 0.2.
    look_deg : float
        Amplitude of the slow yaw by which the person looks around, deg, 0 to 60, with frequencies
        of 0.25 to 0.6 Hz. Pitch and roll have half the amplitude.
    tremor_deg : float
        Amplitude of the tremor of the hand about each axis, deg, 0 to 5, with frequencies of 1.5 to
        6 Hz.
    """

    speed_m_s: float = 1.3
    step_hz: float = 1.9
    bob_m: float = 0.02
    look_deg: float = 15.0
    tremor_deg: float = 0.2

    def __post_init__(self) -> None:
        coerce_float(self, "-5 to 5", lambda speed: -5 <= speed <= 5, "speed_m_s")
        coerce_positive(self, "step_hz")
        coerce_float(self, "0 to 0.2", lambda bob: 0 <= bob <= 0.2, "bob_m")
        coerce_float(self, "0 to 60", lambda angle: 0 <= angle <= 60, "look_deg")
        coerce_float(self, "0 to 5", lambda angle: 0 <= angle <= 5, "tremor_deg")


def handheld_walk(
    frames: int, fps: float = 30.0, seed: int = 0, options: HandheldOptions | None = None
) -> Trajectory:
    """Walk along the lane with a handheld camera.

    The mean viewing direction is 35 degrees to the right of the direction of the walk.

    Parameters
    ----------
    frames : int
        Number of poses, at least 1.
    fps : float
        Frames per second.
    seed : int
        Seed of phases and frequencies.
    options : HandheldOptions, optional
        Options of the motion.

    Raises
    ------
    InputError
        If an argument is out of its range.

    Examples
    --------
    >>> walk = handheld_walk(31, seed=1, options=HandheldOptions(speed_m_s=1.2, bob_m=0.0))
    >>> way = walk.world_from_body[-1, :3, 3] - walk.world_from_body[0, :3, 3]
    >>> way.round(3).tolist()
    [0.0, 0.0, 1.2]
    """
    options = options or HandheldOptions()
    times = times_of(frames, fps)
    if seed < 0:
        raise InputError(f"expected 0 or more, got {seed}", field="seed")
    rng = np.random.default_rng((seed, 13))
    pace = 2.0 * math.pi * options.step_hz * times
    sway, bob = rng.uniform(0.0, 2.0 * math.pi, 2)
    position = np.stack(
        [
            START[0] + options.bob_m * np.sin(0.5 * pace + sway),
            -_HEIGHT_M + options.bob_m * np.sin(pace + bob),
            START[2] + options.speed_m_s * times,
        ],
        axis=1,
    )
    look = np.array([1.0, 0.5, 0.5]) * options.look_deg * _waves(times, _LOOK_HZ, rng)
    tremor = options.tremor_deg * _waves(times, _TREMOR_HZ, rng)
    turns = np.radians(np.array([_FACING_DEG, 0.0, 0.0]) + look + tremor)
    return trajectory_of(times, position, turns)


def _waves(
    times: np.ndarray, range_hz: tuple[float, float], rng: np.random.Generator
) -> np.ndarray:
    """Three smooth oscillations (N, 3) with values from -1 to 1.

    Each oscillation is a mean of waves in which slower waves have larger amplitudes.
    """
    frequencies = np.sort(rng.uniform(*range_hz, (3, _WAVES)))
    phases = rng.uniform(0.0, 2.0 * math.pi, (3, _WAVES))
    amplitudes = 1.0 / frequencies
    amplitudes /= amplitudes.sum(axis=1, keepdims=True)
    waves = np.sin(2.0 * math.pi * frequencies * times[:, None, None] + phases)
    return np.sum(amplitudes * waves, axis=2)
