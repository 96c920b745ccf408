"""A sink that works beside the estimation instead of holding it up."""

from __future__ import annotations

import threading
from collections.abc import Callable
from queue import SimpleQueue

import numpy as np

from farpoint.odometry import OdometryResult
from farpoint.sinks.sink import Sink

__all__ = ["BackgroundSink"]

WAITING = 8
"""Frames that may wait: enough to smooth the pace, too few to matter for memory."""


class BackgroundSink:
    """Hands results to another sink in a thread of its own: all of them, in order.

    Where that sink falls behind, `write` waits: no frame is left out, and memory stays bounded.
    What goes wrong in the thread is raised once, by the next call.

    Parameters
    ----------
    sink : Sink
        Does the work; from now on only the thread calls it.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        # The bound is a semaphore of its own, so that closing never waits for room.
        self._frames: SimpleQueue[tuple[OdometryResult, np.ndarray | None] | None] = SimpleQueue()
        self._room = threading.Semaphore(WAITING)
        self._problem: BaseException | None = None
        self._failed = self._closed = False
        self._thread = threading.Thread(target=self._work, name="farpoint-sink")
        self._thread.start()

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Queue one frame; neither result nor image may be changed afterwards."""
        self._room.acquire()
        self._frames.put((result, image))
        self._raise_problem()

    def offer(self, result: OdometryResult, image: np.ndarray | None) -> bool:
        """Queue one frame as `write` does if there is room; whether there was."""
        if not self._room.acquire(blocking=False):
            return False
        self._frames.put((result, image))
        self._raise_problem()
        return True

    def close(self) -> None:
        """Wait until all is written and the sink is closed; a second call does nothing."""
        if not self._closed:
            self._closed = True
            self._frames.put(None)
        self._thread.join()
        self._raise_problem()

    def _work(self) -> None:
        while (frame := self._frames.get()) is not None:
            if not self._failed:  # a broken sink gets no more, but nobody waits for it either
                self._attempt(lambda frame=frame: self._sink.write(*frame))
            self._room.release()
        self._attempt(self._sink.close)

    def _attempt(self, step: Callable[[], object]) -> None:
        try:
            step()
        except BaseException as problem:
            self._problem = self._problem or problem
            self._failed = True

    def _raise_problem(self) -> None:
        problem, self._problem = self._problem, None
        if problem is not None:
            raise problem
