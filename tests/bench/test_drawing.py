"""The table of what drawing costs."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.processes import resident_mb
from farpoint.bench.sequences import Sequence
from farpoint.bench.tables import drawing
from farpoint.camera import Camera
from farpoint.sinks import OutputFolder
from farpoint.synthetic.sequence import render_drive

CAMERA = Camera.pinhole(160, 96, 120.0, 120.0, 79.5, 47.5)


@pytest.fixture
def _small(monkeypatch: pytest.MonkeyPatch):
    """A drive of few pixels, seen twice."""
    images = [frame.image for frame in render_drive(CAMERA, frames=drawing._WARM_UP + 4, seed=1)]
    sequence = Sequence(name="small", camera=CAMERA, source=None)
    monkeypatch.setattr(Sequence, "images", lambda _, count: images[:count])
    monkeypatch.setattr(drawing, "rendered_sequence", lambda _: sequence)
    monkeypatch.setattr(drawing, "_ROUNDS", 1)


@pytest.mark.usefixtures("_small")
def test_every_choice_of_outputs_is_made_and_timed(monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("rerun")
    made: list[set[str]] = []
    close = OutputFolder.close

    def closed(folder: OutputFolder, *arguments: object) -> None:
        close(folder, *arguments)  # type: ignore[arg-type]
        made.append({path.name for path in [*folder.path.iterdir(), *folder.path.parent.iterdir()]})

    monkeypatch.setattr(OutputFolder, "close", closed)
    (table,) = drawing.drawing_table(BenchOptions(pairs=4), silent)
    assert [row[0] for row in table.rows] == [name for name, *_ in drawing._WAYS]
    assert np.all(np.array([row[1:] for row in table.rows], float) >= 0.0)
    times = np.array([row[1:5] for row in table.rows], float)
    np.testing.assert_allclose(times[:, [1, 3]], times[:, [0, 2]] / times[0, [0, 2]])
    both = {"motions.csv", "overlay.mp4", "display.rrd"}
    found = sorted(len(files & both) for files in made)
    assert found == [1, 2, 2, 3]


@pytest.mark.usefixtures("_small")
def test_work_in_the_same_thread_shows(monkeypatch: pytest.MonkeyPatch):
    def slow(*_: object) -> None:
        time.sleep(0.03)

    monkeypatch.setattr(OutputFolder, "write", slow)
    sequence = drawing.rendered_sequence(0)
    seconds = drawing._run(sequence, sequence.images(drawing._WARM_UP + 3), drawing._QUIET, False)
    assert seconds.shape == (3, 4)
    assert np.all(seconds[:, drawing._WHOLE] - seconds[:, drawing._WALL] > 0.029)


class Idler:
    """Waits, then works, for 30 ms each."""

    def __init__(self, _: Camera) -> None:
        pass

    def process(self, *_: object) -> None:
        time.sleep(0.03)
        end = time.thread_time() + 0.03
        while time.thread_time() < end:
            pass


@pytest.mark.usefixtures("_small")
def test_waiting_takes_no_processor_and_own_work_is_not_that_of_others(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(drawing, "Odometry", Idler)
    sequence = drawing.rendered_sequence(0)
    seconds = drawing._run(sequence, sequence.images(drawing._WARM_UP + 3), None, False)
    assert np.all(seconds[:, drawing._WALL] > 0.059)
    assert np.all(seconds[:, drawing._CPU] > 0.029)
    assert np.all(seconds[:, drawing._CPU] < 0.045)
    assert np.all(seconds[:, drawing._OTHERS] < 0.015)


class Drawer:
    """Has another process work for 50 ms with every frame, beside this one."""

    def __init__(self, folder: Path) -> None:
        self.path = folder
        script = "import sys, time\nfor _ in sys.stdin:\n t = time.process_time() + 0.05\n"
        script += " while time.process_time() < t: pass\n"
        self.process = subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE)

    def write(self, *_: object) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(b"draw\n")
        self.process.stdin.flush()


@pytest.mark.usefixtures("_small")
def test_the_work_of_processes_that_draw_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    drawer = Drawer(tmp_path)
    monkeypatch.setattr(drawing, "Odometry", Idler)
    monkeypatch.setattr(drawing, "_outputs", lambda *_: drawer)
    sequence = drawing.rendered_sequence(0)
    try:
        seconds = drawing._run(sequence, sequence.images(drawing._WARM_UP + 4), None, False)
    finally:
        drawer.process.communicate()
    assert np.all(seconds[:, drawing._OTHERS] > 0.045)
    assert np.all(seconds[:, drawing._OTHERS] < 0.075)


def test_memory_counts_the_processes_that_were_started():
    script = "x = b'1' * 100_000_000; print('full', flush=True); input()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    before_mb = resident_mb()
    with subprocess.Popen([sys.executable, "-c", script], **pipes) as process:  # type: ignore
        assert process.stdout is not None
        process.stdout.readline()
        during_mb = resident_mb()
        process.communicate(b"\n")
    assert 100.0 < during_mb - before_mb < 130.0
    assert resident_mb() < before_mb + 50.0
