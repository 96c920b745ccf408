"""A sink in a thread of its own: nothing lost, nothing out of order, nothing hidden."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from farpoint.odometry import OdometryResult
from farpoint.sinks.background import WAITING, BackgroundSink

MakeResult = Callable[..., OdometryResult]


class Recorder:
    """Notes what comes; works only while the gate is open; fails at one frame if told to."""

    def __init__(self, fails_at: int | None = None) -> None:
        self.gate = threading.Event()
        self.frames: list[int] = []
        self.threads: set[int] = set()
        self.closed = 0
        self._fails_at = fails_at

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        del image
        self.gate.wait(5.0)
        if result.frame1 == self._fails_at:
            raise OSError("disk full")
        self.frames.append(result.frame1)
        self.threads.add(threading.get_ident())

    def close(self) -> None:
        self.closed += 1


def test_every_frame_comes_in_order_in_another_thread(make_result: MakeResult) -> None:
    recorder = Recorder()
    recorder.gate.set()
    sink = BackgroundSink(recorder)
    for k in range(5 * WAITING):
        sink.write(make_result(k), None)
    sink.close()
    sink.close()
    assert recorder.frames == list(range(5 * WAITING))
    assert recorder.closed == 1
    assert threading.get_ident() not in recorder.threads


def test_a_slow_sink_holds_a_bounded_number_of_frames(make_result: MakeResult) -> None:
    recorder = Recorder()
    sink = BackgroundSink(recorder)
    done: list[int] = []

    def write_all() -> None:
        for k in range(3 * WAITING):
            sink.write(make_result(k), None)
            done.append(k)

    writer = threading.Thread(target=write_all)
    writer.start()
    writer.join(0.5)
    assert writer.is_alive()  # it waits: nothing is thrown away
    assert len(done) == WAITING
    recorder.gate.set()
    writer.join(30.0)
    sink.close()
    assert recorder.frames == list(range(3 * WAITING))


def test_an_error_in_the_thread_is_raised_once_and_nobody_waits_for_ever(
    make_result: MakeResult,
) -> None:
    recorder = Recorder(fails_at=2)
    recorder.gate.set()
    sink = BackgroundSink(recorder)

    def write_many() -> None:
        for k in range(4 * WAITING):
            sink.write(make_result(k), None)

    with pytest.raises(OSError, match="disk full"):
        write_many()
    sink.close()
    assert recorder.frames == [0, 1]
    assert recorder.closed == 1


def test_an_error_of_the_last_frame_is_raised_by_closing(make_result: MakeResult) -> None:
    recorder = Recorder(fails_at=1)
    sink = BackgroundSink(recorder)
    sink.write(make_result(0), None)
    sink.write(make_result(1), None)
    recorder.gate.set()
    with pytest.raises(OSError, match="disk full"):
        sink.close()
    assert recorder.closed == 1


def test_notes_keep_their_place_and_take_no_room(make_result: MakeResult) -> None:
    recorder = Recorder()
    sink = BackgroundSink(recorder)
    for k in range(WAITING):
        sink.write(make_result(k), None)
        sink.note(partial(recorder.frames.append, 100 + k))
    assert not sink.offer(make_result(WAITING), None)
    recorder.gate.set()
    sink.close()
    assert recorder.frames == [step for k in range(WAITING) for step in (k, 100 + k)]


def test_notes_that_nobody_takes_are_left_out_in_the_end(make_result: MakeResult) -> None:
    recorder = Recorder()
    sink = BackgroundSink(recorder)
    sink.write(make_result(0), None)
    for k in range(3000):
        sink.note(partial(recorder.frames.append, k))
    recorder.gate.set()
    sink.close()
    assert 900 < len(recorder.frames) < 1100
