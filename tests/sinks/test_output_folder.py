"""The folder of a run: all files valid whichever way the run ends, the same for the same run."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from folder_kit import put

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks.background import WAITING, BackgroundSink
from farpoint.sinks.motions import MotionsFile, read_motions
from farpoint.sinks.output_folder import OutputFolder, OutputOptions
from farpoint.sinks.overlay import start_video_process
from farpoint.sinks.run_record import RunDescription
from farpoint.trajectory.files import read_tum

MakeResult = Callable[..., OdometryResult]
IMAGE = np.full((480, 640), 60, np.uint8)
NAMES = {
    "motions.csv",
    "trajectory.tum",
    "trajectory.kitti",
    "positions.csv",
    "halves.csv",
    "overlay.mp4",
    "report.html",
    "run.json",
}


@pytest.fixture
def run(camera: Camera) -> RunDescription:
    return RunDescription(
        source="drive.mp4", source_name="drive", camera=camera, options={"seed": 0}
    )


def write_frames(
    folder: OutputFolder, make_result: MakeResult, count: int, then: BaseException | None = None
) -> None:
    for k in range(count):
        put(folder, make_result(k), IMAGE if k % 5 else None)
    if then is not None:
        raise then


def check_files(folder: Path, frames: int, state: str) -> None:
    assert {path.name for path in folder.iterdir()} == NAMES
    assert len(read_motions(folder / "motions.csv")) == frames - 1
    assert len(read_tum(folder / "trajectory.tum")) == frames
    with av.open(str(folder / "overlay.mp4")) as video:
        assert len(list(video.decode(video=0))) == frames
    run = json.loads((folder / "run.json").read_text())
    assert run["state"] == state
    assert run["frames"] == frames
    assert state in (folder / "report.html").read_text()


def test_a_finished_run(tmp_path: Path, run: RunDescription, make_result: MakeResult) -> None:
    with OutputFolder(tmp_path / "new" / "out", run) as folder:
        write_frames(folder, make_result, 7)
        folder.add_time("reading", 1.25)
    check_files(folder.path, 7, "done")
    stages = json.loads((folder.path / "run.json").read_text())["wall_clock"]["stages_s"]
    assert stages["reading"] == 1.25
    assert {"motions", "trajectory", "overlay", "search"} <= set(stages)
    folder.close()


def test_ctrl_c_leaves_valid_files_and_stays_a_ctrl_c(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    with pytest.raises(KeyboardInterrupt), OutputFolder(tmp_path, run) as folder:
        write_frames(folder, make_result, 5, then=KeyboardInterrupt())
    check_files(tmp_path, 5, "interrupted")


def test_an_error_is_recorded_and_stays_itself(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    with pytest.raises(RuntimeError, match="two"), OutputFolder(tmp_path, run) as folder:
        write_frames(folder, make_result, 4, then=RuntimeError("two\nlines"))
    check_files(tmp_path, 4, "failed")
    assert json.loads((tmp_path / "run.json").read_text())["error"] == "RuntimeError: two lines"


def test_each_output_is_closed_even_if_one_fails(
    tmp_path: Path,
    run: RunDescription,
    make_result: MakeResult,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    close = MotionsFile.close

    def fail(self: MotionsFile) -> None:
        close(self)
        raise OSError("disk full")

    monkeypatch.setattr(MotionsFile, "close", fail)
    with pytest.raises(OSError, match="disk full"), OutputFolder(tmp_path, run) as folder:
        write_frames(folder, make_result, 6)
    check_files(tmp_path, 6, "failed")
    assert json.loads((tmp_path / "run.json").read_text())["error"] == "OSError: disk full"

    with pytest.raises(KeyboardInterrupt) as caught, OutputFolder(tmp_path, run) as folder:
        write_frames(folder, make_result, 3, then=KeyboardInterrupt())
    assert caught.value.__notes__ == ["and while closing the outputs: OSError: disk full"]
    check_files(tmp_path, 3, "interrupted")


def test_a_second_ctrl_c_while_closing_does_not_stop_the_closing(
    tmp_path: Path,
    run: RunDescription,
    make_result: MakeResult,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    close = BackgroundSink.close

    def interrupted(self: BackgroundSink) -> None:
        close(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(BackgroundSink, "close", interrupted)
    with pytest.raises(KeyboardInterrupt), OutputFolder(tmp_path, run) as folder:
        write_frames(folder, make_result, 3)
    check_files(tmp_path, 3, "done")


def test_the_other_outputs_survive_the_process_that_draws(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    with start_video_process() as process:
        folder = OutputFolder(tmp_path, run, video_process=process)
        drawn = WAITING + 5  # as many waited for the process as do not find room
        write_frames(folder, make_result, drawn)
        process.kill()
        process.wait()

        def write_on() -> None:
            with folder:
                for k in range(drawn, drawn + 100):
                    put(folder, make_result(k), IMAGE)

        with pytest.raises(ChildProcessError, match=r"overlay\.mp4: the process that draws it"):
            write_on()
    assert {path.name for path in tmp_path.iterdir()} == NAMES
    rows = len(read_motions(tmp_path / "motions.csv"))
    assert rows >= drawn - 1
    with av.open(str(tmp_path / "overlay.mp4")) as video:
        assert 0 < sum(1 for _ in video.decode(video=0)) <= drawn
    # The result that met the dead process is written, its pose is not: it may still change.
    assert len(read_tum(tmp_path / "trajectory.tum")) in (rows, rows + 1)
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["state"] == "failed"
    assert "overlay.mp4" in record["error"]
    assert "failed" in (tmp_path / "report.html").read_text()


def test_same_run_same_files(tmp_path: Path, run: RunDescription, make_result: MakeResult) -> None:
    for name in ("a", "b"):
        with OutputFolder(tmp_path / name, run) as folder:
            write_frames(folder, make_result, 20)
    for name in sorted(NAMES - {"run.json"}):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    runs = [json.loads((tmp_path / side / "run.json").read_text()) for side in "ab"]
    for record in runs:
        del record["wall_clock"]
    assert runs[0] == runs[1]


def test_an_older_report_does_not_outlive_a_new_start(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    with OutputFolder(tmp_path, run) as folder:
        write_frames(folder, make_result, 3)
    running = OutputFolder(tmp_path, run, OutputOptions(overlay=False, halves_every=0))
    left = {path.name for path in tmp_path.iterdir() if not path.name.startswith(".")}
    running.close()
    assert left == NAMES - {"report.html", "overlay.mp4", "halves.csv"}


def test_no_frame_at_all_still_makes_a_page(tmp_path: Path, run: RunDescription) -> None:
    with OutputFolder(tmp_path, run):
        pass
    assert "No pair of frames" in (tmp_path / "report.html").read_text()


def test_faults_in_the_stream_go_through_every_output(
    tmp_path: Path, run: RunDescription, make_result: MakeResult
) -> None:
    with OutputFolder(tmp_path, run) as folder:
        put(folder, make_result(0), IMAGE)
        for k, status in enumerate([*PoseStatus, PoseStatus.OK], start=1):
            put(folder, make_result(k, status), None if status is PoseStatus.FAILED else IMAGE)
    check_files(tmp_path, 6, "done")


def test_places_that_cannot_be_written_are_named(tmp_path: Path, run: RunDescription) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file/out: cannot be written: Not a directory"):
        OutputFolder(tmp_path / "file" / "out", run)
    (tmp_path / "out" / "trajectory.tum").mkdir(parents=True)
    with pytest.raises(InputError, match=r"trajectory\.tum: cannot be written: Is a directory"):
        OutputFolder(tmp_path / "out", run)
