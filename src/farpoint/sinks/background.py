"""A sink that writes in a thread, in parallel with the estimation."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue

import numpy as np

from farpoint.odometry import OdometryResult
from farpoint.sinks.sink import Sink

__all__ = ["BackgroundSink"]

WAITING = 8
"""Length of the queue, in frames: smooths the frame rate with little memory."""

_Step = Callable[[], object]
_NOTES = 1000  # queue length above which `note` adds no call, because the sink probably hangs


class BackgroundSink:
    """Passes all results, in order, to another sink that is called in a thread.

    If the other sink falls behind, `write` waits, so that no frame is left out and memory stays
    bounded. An error in the thread is raised once, by the next call. The other sink should be a
    `SinkProcess`, so that the work is done in another process and the thread only waits.

    Parameters
    ----------
    sink : Sink
        The other sink, which only the thread calls from now on.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        # A semaphore limits the queued frames, so that `note` and `close` never wait for room.
        self._steps: SimpleQueue[tuple[_Step, _Step] | None] = SimpleQueue()
        self._free_slots = threading.Semaphore(WAITING)
        self._problem: BaseException | None = None
        self._failed = self._closed = False
        # A daemon thread, so that a program that does not close its sinks can end.
        self._thread = threading.Thread(target=self._work, name="farpoint-sink", daemon=True)
        self._thread.start()

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Queue one frame; neither result nor image may be changed afterwards."""
        self._free_slots.acquire()
        self._add(result, image)

    def offer(self, result: OdometryResult, image: np.ndarray | None) -> bool:
        """Queue one frame if there is room; returns whether there was room."""
        if not self._free_slots.acquire(blocking=False):
            return False
        self._add(result, image)
        return True

    def note(self, step: _Step) -> None:
        """Queue a small call between frames; the call is left out if very many calls wait."""
        if self._steps.qsize() < _NOTES:
            self._steps.put((step, _nothing))
        self._raise_problem()

    def close(self) -> None:
        """Wait until all is written and the other sink is closed; a second call does nothing."""
        if not self._closed:
            self._closed = True
            self._steps.put(None)
        self._thread.join()
        self._raise_problem()

    def _add(self, result: OdometryResult, image: np.ndarray | None) -> None:
        self._steps.put((partial(self._sink.write, result, image), self._free_slots.release))
        self._raise_problem()

    def _work(self) -> None:
        while (waiting := self._steps.get()) is not None:
            step, afterwards = waiting
            if not self._failed:  # after an error, queued frames are discarded
                self._attempt(step)
            afterwards()
        self._attempt(self._sink.close)

    def _attempt(self, step: _Step) -> None:
        try:
            step()
        except BaseException as problem:
            self._problem = self._problem or problem
            self._failed = True

    def _raise_problem(self) -> None:
        problem, self._problem = self._problem, None
        if problem is not None:
            raise problem


def _nothing() -> None:
    pass
