"""A full disk at any moment: whole lines and pictures stay, and ``run.json`` says what failed.

A limit of the size of files (RLIMIT_FSIZE) stands for the full disk where no small one can be
mounted: a write then fails in the middle, as on a full disk.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from folder_kit import check_whole, pictures_in, put, record_in

from farpoint.aiding import MetricFit
from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.metrics import SplitHalf
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks.halves import HalvesFile
from farpoint.sinks.metric_files import put_in_metres
from farpoint.sinks.motions import MotionsFile
from farpoint.sinks.output_folder import OutputFolder, OutputOptions
from farpoint.sinks.overlay import OverlayVideo
from farpoint.sinks.positions import PositionsFile, write_positions_parquet
from farpoint.sinks.report import write_report
from farpoint.sinks.run_record import RunDescription, RunRecord, RunState
from farpoint.sinks.trajectory import KittiFile, TrajectoryFile
from farpoint.sinks.viewer import ViewerOptions, open_viewer

resource = pytest.importorskip("resource")  # Windows has none

MakeResult = Callable[..., OdometryResult]
CAMERA = Camera.pinhole(160, 120, 125, 125, 79.5, 59.5)
IMAGE = np.random.default_rng(0).integers(0, 255, (120, 160), np.uint8)
HALF = SplitHalf(
    statuses=(PoseStatus.OK, PoseStatus.OK), difference=np.full(5, 0.1), covariance=np.eye(5)
)


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def results(make_result: MakeResult) -> list[OdometryResult]:
    made = [make_result(k, scene_camera=CAMERA) for k in range(12)]
    return [replace(result, world_covariance=0.01 * np.eye(7)) for result in made]


@pytest.fixture
def run() -> RunDescription:
    return RunDescription(source="drive", source_name="drive", camera=CAMERA, options={})


class Halves(HalvesFile):
    """The file of split-half tests, as a sink."""

    def write(self, result: OdometryResult, halves: SplitHalf | None) -> None:
        super().write(result, halves or HALF)


@pytest.mark.parametrize("kind", [MotionsFile, TrajectoryFile, KittiFile, PositionsFile, Halves])
@pytest.mark.parametrize("size", [997, 1500])
def test_lines_are_whole(
    kind: Callable[[Path], MotionsFile], size: int, tmp_path: Path, results: list[OdometryResult]
):
    sink, path, before = kind(tmp_path / "lines"), tmp_path / "lines", b""

    def fill() -> None:
        nonlocal before
        for k in range(1000):
            before = path.read_bytes()
            sink.write(results[k % len(results)], None)

    with files_up_to(size), pytest.raises(InputError, match="lines: cannot be written: File too"):
        fill()
    assert path.read_bytes() == before
    assert 0 < len(before) <= size
    assert before.endswith(b"\n")
    sink.close()
    assert path.read_bytes() == before


def test_a_file_without_room_for_its_head_is_not_made(tmp_path: Path):
    with files_up_to(100), pytest.raises(InputError, match=r"motions\.csv: cannot be written"):
        MotionsFile(tmp_path / "motions.csv")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("size", [1000, 120_000, 199_999])
def test_a_video_plays_up_to_the_full_disk(
    size: int, tmp_path: Path, results: list[OdometryResult]
):
    video, written = OverlayVideo(tmp_path / "overlay.mp4", CAMERA), 0

    def fill() -> None:
        nonlocal written
        for k in range(1000):
            video.write(replace(results[k % 12], timestamp=float(k)), IMAGE)
            written += 1

    with files_up_to(size), pytest.raises(InputError, match=r"overlay\.mp4: cannot be written"):
        fill()
    video.write(results[0], IMAGE)  # told once
    video.close()
    if size == 1000:
        assert list(tmp_path.iterdir()) == []
    else:
        assert [path.name for path in tmp_path.iterdir()] == ["overlay.mp4"]
        assert 0 < written - 1 <= pictures_in(tmp_path / "overlay.mp4") <= written


def finished(folder: Path, run: RunDescription, results: list[OdometryResult]) -> Path:
    with OutputFolder(folder, run, OutputOptions(overlay=False)) as outputs:
        for result in results:
            outputs.write(result, IMAGE)
    return folder


METRES = MetricFit(
    times_s=np.array([100.0, 102.0]),
    segments=np.zeros(2, int),
    log_metres=np.ones(2),
    sigma=np.full(2, 0.01),
    contradictions=(),
)

LAST: dict[str, Callable[[Path], object]] = {
    "report.html": write_report,
    "positions.parquet": write_positions_parquet,
    "motions.csv": lambda folder: put_in_metres(folder, METRES),
}


@pytest.mark.parametrize("name", list(LAST))
def test_what_is_written_last_replaces_all_or_nothing(
    name: str, tmp_path: Path, run: RunDescription, results: list[OdometryResult]
):
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    folder = finished(tmp_path / "out", run, results)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    # Of the files in metres the first that has no room is named, never a part of it.
    full = r"/(positions|motions)\.csv" if name == "motions.csv" else name
    with files_up_to(900), pytest.raises(InputError, match=rf"{full}: cannot be written"):
        LAST[name](folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    LAST[name](folder)
    assert (folder / name).read_bytes() != before.get(name) or name == "report.html"


@pytest.mark.parametrize(
    ("name", "why"),
    [
        *((name, "Is a directory") for name in ("positions.csv", "trajectory.tum", "motions.csv")),
        *((name, "No space left on device") for name in ("positions.csv", "motions.csv")),
    ],
)
def test_what_cannot_be_put_in_metres_is_named_by_its_final_name(
    name: str, why: str, tmp_path: Path, run: RunDescription, results: list[OdometryResult]
):
    folder = finished(tmp_path / "out", run, results)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    part = folder / f"{name}.part"
    if why.startswith("Is"):
        part.mkdir()
    elif Path("/dev/full").exists():
        part.symlink_to("/dev/full")
    else:
        pytest.skip("needs /dev/full")
    with pytest.raises(InputError) as told:
        put_in_metres(folder, METRES)
    assert str(told.value) == f"{folder / name}: cannot be written: {why}"
    with suppress(OSError):
        part.rmdir()
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("size", [1500, 2500, 60_000])
def test_a_run_says_what_failed(
    size: int, tmp_path: Path, run: RunDescription, results: list[OdometryResult]
):
    def fill() -> None:
        with OutputFolder(tmp_path, run, OutputOptions(halves_every=0)) as folder:
            for k in range(1000):
                put(folder, results[k % 12], IMAGE)

    with files_up_to(size), pytest.raises(InputError, match="cannot be written: File too") as told:
        fill()
    check_whole(tmp_path)
    record = record_in(tmp_path / "run.json")
    assert record["state"] == "failed"
    assert record["error"] == f"InputError: {told.value}"


def test_a_report_without_room_fails_the_run(
    tmp_path: Path, run: RunDescription, results: list[OdometryResult]
):
    folder = OutputFolder(tmp_path, run, OutputOptions(overlay=False))
    for result in results:
        put(folder, result, IMAGE)
    with files_up_to(20_000), pytest.raises(InputError, match=r"report\.html: cannot be written"):
        folder.close()
    check_whole(tmp_path)
    record = record_in(tmp_path / "run.json")
    assert record["state"] == "failed"
    assert "report.html" in record["error"]
    assert not (tmp_path / "report.html").exists()


def test_the_record_is_written_though_nothing_new_can_be(tmp_path: Path, run: RunDescription):
    record = RunRecord(tmp_path / "run.json", run)
    record.reserve_room()
    (tmp_path / "run.json.part").mkdir()  # no other file can be written
    record.finish(RunState.FAILED, "no room")
    record.close()
    assert record_in(tmp_path / "run.json")["error"] == "no room"
    assert {path.name for path in tmp_path.iterdir()} == {"run.json", "run.json.part"}
    with pytest.raises(InputError, match=r"run\.json: cannot be written"):
        record.finish(RunState.DONE)  # only once


def test_a_recording_without_room_is_reported_and_blocks_nothing(
    tmp_path: Path, results: list[OdometryResult]
):
    pytest.importorskip("rerun")
    with files_up_to(50_000):
        viewer = open_viewer(ViewerOptions(rrd=tmp_path / "a.rrd"), "drive", CAMERA)

    def draw() -> None:
        for result in results:
            viewer.write(result, IMAGE)
        viewer.close()

    with pytest.raises(InputError, match=r"a\.rrd: cannot be written to its end"):
        draw()
    viewer.close()


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Callable[[int], Path]]:
    """``small_disk(bytes)`` is a folder with so much room, where the system lets us make one."""
    place = tmp_path / "disk"
    place.mkdir()

    def mount(size: int) -> Path:
        command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
        try:
            subprocess.run(command, check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError):
            pytest.skip("no file system can be mounted")
        return place

    yield mount
    if place.is_mount():
        subprocess.run(["umount", str(place)], check=True)


@pytest.mark.parametrize("size_kb", [60, 136, 148, 200, 340])
def test_a_disk_that_is_full(
    size_kb: int,
    small_disk: Callable[[int], Path],
    run: RunDescription,
    results: list[OdometryResult],
):
    out = small_disk(size_kb << 10) / "out"

    def fill() -> None:
        with OutputFolder(out, run, OutputOptions(halves_every=1)) as folder:
            for k in range(200):
                result = replace(results[k % 12], timestamp=float(k))
                put(folder, result, IMAGE)
                folder.write_halves(result, HALF)

    with pytest.raises(InputError, match="cannot be written: No space left") as told:
        fill()
    check_whole(out)
    record = record_in(out / "run.json")
    assert (record["state"], record["error"]) == ("failed", f"InputError: {told.value}")
