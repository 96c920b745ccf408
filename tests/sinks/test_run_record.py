"""run.json: whole at any moment, the same for the same run but for the wall clock."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks import run_record
from farpoint.sinks.plain import plain
from farpoint.sinks.run_record import RunDescription, RunRecord, RunState, read_run

MakeResult = Callable[..., OdometryResult]
IMAGE = np.zeros((480, 640), np.uint8)


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True, kw_only=True)
class Inner:
    limit: float = float("inf")
    colour: Colour = Colour.RED


@dataclass(frozen=True, kw_only=True)
class Outer:
    inner: Inner
    folder: Path
    weights: np.ndarray


def description(camera: Camera) -> RunDescription:
    outer = Outer(inner=Inner(), folder=Path("a/b"), weights=np.array([1.0, np.nan]))
    return RunDescription(
        source="drive.mp4", source_name="drive", camera=camera, options={"outer": outer, "seed": 3}
    )


def record_run(path: Path, camera: Camera, results: list[OdometryResult]) -> dict:
    record = RunRecord(path, description(camera))
    for result in results:
        record.write(result, IMAGE)
    record.finish(RunState.DONE)
    return read_run(path)


def test_settings_become_plain_values() -> None:
    outer = Outer(inner=Inner(), folder=Path("a/b"), weights=np.array([1.0, np.nan]))
    assert plain({"outer": outer, 1: np.float32(0.5), "none": None, "yes": True}) == {
        "outer": {
            "inner": {"limit": "inf", "colour": "red"},
            "folder": "a/b",
            "weights": [1.0, "nan"],
        },
        "1": 0.5,
        "none": None,
        "yes": True,
    }


def test_it_says_running_from_the_start(tmp_path: Path, camera: Camera) -> None:
    RunRecord(tmp_path / "run.json", description(camera))
    run = read_run(tmp_path / "run.json")
    assert run["state"] == "running"
    assert run["options"]["outer"]["inner"]["colour"] == "red"
    assert run["camera"]["parameters"]["fx"] == 500.0
    assert run["versions"]["numpy"] == np.__version__
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]


def test_counts_times_and_reasons(tmp_path: Path, camera: Camera, make_result: MakeResult) -> None:
    statuses = [PoseStatus.OK, PoseStatus.FAILED, PoseStatus.OK, PoseStatus.STATIC]
    results = [make_result(0)]
    results += [make_result(k + 1, s, reason=f"why {k}") for k, s in enumerate(statuses)]
    run = record_run(tmp_path / "run.json", camera, results)
    assert run["frames"] == 5
    assert run["pairs"] == {"OK": 2, "ROTATION_ONLY": 0, "STATIC": 1, "FAILED": 1}
    assert (run["first_timestamp"], run["last_timestamp"]) == (100.0, results[-1].timestamp)
    assert [(item["frame1"], item["status"], item["reason"]) for item in run["reasons"]] == [
        (2, "FAILED", "why 1"),
        (4, "STATIC", "why 3"),
    ]
    assert run["wall_clock"]["stages_s"]["refinement"] == pytest.approx(4 * 0.002)


def test_reasons_are_bounded_and_failures_are_not_drowned(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    hovering = make_result(1, PoseStatus.ROTATION_ONLY)
    failed = make_result(2, PoseStatus.FAILED, reason="a hard cut")
    run = record_run(tmp_path / "run.json", camera, [hovering] * 500 + [failed])
    assert run["reasons"][-1]["reason"] == "a hard cut"
    assert len(run["reasons"]) == 101
    assert run["reasons_omitted"] == 400


def test_guesses_of_the_scale_are_listed_up_to_a_bound(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    known = make_result(1)
    guessed = [replace(make_result(k), scale_is_guessed=True) for k in range(1, 121)]
    run = record_run(tmp_path / "run.json", camera, [known, *guessed])
    assert run["scale_guesses"] == 120
    assert [guess["frame"] for guess in run["scale_guessed_at"]] == list(range(1, 101))
    assert run["scale_guessed_at"][3]["timestamp"] == guessed[3].timestamp
    assert record_run(tmp_path / "run.json", camera, [known])["scale_guesses"] == 0


def test_the_same_run_writes_the_same_but_for_the_wall_clock(
    tmp_path: Path, camera: Camera, make_result: MakeResult
) -> None:
    texts = []
    for name in ("a.json", "b.json"):
        run = record_run(tmp_path / name, camera, [make_result(k) for k in range(4)])
        del run["wall_clock"]
        texts.append(json.dumps(run))
    assert texts[0] == texts[1]


def test_it_is_replaced_as_a_whole_while_the_run_goes_on(
    tmp_path: Path, camera: Camera, make_result: MakeResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_record, "_UPDATE_S", 0.0)
    path = tmp_path / "run.json"
    record = RunRecord(path, description(replace(camera, size=None)))
    assert read_run(path)["camera"]["size"] is None
    for k in range(3):
        record.write(make_result(k), IMAGE)
        assert read_run(path)["frames"] == k + 1
    assert read_run(path)["camera"]["size"] == [640, 480]
    record.finish(RunState.FAILED, "OSError: disk full")
    assert read_run(path)["error"] == "OSError: disk full"


@pytest.mark.parametrize(
    ("text", "message"),
    [("{", "expected JSON"), ("[]", "state: missing"), ('{"state": "done"}', "source: missing")],
)
def test_damage_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(InputError, match=rf"run\.json: {message}"):
        read_run(tmp_path / "run.json")


def test_a_missing_record_and_an_unwritable_place_are_named(tmp_path: Path, camera: Camera) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_run(tmp_path / "run.json")
    with pytest.raises(InputError, match=r"gone/run\.json: cannot be written"):
        RunRecord(tmp_path / "gone" / "run.json", description(camera))
