"""Figures of the README, and in the prose of the docs, are those of ``docs/measured``, rounded."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PROMISE = ROOT / "docs" / "promise.md"
MEASURED = ROOT / "docs" / "measured"

Row = dict[str, Any]


def measured(file: str) -> list[Row]:
    """Rows of a table, by its columns."""
    table = json.loads((MEASURED / f"{file}.json").read_text())
    names = [column["name"] for column in table["columns"]]
    return [dict(zip(names, row, strict=True)) for row in table["rows"]]


def words_of(page: Path) -> str:
    """Text of a page, its lines joined."""
    return " ".join(page.read_text().split())


def command_of(file: str) -> str:
    """What stands behind ``--tables`` in the command of a table, without its seed and grid."""
    words = shlex.split(json.loads((MEASURED / f"{file}.json").read_text())["command"])
    assert words[:3] == ["farpoint", "bench", "--tables"]
    return re.sub(r" --seed 0\b| --grid\..*", "", " ".join(words[3:]))


def only(file: str, **where: Any) -> Row:
    """The row of a table with these cells."""
    [row] = [row for row in measured(file) if all(row[k] == v for k, v in where.items())]
    return row


def tables_of(text: str, heading: str) -> list[list[Row]]:
    """Tables of a section, each of them as rows by its columns."""
    [section] = re.findall(rf"^## {heading}$(.*?)(?=^## |\Z)", text, re.M | re.S)
    tables = re.findall(r"(?:^\|.*\n)+", section, re.M)
    return [_rows(table) for table in tables]


def _rows(table: str) -> list[Row]:
    lines = [[c.strip() for c in line.strip("|").split("|")] for line in table.splitlines()]
    header, _, *rows = lines
    return [dict(zip(header, row, strict=True)) for row in rows]


def differences(
    rows: list[Row], find: Callable[[Row], Row], columns: dict[str, str]
) -> list[tuple[str, str, float]]:
    """Figures that are not those measured, rounded to as many digits as are written."""
    wrong = []
    for row in rows:
        found = find(row)
        for column, name in columns.items():
            if row[column]:
                digits = len(row[column].partition(".")[2])
                if f"{found[name]:.{digits}f}" != row[column]:
                    wrong.append((column, row[column], found[name]))
    return wrong


ACCURACY = {
    "cases": "cases",
    "rotation": "rotation_ratio",
    "direction": "direction_ratio",
    "better": "better",
    "worse": "worse",
}
PAPER = {
    "rotation x": "rotation_x_deg",
    "rotation y": "rotation_y_deg",
    "rotation z": "rotation_z_deg",
    "direction": "direction_deg",
}
PAPER_METHODS = {
    "Burschka and Mair (2008)": "Burschka & Mair 2008",
    "farpoint, their closed form": "farpoint, closed form",
    "farpoint": "farpoint",
    "Cramer-Rao bound, depths unknown": "Cramer-Rao bound",
}
HONESTY = {"pose": "pose_95", "rotation": "rotation_95"}


def near(outliers: int, matches: int) -> Row:
    return only(
        "coverage_summary", scenes="near points", outliers_percent=outliers, matches=matches
    )


def pure_rotation_row(outliers: int, matches: int) -> Row:
    return only(
        "coverage_summary", scenes="rotation only", outliers_percent=outliers, matches=matches
    )


FILES = {"coverage": "coverage_summary", "lenses": "wide", "halves": "halves"}
"""Files of the tables that the README names in the section on honesty."""
COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")

SCENES: dict[str, Callable[[], Row]] = {
    "simulated, 90 matches, 20 of 100 wrong": lambda: near(20, 90),
    "simulated, 500 matches, 50 of 100 wrong": lambda: near(50, 500),
    "simulated pure rotation, 90 matches, 20 of 100 wrong": lambda: pure_rotation_row(20, 90),
    "rendered streets, 195-degree fisheye": lambda: only("wide", lens="fisheye, 195 deg"),
    "KITTI 00, disjoint tracks": lambda: only("halves", sequence="kitti_00"),
    "camera in the hand (HoloLens), disjoint tracks": lambda: only("halves", sequence="hololens"),
    "traffic through a windscreen, disjoint tracks": lambda: only(
        "halves", sequence="dashcam_gyro"
    ),
}


def test_ratios_to_peers_are_those_measured():
    steps, _ = tables_of(README.read_text(), "Accuracy")
    assert len(steps) >= 4

    def find(row: Row) -> Row:
        return only("steps_summary", sequence="all together", peer=row["peer"])

    assert differences(steps, find, ACCURACY) == []


def test_errors_in_the_simulation_are_those_measured():
    _, paper = tables_of(README.read_text(), "Accuracy")
    assert {row["method"] for row in paper} == set(PAPER_METHODS)

    def find(row: Row) -> Row:
        return only("paper", method=PAPER_METHODS[row["method"]])

    assert differences(paper, find, PAPER) == []


def test_shares_in_95_percent_are_those_measured():
    [scenes] = tables_of(README.read_text(), "Honesty")
    assert {row["scenes"] for row in scenes} == set(SCENES)

    def find(row: Row) -> Row:
        return {"rotation_95": None, **SCENES[row["scenes"]]()}

    assert differences(scenes, find, HONESTY) == []


PEERS = {
    "PoseLib": ("PoseLib", "PoseLib tuned"),
    "pycolmap": ("pycolmap", "pycolmap tuned"),
    "OpenCV RANSAC": ("OpenCV RANSAC",),
    "USAC_MAGSAC": ("OpenCV USAC_MAGSAC",),
    "USAC_ACCURATE": ("OpenCV USAC_ACCURATE",),
}
ACCURATE = "OpenCV_USAC_ACCURATE_ms"


def over_farpoint(file: str, **where: float) -> float:
    row = only(file, **where)
    return row[ACCURATE] / row["farpoint_ms"]


def on_real_pairs(data: str) -> float:
    return only("pairs", data=data, estimator="OpenCV USAC_ACCURATE")["time_over_farpoint"]


SLOWER: dict[str, Callable[[], list[float]]] = {
    "8; 20": lambda: [over_farpoint("time_matches", matches=n) for n in (8, 20)],
    "110, steps of 1 cm; 5 mm; 2 mm": lambda: [
        over_farpoint("time_baselines", baseline_cm=cm) for cm in (1.0, 0.5, 0.2)
    ],
    "KITTI; handheld; quick turns with blur": lambda: [
        on_real_pairs(data) for data in ("kitti_00", "hololens", "tum_fr1_rpy")
    ],
}


def rounded(value: float) -> str:
    """Two digits, whole numbers from 10 on."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}"


