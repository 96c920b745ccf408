"""Cost of drawing: time of the estimation with and without each drawn output."""

from __future__ import annotations

import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.processes import children_cpu_s
from farpoint.bench.sequences import Sequence, find_sequences, rendered_sequence
from farpoint.bench.table import Column, Table
from farpoint.odometry import Odometry
from farpoint.sinks import OutputFolder, OutputOptions, RunDescription, ViewerOptions, open_viewer
from farpoint.sinks.background import WAITING

__all__ = ["drawing_table"]

_FRAMES = 60
_ROUNDS = 4
# First frames, which are not timed: loading, compilation, first tracks. The queue holds fewer
# frames, so that the drawing processes have begun.
_WARM_UP = WAITING + 2
_CAUGHT_UP_S = 0.2  # processes without CPU time in this interval are idle
_WALL, _CPU, _OTHERS, _WHOLE = range(4)
_QUIET = OutputOptions(overlay=False, report=False, halves_every=0)
_VIDEO_ONLY = OutputOptions(report=False, halves_every=0)
# Name, outputs, and whether the display is recorded.
_WAYS: tuple[tuple[str, OutputOptions | None, bool], ...] = (
    ("nothing", None, False),
    ("text files", _QUIET, False),
    ("text files, overlay", _VIDEO_ONLY, False),
    ("text files, viewer", _QUIET, True),
    ("all of them", _VIDEO_ONLY, True),
)


def drawing_table(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """A row for each choice of outputs. The choices process the same frames in turn."""
    sequence = (find_sequences(options.data) or [rendered_sequence(options.seed)])[0]
    images = sequence.images((options.pairs or _FRAMES) + _WARM_UP)
    times_s: list[list[np.ndarray]] = [[] for _ in _WAYS]
    steps = _ROUNDS * len(_WAYS)
    for step in range(steps):
        # The order rotates from round to round, so that other load affects all choices equally.
        way = (step + step // len(_WAYS)) % len(_WAYS)
        times_s[way].append(_run(sequence, images, *_WAYS[way][1:]))
        progress("drawing", step + 1, steps)
    medians_ms = [1e3 * np.median(np.concatenate(times), axis=0) for times in times_s]
    return (
        Table(
            name="drawing",
            title=f"Cost of drawing, {sequence.name}",
            command=options.command("drawing"),
            columns=(
                Column("outputs"),
                Column("estimation_ms", 1),
                Column("time_estimation_over_nothing", 3),
                Column("estimation_cpu_ms", 1),
                Column("time_cpu_over_nothing", 3),
                Column("drawing_cpu_ms", 1),
                Column("frame_ms", 1),
            ),
            rows=tuple(
                (
                    name,
                    float(ms[_WALL]),
                    float(ms[_WALL] / medians_ms[0][_WALL]),
                    float(ms[_CPU]),
                    float(ms[_CPU] / medians_ms[0][_CPU]),
                    float(ms[_OTHERS]),
                    float(ms[_WHOLE]),
                )
                for (name, *_), ms in zip(_WAYS, medians_ms, strict=True)
            ),
            notes=(
                "estimation: wall-clock and processor time of tracking and pose while other "
                "processes draw; other programs hardly change the processor time; drawing: "
                "processor time of the drawing processes and of all other threads of this "
                "process; frame: wall-clock time until the next frame can begin, with waiting "
                "for a full queue",
                f"median of {_ROUNDS} rounds over {len(images) - _WARM_UP} frames",
            ),
        ),
    )


def _run(
    sequence: Sequence, images: list[np.ndarray], output: OutputOptions | None, viewer: bool
) -> np.ndarray:
    """Times of each frame (N, 4), s; `_WALL`, `_CPU`, `_WHOLE` and `_OTHERS` number the columns."""
    odometry = Odometry(sequence.camera)
    seconds = np.empty((len(images), 4))
    with ExitStack() as opened:
        folder = _outputs(opened, sequence, output, viewer)
        drawn_s = 0.0
        for index, image in enumerate(images):
            if index == _WARM_UP:
                drawn_s = _drawing_cpu_s()
            start, start_cpu, start_all = (
                time.perf_counter(),
                time.thread_time(),
                time.process_time(),
            )
            result = odometry.process(image, 0.1 * index)
            seconds[index, _WALL] = time.perf_counter() - start
            seconds[index, _CPU] = time.thread_time() - start_cpu
            if folder is not None:
                folder.write(result, image)
            seconds[index, _WHOLE] = time.perf_counter() - start
            own = time.thread_time() - start_cpu
            seconds[index, _OTHERS] = time.process_time() - start_all - own
        # Drawing overlaps with later frames, so each frame gets an equal share of its CPU time.
        seconds[:, _OTHERS] += (_drawing_cpu_s() - drawn_s) / (len(images) - _WARM_UP)
    return seconds[_WARM_UP:]


def _drawing_cpu_s() -> float:
    """CPU time of the drawing processes so far, s, measured when all drawing is done."""
    now_s, before_s = children_cpu_s(), -1.0
    while now_s > before_s:
        time.sleep(_CAUGHT_UP_S)
        now_s, before_s = children_cpu_s(), now_s
    return now_s


def _outputs(
    opened: ExitStack, sequence: Sequence, output: OutputOptions | None, viewer: bool
) -> OutputFolder | None:
    if output is None:
        return None
    place = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="farpoint-bench-")))
    run = RunDescription(source="bench", source_name="bench", camera=sequence.camera, options={})
    folder = opened.enter_context(OutputFolder(place / "out", run, output))
    if viewer:
        options = ViewerOptions(rrd=place / "display.rrd")
        folder.add("viewer", open_viewer(options, "bench", sequence.camera))
    return folder
