"""Samples of an IMU: what lies between two times, and files that hold them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from farpoint.errors import InputError
from farpoint.fusion import ImuNoise, ImuSamples, read_euroc_imu

TIMES = np.array([0.0, 0.1, 0.2, 0.4])


def samples() -> ImuSamples:
    """Rates that grow as straight lines, so that every mean is known."""
    ramp = np.outer(TIMES, [1.0, 2.0, 3.0])
    return ImuSamples(timestamps=TIMES, gyro=ramp, accel=9.8 - ramp)


@pytest.mark.parametrize(
    ("start_s", "end_s", "count"), [(0.0, 0.4, 3), (0.05, 0.35, 3), (0.11, 0.12, 1), (0.1, 0.2, 1)]
)
def test_steps_fill_the_interval_and_keep_the_integral(start_s: float, end_s: float, count: int):
    steps = samples().between(start_s, end_s)
    assert len(steps) == count
    assert steps.dt.sum() == pytest.approx(end_s - start_s)
    expected = 0.5 * (end_s**2 - start_s**2) * np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(steps.dt @ steps.gyro, expected, atol=1e-12)
    np.testing.assert_allclose(steps.dt @ steps.accel, 9.8 * (end_s - start_s) - expected)


def test_no_time_has_no_steps():
    assert len(samples().between(0.3, 0.3)) == 0


def test_parts_are_the_whole():
    steps = samples().between(0.05, 0.4)
    parts = list(steps.parts(2))
    assert [len(part) for part in parts] == [2, 1]
    np.testing.assert_array_equal(np.concatenate([part.gyro for part in parts]), steps.gyro)


@pytest.mark.parametrize(("start_s", "end_s"), [(-0.1, 0.2), (0.2, 0.5), (0.3, 0.2)])
def test_what_was_not_measured_is_not_made_up(start_s: float, end_s: float):
    with pytest.raises(InputError, match=r"^timestamps: expected samples from"):
        samples().between(start_s, end_s)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"gyro": np.zeros((3, 3))}, "gyro"),
        ({"accel": np.full((4, 3), np.nan)}, "accel"),
        ({"timestamps": np.array([0.0, 0.1, 0.1, 0.2])}, "timestamps"),
    ],
)
def test_samples_are_checked(changes: dict, field: str):
    arrays = {"timestamps": TIMES, "gyro": np.zeros((4, 3)), "accel": np.zeros((4, 3)), **changes}
    with pytest.raises(InputError, match=rf"^{field}: expected"):
        ImuSamples(**arrays)


def test_noise_is_positive():
    with pytest.raises(InputError, match=r"^accel_walk: expected a positive number"):
        ImuNoise(accel_walk=0.0)


def test_a_file_of_euroc(tmp_path: Path):
    path = tmp_path / "data.csv"
    path.write_text("#timestamp [ns],...\n1500000000,1,2,3,4,5,6\n1505000000,7,8,9,10,11,12\n")
    imu = read_euroc_imu(path)
    np.testing.assert_array_equal(imu.timestamps, [1.5, 1.505])
    np.testing.assert_array_equal(imu.gyro, [[1, 2, 3], [7, 8, 9]])
    np.testing.assert_array_equal(imu.accel, [[4, 5, 6], [10, 11, 12]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3\n", r"data\.csv: line 1: expected t\[ns\] and 6 numbers"),
        ("#\n1.5,1,2,3,4,5,6\n", r"data\.csv: line 2: expected t\[ns\]"),
        ("1,1,2,3,4,5,six\n", r"data\.csv: line 1: expected"),
        ("", r"data\.csv: timestamps: expected at least 2"),
        ("2,1,2,3,4,5,6\n1,1,2,3,4,5,6\n", r"data\.csv: timestamps: expected at least 2, incr"),
    ],
)
def test_damage_is_named(tmp_path: Path, text: str, message: str):
    (tmp_path / "data.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_euroc_imu(tmp_path / "data.csv")


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(InputError, match=r"gone\.csv: no such file"):
        read_euroc_imu(tmp_path / "gone.csv")
