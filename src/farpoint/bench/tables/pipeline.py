"""The whole pipeline, from file to motion, compared with the basic OpenCV program."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from farpoint.bench.interleaved import one_thread
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.plain_script import PlainScript
from farpoint.bench.sequences import Sequence as ImageSequence
from farpoint.bench.sequences import find_sequences, rendered_sequence
from farpoint.bench.table import Cell, Column, Table
from farpoint.odometry import Odometry

__all__ = ["pipeline_table"]

_FRAMES = 60
_WARM_UP = 5  # frames whose time does not count: loading, compiling, the first tracks
_COLUMNS = (
    Column("sequence"),
    Column("size"),
    Column("frames"),
    Column("decode_ms", 1),
    Column("farpoint_tracks_ms", 1),
    Column("farpoint_pose_ms", 2),
    Column("farpoint_path_ms", 2),
    Column("farpoint_fps", 1),
    Column("opencv_script_ms", 1),
    Column("opencv_script_fps", 1),
    Column("time_ratio", 2),
)


def pipeline_table(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """A row for each image sequence of the data, or for a rendered drive if there is none."""
    sequences = find_sequences(options.data) or [rendered_sequence(options.seed)]
    count = (options.pairs or _FRAMES) + 1
    rows = []
    for sequence in sequences:
        with one_thread():
            start = time.process_time()
            images = sequence.images(count)
            decode_s = (time.process_time() - start) / max(len(images), 1)
        if len(images) > _WARM_UP + 1:
            decoded_s = None if sequence.source is None else decode_s
            rows.append(_row(sequence, images, decoded_s, progress))
    return (
        Table(
            name="pipeline",
            title="Whole pipeline, one core: frames a second",
            command=options.command("pipeline"),
            columns=_COLUMNS,
            rows=tuple(rows),
            notes=(
                "fps: decoding, tracking, pose, and path with its scale, over frames taken in turn "
                "on one thread; a rendered drive needs no decoding",
                "OpenCV's script: goodFeaturesToTrack, Lucas-Kanade forward and back, "
                "findEssentialMat and recoverPose at their defaults in every frame, with as many "
                "points as farpoint tracks at most",
                f"processor time, mean frame, the first {_WARM_UP} left out; time_ratio: OpenCV's "
                "time over farpoint's, decoding included",
            ),
        ),
    )


def _row(
    sequence: ImageSequence,
    images: Sequence[np.ndarray],
    decode_s: float | None,
    progress: Progress,
) -> tuple[Cell, ...]:
    odometry = Odometry(sequence.camera)
    script = PlainScript(sequence.camera, odometry.options.tracker.max_tracks)
    stages = ("tracks", "pose", "path")
    seconds = np.empty((len(images), 2 + len(stages)))
    with one_thread():
        for index, image in enumerate(images):
            before = dict(odometry.seconds)
            ours = _cpu_s(lambda: odometry.process(image, 0.1 * index))  # noqa: B023
            parts = np.array([odometry.seconds[name] - before[name] for name in stages])
            # Stages are timed with the wall clock; their sum is limited to the CPU time.
            parts *= ours / max(parts.sum(), ours, 1e-9)
            seconds[index] = ours, _cpu_s(lambda: script.process(image)), *parts  # noqa: B023
            progress(f"pipeline of {sequence.name}", index + 1, len(images))
    ours, theirs, tracks, pose, path = np.mean(seconds[_WARM_UP:], axis=0)
    height, width = images[0].shape
    decode = decode_s or 0.0
    return (
        sequence.name,
        f"{width}x{height}",
        len(images),
        None if decode_s is None else 1e3 * decode_s,
        float(1e3 * tracks),
        float(1e3 * pose),
        float(1e3 * path),
        float(1.0 / (decode + ours)),
        float(1e3 * theirs),
        float(1.0 / (decode + theirs)),
        float((decode + theirs) / (decode + ours)),
    )


def _cpu_s(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start
