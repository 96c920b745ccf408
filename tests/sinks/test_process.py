"""A sink in another process: as if it were here, and its end is never the end of this one."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import av
import numpy as np
import process_kit
import pytest

from farpoint.camera import Camera
from farpoint.errors import InputError, MissingExtraError
from farpoint.odometry import OdometryResult
from farpoint.sinks.background import WAITING, BackgroundSink
from farpoint.sinks.overlay import OverlayVideo, open_video
from farpoint.sinks.process import SinkProcess, start_process

MakeResult = Callable[..., OdometryResult]
IMAGE = np.full((480, 640), 60, np.uint8)
PATIENCE_S = 60.0


def lines_of(path: Path) -> list[str]:
    """What `Notes` wrote, without the process."""
    return [line.split(maxsplit=1)[1] for line in path.read_text().splitlines()]


def pid_of(path: Path) -> int:
    return int(path.read_text().split(maxsplit=1)[0])


def wait_until(true: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.fixture
def notes(tmp_path: Path) -> Path:
    return tmp_path / "notes.txt"


def test_calls_are_made_in_order_in_another_process(notes: Path, make_result: MakeResult):
    sink = SinkProcess(partial(process_kit.Notes, notes), "notes")
    view = np.arange(640 * 480, dtype=np.uint8).reshape(480, 640)[::2, 1::3]
    sink.write(make_result(0), None)
    sink.call("tell", "seven", 7)
    sink.write(make_result(1), view)
    sink.close()
    sink.close()
    expected = ["open", "frame 0 None", "told seven 7", f"frame 1 {int(view.sum())}", "close"]
    assert lines_of(notes) == expected
    assert pid_of(notes) != os.getpid()
    assert not is_running(pid_of(notes))


def test_results_arrive_as_they_are(tmp_path: Path, camera: Camera, make_result: MakeResult):
    """The film is the same bytes, whoever draws it."""
    results = [make_result(k) for k in range(20)]
    here = OverlayVideo(tmp_path / "here.mp4", camera)
    there = open_video(tmp_path / "there.mp4", camera)
    for result in results:
        for sink in (here, there):
            sink.write(result, IMAGE)
    here.close()
    there.close()
    assert (tmp_path / "here.mp4").read_bytes() == (tmp_path / "there.mp4").read_bytes()


def test_what_libraries_print_does_not_disturb(notes: Path, make_result: MakeResult):
    sink = SinkProcess(partial(process_kit.Loud, notes), "notes")
    for k in range(3):
        sink.write(make_result(k), None)
    sink.close()
    assert lines_of(notes) == ["open", *(f"frame {k} None" for k in range(3)), "close"]


def test_a_sink_that_cannot_be_made_says_why_once(make_result: MakeResult):
    sink = SinkProcess(process_kit.refused, "film.mp4")
    with pytest.raises(InputError) as caught:
        sink.write(make_result(0), None)
    assert str(caught.value) == "film.mp4: --out: cannot be written"
    assert (caught.value.file, caught.value.field) == ("film.mp4", "--out")
    assert "process_kit.py" in caught.value.__notes__[0]  # where it was raised
    sink.close()
    with pytest.raises(InputError):
        SinkProcess(process_kit.refused, "film.mp4").close()


def test_an_error_over_there_is_raised_here_and_the_sink_is_closed(
    notes: Path, make_result: MakeResult
):
    sink = BackgroundSink(SinkProcess(partial(process_kit.FullDisk, notes), "notes"))

    def write_many() -> None:
        for k in range(4 * WAITING):
            sink.write(make_result(k), None)
        sink.close()

    with pytest.raises(OSError, match="No space left") as caught:
        write_many()
    assert (caught.value.errno, caught.value.filename) == (28, "film.mp4")
    sink.close()
    assert lines_of(notes) == ["open", "frame 0 None", "close"]


def test_an_error_that_cannot_be_pickled_is_sent_as_text(notes: Path, make_result: MakeResult):
    sink = SinkProcess(partial(process_kit.Unpicklable, notes), "notes")
    with pytest.raises(RuntimeError, match=r"^OwnError: of its own kind$"):
        sink.write(make_result(0), None)
    sink.close()


@pytest.mark.parametrize("frames", [0, 1])
def test_a_process_that_ends_early_is_named(frames: int, make_result: MakeResult):
    sink = SinkProcess(process_kit.exits, "film.mp4")

    def use() -> None:
        for k in range(frames):
            sink.write(make_result(k), IMAGE)
        sink.close()

    with pytest.raises(ChildProcessError, match=r"^film\.mp4: the process .* \(exit code 3\)$"):
        use()
    sink.close()


def test_nothing_waits_for_a_process_that_was_killed(notes: Path, make_result: MakeResult):
    sink = BackgroundSink(SinkProcess(partial(process_kit.Slow, notes), "notes"))
    sink.write(make_result(0), IMAGE)
    wait_until(notes.exists)
    while sink.offer(make_result(1), IMAGE):
        pass
    errors: list[BaseException] = []

    def write() -> None:
        try:
            for _ in range(3 * WAITING):
                sink.write(make_result(2), IMAGE)
        except ChildProcessError as error:
            errors.append(error)

    writer = threading.Thread(target=write)
    writer.start()
    writer.join(0.2)
    assert writer.is_alive()  # it waits for room
    os.kill(pid_of(notes), signal.SIGKILL)
    writer.join(PATIENCE_S)
    assert not writer.is_alive()
    assert [str(error) for error in errors] == [
        "notes: the process that draws it has ended early (exit code -9)"
    ]
    sink.write(make_result(3), IMAGE)  # told once; the rest of a run may go on without
    wait_until(lambda: sink.offer(make_result(4), IMAGE))
    sink.close()


def test_estimation_goes_first(notes: Path):
    process = start_process()
    sink = SinkProcess(partial(process_kit.Notes, notes), "notes", process)
    mine, its = (os.getpriority(os.PRIO_PROCESS, pid) for pid in (0, process.pid))
    sink.close()
    assert its > mine


def test_a_process_that_nobody_needed_ends(notes: Path):
    with start_process("av", "no_such_module") as process:
        pass
    assert process.returncode == 0
    assert not notes.exists()


def test_a_video_is_written_to_its_path(
    tmp_path: Path, camera: Camera, make_result: MakeResult, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    with start_process() as early:
        monkeypatch.chdir(tmp_path / "elsewhere")
        video = open_video(Path("overlay.mp4"), camera, process=early)
        video.write(make_result(0), IMAGE)
        video.close()
    assert pictures_in(tmp_path / "elsewhere" / "overlay.mp4") == 1


def test_a_video_that_cannot_be_made_is_refused_at_once(
    tmp_path: Path, camera: Camera, monkeypatch: pytest.MonkeyPatch
):
    with pytest.raises(InputError, match=r"gone.overlay\.mp4: cannot be written"):
        open_video(tmp_path / "gone" / "overlay.mp4", camera)
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(MissingExtraError, match=r"writing overlay\.mp4 needs av: .*\[video\]"):
        open_video(tmp_path / "overlay.mp4", camera)
    assert list(tmp_path.iterdir()) == []


# A program as users write it: at the top of its file, and without any end.
SCRIPT = """
import pickle, sys, time
from pathlib import Path
from farpoint.sinks.overlay import open_video
results, image, camera = pickle.loads(Path({results!r}).read_bytes())
print("once", flush=True)
video = open_video(Path({video!r}), camera)
for result in results:
    video.write(result, image)
{end}
"""


def start_script(
    folder: Path, camera: Camera, results: list[OdometryResult], end: str
) -> subprocess.Popen[str]:
    (folder / "results").write_bytes(pickle.dumps((results, IMAGE, camera)))
    script = folder / "program.py"
    names = {"results": str(folder / "results"), "video": str(folder / "overlay.mp4")}
    script.write_text(SCRIPT.format(**names, end=end))
    return subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)


def pictures_in(path: Path) -> int:
    with av.open(str(path)) as video:
        return sum(1 for _ in video.decode(video=0))


def is_finished(path: Path) -> bool:
    """Whether a film is packed, which happens when it is closed."""
    return path.exists() and b"moof" not in path.read_bytes() and not _part(path).exists()


def _part(path: Path) -> Path:
    return path.with_name(path.name + ".part")


@pytest.mark.parametrize("end", ["", "video.close()"])
def test_a_program_that_does_not_close_its_sink_ends_with_a_closed_video(
    tmp_path: Path, camera: Camera, make_result: MakeResult, end: str
):
    count = 3 * WAITING
    process = start_script(tmp_path, camera, [make_result(k) for k in range(count)], end)
    said, _ = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, said) == (0, "once\n")
    video = tmp_path / "overlay.mp4"
    wait_until(lambda: is_finished(video) and video.stat().st_size > 0)
    assert count - WAITING <= pictures_in(video) <= count


def test_the_death_of_the_program_closes_the_video(
    tmp_path: Path, camera: Camera, make_result: MakeResult
):
    count = 2 * WAITING
    end = "time.sleep(600)"
    process = start_script(tmp_path, camera, [make_result(k) for k in range(count)], end)
    wait_until(lambda: len(children_of(process.pid)) == 1)
    (drawing,) = children_of(process.pid)
    video = tmp_path / "overlay.mp4"
    wait_until(lambda: video.exists() and video.stat().st_size > 20_000)
    process.kill()
    process.communicate(timeout=PATIENCE_S)
    wait_until(lambda: not is_running(drawing))
    assert is_finished(video)
    assert 0 < pictures_in(video) <= count


def children_of(pid: int) -> list[int]:
    found = []
    for place in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = place.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid:
            found.append(int(place.parent.name))
    return found
