"""The table of what drawing costs."""

from __future__ import annotations

import time

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.options import BenchOptions
from farpoint.bench.sequences import Sequence
from farpoint.bench.tables import drawing
from farpoint.camera import Camera
from farpoint.sinks import OutputFolder
from farpoint.synthetic.sequence import render_drive

CAMERA = Camera.pinhole(160, 96, 120.0, 120.0, 79.5, 47.5)


@pytest.fixture
def _small(monkeypatch: pytest.MonkeyPatch):
    """A drive of few pixels, seen twice."""
    images = [frame.image for frame in render_drive(CAMERA, frames=9, seed=1)]
    sequence = Sequence(name="small", camera=CAMERA, source=None)
    monkeypatch.setattr(Sequence, "images", lambda _, count: images[:count])
    monkeypatch.setattr(drawing, "rendered_sequence", lambda _: sequence)
    monkeypatch.setattr(drawing, "_ROUNDS", 2)


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
    assert found == [1, 1, 2, 2, 2, 2, 3, 3]


@pytest.mark.usefixtures("_small")
def test_work_in_the_same_thread_shows(monkeypatch: pytest.MonkeyPatch):
    def slow(*_: object) -> None:
        time.sleep(0.03)

    monkeypatch.setattr(OutputFolder, "write", slow)
    sequence = drawing.rendered_sequence(0)
    seconds = drawing._run(sequence, sequence.images(8), drawing._QUIET, False)
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
    seconds = drawing._run(sequence, sequence.images(8), None, False)
    assert np.all(seconds[:, drawing._WALL] > 0.059)
    assert np.all(seconds[:, drawing._CPU] > 0.029)
    assert np.all(seconds[:, drawing._CPU] < 0.045)
    assert np.all(seconds[:, drawing._OTHERS] < 0.015)