def test_times_of_peers_are_those_measured():
    [times] = tables_of(README.read_text(), "Time")
    for row in times[:2]:
        matches = int(row["matches"].split(",")[0])
        of = {r["estimator"]: r for r in measured("time") if r["matches"] == matches}
        assert row["farpoint"] == f"{of['farpoint']['median_ms']:.2f} ms"
        for column, names in PEERS.items():
            first, *tuned = (rounded(of[name]["time_over_farpoint"]) for name in names)
            assert row[column] == " ".join([first, *(f"({each})" for each in tuned)])
    assert {row["matches"] for row in times[2:]} == set(SLOWER)
    for row in times[2:]:
        ratios = SLOWER[row["matches"]]()
        assert row["USAC_ACCURATE"] == "; ".join(map(rounded, ratios))


def test_commands_of_the_times_are_those_that_measured_them():
    for file in ("time", "time_matches", "time_baselines", "start"):
        assert command_of(file) == "time"
    assert set(command_of("pairs").split()) == {"pairs", "--full", "--data", "DIR"}
    for words in ("time`", "pairs --full --data DIR`"):
        assert f"`farpoint bench --tables {words}" in words_of(README)


def test_the_first_estimates_take_what_was_measured():
    cold, warm = (only("start", start=name)["first_estimate_s"] for name in ("cold", "warm"))
    assert f"compiles for {cold:.0f} s" in words_of(README)
    assert f"process takes {warm:.1f} s" in words_of(README)


def test_commands_beside_the_shares_are_those_that_measured_them():
    [scenes] = tables_of(README.read_text(), "Honesty")
    [column] = [name for name in scenes[0] if name.startswith("`farpoint bench")]
    for row in scenes:
        command = row[column].strip("`")
        assert command == command_of(FILES[command.split()[0]])


def test_recordings_behind_the_ratios_are_as_many_as_measured():
    recordings = {row["sequence"] for row in measured("steps_summary")} - {"all together"}
    assert f"on {COUNTS[len(recordings)]} recordings, with images 1," in words_of(README)
    assert f"`farpoint bench --tables {command_of('steps_summary')}`" in words_of(README)


def test_what_halves_of_real_video_lead_to_expect_is_what_was_measured():
    ratios, shares = (
        [row[name] for row in measured("halves") if row[name] is not None]
        for name in ("ratio", "pose_95")
    )
    text = (
        f"are {min(ratios):.1f} to {max(ratios):.1f} times what the covariances state; "
        f"{min(shares):.2f} to {max(shares):.2f} of them lie in their 95 % regions "
        f"({min(shares):.2f} in a nearly pure rotation, where few pairs have a direction)."
    )
    assert text in words_of(PROMISE)
    assert only("halves", pose_95=min(shares))["sequence"] == "tum_fr1_rpy"


def test_false_alarms_of_pure_rotations_are_those_measured():
    rows = [row for row in measured("coverage_summary") if row["scenes"] == "rotation only"]
    ok, pairs = (sum(row[name] for row in rows) for name in ("OK", "pairs"))
    assert f"reported as `OK` in {ok} of {pairs}" in words_of(README)


@pytest.mark.parametrize(("written", "expected"), [("0.94", []), ("0.95", [0.944]), ("", [])])
def test_a_figure_that_is_not_the_one_measured_is_found(written: str, expected: list[float]):
    rows = [{"scenes": "a", "pose": written}]
    found = differences(rows, lambda _: {"pose_95": 0.944}, {"pose": "pose_95"})
    assert [value for _, _, value in found] == expected
