"""``kill -9`` at any moment leaves files that can be read; one run at a time is in a folder."""

from __future__ import annotations

import errno
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from folder_kit import check_readable, check_whole, pictures_in, put, record_in

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.odometry import OdometryResult
from farpoint.sinks import lock as lock_module
from farpoint.sinks.lock import LOCK_NAME, FolderLock
from farpoint.sinks.output_folder import OutputFolder, OutputOptions
from farpoint.sinks.overlay import start_video_process
from farpoint.sinks.overlay.fragments import FragmentFile
from farpoint.sinks.process import wait_until_loaded
from farpoint.sinks.run_record import RunDescription

MakeResult = Callable[..., OdometryResult]
CAMERA = Camera.pinhole(160, 120, 125, 125, 79.5, 59.5)
IMAGE = np.random.default_rng(0).integers(0, 255, (120, 160), np.uint8)
RUN = RunDescription(source="drive", source_name="drive", camera=CAMERA, options={})
TEXT = OutputOptions(overlay=False, report=False, halves_every=0)
PATIENCE_S = 60.0

# Runs over and over, so that a kill may meet the beginning, the middle and the end of a run.
PROGRAM = """
import pickle, sys
from pathlib import Path
from farpoint.sinks import OutputFolder, start_video_process
results, image, run = pickle.loads(Path(sys.argv[1]).read_bytes())
while True:
    with start_video_process() as video:
        print(video.pid, flush=True)
        with OutputFolder(sys.argv[2], run, video_process=video) as folder:
            for result in results:
                put(folder, result, image)
"""

HOLDER = """
import sys, time
from pathlib import Path
from farpoint.sinks import FolderLock
lock = FolderLock(Path(sys.argv[1]))
print("held", flush=True)
time.sleep(600)
"""


def results_of(make_result: MakeResult, count: int) -> list[OdometryResult]:
    return [make_result(k, scene_camera=CAMERA) for k in range(count)]


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
def test_a_run_killed_at_any_moment_leaves_files_that_can_be_read(
    tmp_path: Path, make_result: MakeResult
):
    """Ten moments, in one folder; every second time the process that draws dies, too."""
    chance = random.Random(7)
    (tmp_path / "results").write_bytes(pickle.dumps((results_of(make_result, 30), IMAGE, RUN)))
    out, seen = tmp_path / "out", set()
    for turn in range(10):
        command = [sys.executable, "-c", PROGRAM, str(tmp_path / "results"), str(out)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            video = int(process.stdout.readline())
            time.sleep(chance.uniform(0.0, 2.0))
            process.kill()
            later = process.stdout.read().split()
        video = int(later[-1]) if later else video
        if turn % 2 and is_running(video):
            os.kill(video, signal.SIGKILL)
        check_readable(out)
        end = time.monotonic() + PATIENCE_S
        while is_running(video):
            assert time.monotonic() < end
            time.sleep(0.02)
        check_readable(out)
        record = out / "run.json"
        seen.add(record_in(record)["state"] if record.exists() else "none")
    assert "running" in seen  # a folder tells that its run did not end
    with OutputFolder(out, RUN) as folder:  # what is left is in nobody's way
        for result in results_of(make_result, 3):
            put(folder, result, IMAGE)
    check_whole(out)
    assert record_in(out / "run.json")["state"] == "done"


def test_a_second_run_into_a_folder_is_refused_and_harms_nothing(
    tmp_path: Path, make_result: MakeResult
):
    with OutputFolder(tmp_path, RUN, TEXT) as folder:
        put(folder, make_result(0), IMAGE)
        before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
        with pytest.raises(InputError) as told:
            OutputFolder(tmp_path / ".." / tmp_path.name, RUN, TEXT)
        assert tmp_path.name in str(told.value)
        assert "another run is writing into this folder" in str(told.value)
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    check_whole(tmp_path)
    OutputFolder(tmp_path, RUN, TEXT).close()


def test_a_lock_ends_with_its_process_not_with_its_file(tmp_path: Path):
    command = [sys.executable, "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        with pytest.raises(InputError, match="another run"):
            FolderLock(tmp_path)
        process.kill()
    assert (tmp_path / LOCK_NAME).exists()
    FolderLock(tmp_path).release()
    assert list(tmp_path.iterdir()) == []


def test_no_two_hold_a_folder_however_often_it_is_released(tmp_path: Path):
    holders, most, held = 0, 0, 0
    counting = threading.Lock()
    deadline = time.monotonic() + 60.0

    def hold_often() -> None:
        nonlocal holders, most, held
        while held < 200 and time.monotonic() < deadline:
            try:
                lock = FolderLock(tmp_path)
            except InputError:
                continue
            with counting:
                holders += 1
                held += 1
                most = max(most, holders)
            time.sleep(0)
            with counting:
                holders -= 1
            lock.release()

    threads = [threading.Thread(target=hold_often) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1
    assert held >= 200


def test_a_file_system_without_locks_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def none(descriptor: int) -> None:
        raise OSError(errno.ENOLCK, f"No locks available for {descriptor}")

    monkeypatch.setattr(lock_module, "_lock", none)
    with OutputFolder(tmp_path, RUN, TEXT) as folder:
        assert "has no locks" in folder.notes[0]
    assert record_in(tmp_path / "run.json")["notes"] == list(folder.notes)


def test_outputs_that_cannot_be_opened_are_recorded(tmp_path: Path):
    (tmp_path / "trajectory.kitti").mkdir()
    with pytest.raises(InputError, match=r"trajectory\.kitti: cannot be written"):
        OutputFolder(tmp_path, RUN, TEXT)
    assert record_in(tmp_path / "run.json")["state"] == "failed"
    assert {path.name for path in tmp_path.iterdir()} >= {"run.json"}
    assert not (tmp_path / LOCK_NAME).exists()


def test_a_late_video_of_a_killed_run_does_not_change_that_of_the_next(tmp_path: Path):
    box = (12).to_bytes(4, "big") + b"mdat" + b"film"
    late = FragmentFile(tmp_path / "overlay.mp4")
    late.write(box[:5])
    assert not (tmp_path / "overlay.mp4").exists()  # no fragment is whole yet
    late.write(box[5:] + box[:7])
    assert (tmp_path / "overlay.mp4").read_bytes() == box
    (tmp_path / "overlay.mp4").unlink()  # by the next run
    (tmp_path / "overlay.mp4").write_bytes(b"new")
    late.close()
    assert not late.is_at_its_path()
    assert (tmp_path / "overlay.mp4").read_bytes() == b"new"


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT", "SIGHUP"])
def test_what_stops_all_processes_does_not_stop_the_drawing(
    name: str, tmp_path: Path, make_result: MakeResult
):
    with start_video_process() as video:
        folder = OutputFolder(tmp_path, RUN, OutputOptions(report=False), video_process=video)
        wait_until_loaded(video)
        for result in results_of(make_result, 12):
            put(folder, result, IMAGE)
        video.send_signal(getattr(signal, name))
        time.sleep(0.1)
        with pytest.raises(KeyboardInterrupt), folder:
            raise KeyboardInterrupt
    check_whole(tmp_path)
    assert record_in(tmp_path / "run.json")["state"] == "interrupted"
    assert pictures_in(tmp_path / "overlay.mp4") == 12
    assert video.returncode == 0
