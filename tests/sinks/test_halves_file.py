"""halves.csv: every number comes back, interrupted files are read, damaged ones are named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from farpoint.errors import InputError
from farpoint.metrics import SplitHalf
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks.halves import COLUMNS, HalvesFile, read_halves

OK, TURNED, LOST = PoseStatus.OK, PoseStatus.ROTATION_ONLY, PoseStatus.FAILED


def made_half(statuses: tuple[PoseStatus, PoseStatus], dof: int, seed: int) -> SplitHalf:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(dof, dof))
    return SplitHalf(
        statuses=statuses,
        difference=rng.normal(size=dof),
        covariance=root @ root.T + np.eye(dof),
    )


HALVES = [made_half((OK, OK), 5, 1), made_half((OK, TURNED), 3, 2), made_half((LOST, OK), 0, 3)]


@pytest.fixture
def written(tmp_path: Path, make_result: Callable[..., OdometryResult]) -> Path:
    with HalvesFile(tmp_path / "halves.csv") as file:
        for k, half in enumerate(HALVES, start=1):
            file.write(make_result(k), half)
    return tmp_path / "halves.csv"


def test_every_number_comes_back(written: Path):
    for there, back in zip(HALVES, read_halves(written), strict=True):
        assert back.statuses == there.statuses
        assert (back.dof, back.nees) == (there.dof, there.nees)
        np.testing.assert_array_equal(back.difference, there.difference)
        np.testing.assert_array_equal(back.covariance, there.covariance)


def test_rows_say_which_pair_they_test_and_leave_empty_what_is_not(written: Path):
    rows = [line.split(",") for line in written.read_text().splitlines()]
    assert rows[0] == list(COLUMNS)
    assert rows[2][:8] == [
        "100.1",
        "100.2",
        "1",
        "2",
        "OK",
        "ROTATION_ONLY",
        "3",
        repr(HALVES[1].nees),
    ]
    assert rows[2][COLUMNS.index("dbeta_0")] == rows[2][COLUMNS.index("cov_03")] == ""
    assert {len(row) for row in rows} == {len(COLUMNS)}


def test_opposite_directions_stay_infinite(tmp_path: Path, make_result):
    apart = SplitHalf(
        statuses=(OK, OK), difference=np.array([0.0, 0, 0, np.inf, np.inf]), covariance=np.eye(5)
    )
    with HalvesFile(tmp_path / "halves.csv") as file:
        file.write(make_result(1), apart)
    assert read_halves(tmp_path / "halves.csv")[0].nees == np.inf


def test_a_line_that_was_being_written_is_left_out(written: Path):
    written.write_text(written.read_text()[:-10])
    assert len(read_halves(written)) == 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("timestamp0", "time", r"halves\.csv: line 1: expected the columns of halves\.csv"),
        ("ROTATION_ONLY", "TURNED", r"halves\.csv: line 3: 'TURNED' is not a valid PoseStatus"),
        ("OK,ROTATION_ONLY,3", "OK,ROTATION_ONLY,5", r"halves\.csv: line 3: expected dof 0, 3 or"),
        ("OK,OK,5,", "OK,OK,5,0.5,", r"halves\.csv: line 2: expected 28 columns, got 29"),
    ],
)
def test_damage_is_named(written: Path, old: str, new: str, message: str):
    text = written.read_text()
    assert old in text
    written.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_halves(written)


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(InputError, match=r"halves\.csv: cannot be read"):
        read_halves(tmp_path / "halves.csv")
