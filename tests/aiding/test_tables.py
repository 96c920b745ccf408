"""Files and numbers of hints: read as they are meant, refused with the place of the fault."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.aiding import (
    CameraHeight,
    GnssPositions,
    KnownDistance,
    KnownSpeed,
    MetricOptions,
    read_gnss,
    read_speeds,
)
from farpoint.errors import InputError


def test_speeds_are_read_by_the_names_of_columns(tmp_path):
    path = tmp_path / "wheels.csv"
    path.write_text("rpm,timestamp,v\n1,0.5,3.0\n2,1.0,-4.5\n")
    times, speeds = read_speeds(path, "v")
    np.testing.assert_array_equal(times, [0.5, 1.0])
    np.testing.assert_array_equal(speeds, [3.0, 4.5])


def test_degrees_become_metres(tmp_path):
    path = tmp_path / "gnss.csv"
    path.write_text(
        "timestamp,latitude,longitude,altitude\n"
        "0,0.0,0.0,0.0\n1,0.0,0.001,0.0\n2,60.0,10.0,100.0\n3,60.001,10.0,100.0\n4,60.0,10.0,103.0\n"
    )
    _, places = read_gnss(path)
    # 0.001 degrees: of the equator, whose radius is 6378137 m, and of the meridian at 60 degrees
    # north, 111412 m a degree by the series of WGS 84.
    assert np.linalg.norm(places[1] - places[0]) == pytest.approx(111.319, abs=1e-3)
    assert np.linalg.norm(places[3] - places[2]) == pytest.approx(111.414, abs=5e-3)
    assert np.linalg.norm(places[4] - places[2]) == pytest.approx(3.0, abs=1e-6)


def test_metres_are_taken_as_they_are(tmp_path):
    path = tmp_path / "gnss.csv"
    path.write_text("timestamp,x,y,z\n0,1,2,3\n1,4,5,6\n")
    times, places = read_gnss(path)
    np.testing.assert_array_equal(times, [0.0, 1.0])
    np.testing.assert_array_equal(places, [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "line 1.*columns timestamp,speed, got none"),
        ("timestamp,v\n0,1\n1,2\n", "line 1.*columns timestamp,speed, got timestamp,v"),
        ("timestamp,speed\n0,1\n1,fast\n", "line 3.*'fast'"),
        ("timestamp,speed\n0,1\n1\n", "line 3.*cells"),
        ("timestamp,speed\n0,1\n1,nan\n", "line 3.*finite"),
        ("timestamp,speed\n1,1\n1,2\n", "line 3.*after 1.0 s"),
        ("timestamp,speed\n1,1\n", "expected at least 2 rows"),
    ],
)
def test_a_damaged_table_is_named(tmp_path, text, words):
    path = tmp_path / "speed.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"speed\.csv: {words}"):
        read_speeds(path)


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.csv: no such file"):
        read_gnss(tmp_path / "none.csv")


def test_a_latitude_beyond_the_pole_is_named(tmp_path):
    path = tmp_path / "gnss.csv"
    path.write_text("timestamp,latitude,longitude,altitude\n0,91,0,0\n1,0,0,0\n")
    with pytest.raises(InputError, match=r"gnss\.csv: row 2.*latitude"):
        read_gnss(path)


TIMES = np.array([0.0, 1.0])


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: KnownSpeed(timestamps_s=TIMES[::-1], speeds=TIMES), "timestamps_s"),
        (lambda: KnownSpeed(timestamps_s=TIMES, speeds=np.ones(3)), "speeds"),
        (lambda: KnownSpeed(timestamps_s=TIMES, speeds=-TIMES), "speeds"),
        (lambda: KnownSpeed(timestamps_s=TIMES, speeds=TIMES, sigma=0.0), "sigma"),
        (lambda: CameraHeight(height_m=-1.0), "height_m"),
        (lambda: KnownDistance(frame0=5, frame1=5, distance_m=1.0), "frame0"),
        (lambda: KnownDistance(frame0=1, frame1=5, distance_m=0.0), "distance_m"),
        (lambda: GnssPositions(timestamps_s=TIMES, positions_m=np.ones((2, 2))), "positions_m"),
        (lambda: MetricOptions(gnss_sigma=-1.0), "gnss_sigma"),
    ],
)
def test_measurements_out_of_range_are_refused(make, name):
    with pytest.raises(InputError, match=name):
        make()
