"""A sink that works in another process, so that the estimation is not slowed down."""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from farpoint.odometry import OdometryResult
from farpoint.sinks.sink import Sink

__all__ = ["SinkProcess", "start_process", "wait_until_loaded"]

# One thread for each library, unless the user's environment sets another number, because the
# estimation needs the cores.
_FEW_THREADS = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
}


class SinkProcess:
    """Proxy that passes each call to a sink in another process and waits until the call ends.

    Python runs one thread at a time, so drawing in a thread would slow down the estimation. The
    other process reads calls from a pipe. At the end of the pipe, the other process closes the sink
    and ends, also if the calling process was killed. Ctrl-C does not reach the other process.

    Parameters
    ----------
    make : callable
        Function that makes the sink. The function is pickled and called in the other process; the
        next call raises an error of the function.
    output : str or Path
        Output of the sink, named in the error message if the process dies.
    process : Popen, optional
        Process from an earlier call of `start_process`.

    Raises
    ------
    ChildProcessError
        Raised once, by `write`, `call` or `close`, if the process has died.
    """

    def __init__(
        self,
        make: Callable[[], Sink],
        output: object,
        process: subprocess.Popen[bytes] | None = None,
    ) -> None:
        self._output = output
        self._process = process or start_process()
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._calls, self._answers = self._process.stdin, self._process.stdout
        self._outstanding = 2  # answers to wait for: modules are loaded, sink is made
        self._lost = self._closed = False
        self._send(make)

    def write(self, result: OdometryResult, image: np.ndarray | None) -> None:
        """Add one frame; errors of the other process are raised here."""
        self.call("write", result, image)

    def call(self, method: str, *arguments: object) -> None:
        """Call any method of the sink; the return value of the method is not passed back."""
        self._wait_until_open()
        self._send((method, arguments))
        self._receive()

    def close(self) -> None:
        """Close the sink and wait for the end of its process. A second call does nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            if not self._lost:
                self._wait_until_open()
                self._calls.close()  # the other process reads the end of the calls
                self._receive()
        finally:
            with contextlib.suppress(OSError):  # buffered calls that nobody reads are lost
                self._calls.close()
            self._answers.close()
            self._process.wait()

    def _wait_until_open(self) -> None:
        while self._outstanding:
            self._outstanding -= 1
            self._receive()

    def _send(self, message: object) -> None:
        data = pickle.dumps(message, protocol=5)
        try:
            self._calls.write(data)
            self._calls.flush()
        except OSError:
            raise self._loss() from None

    def _receive(self) -> None:
        try:
            problem = pickle.load(self._answers)
        except (EOFError, OSError, pickle.UnpicklingError):
            raise self._loss() from None
        if problem is not None:
            raise problem

    def _loss(self) -> ChildProcessError:
        self._lost = True
        self._process.kill()  # the process may still run, after an invalid answer
        code = self._process.wait()
        return ChildProcessError(
            f"{self._output}: the process that draws it has ended early (exit code {code})"
        )


def start_process(*modules: str, niceness: int = 5, **environment: str) -> subprocess.Popen[bytes]:
    """Start a process for a later `SinkProcess`.

    Parameters
    ----------
    *modules : str
        Modules that are loaded before the first frame.
    niceness : int
        Nice value of the process, so that the estimation has priority.
    **environment : str
        Environment variables of the process, except variables that the user has set.
    """
    # The process has the module path of this interpreter. The process does not import __main__, so
    # scripts need no guard `if __name__ == "__main__"`.
    path = os.pathsep.join(place or str(Path.cwd()) for place in sys.path)
    command = [sys.executable, "-P", "-m", "farpoint.sinks.process_main", *modules]
    environment = {**_FEW_THREADS, **environment, **os.environ, "PYTHONPATH": path}
    pipe = subprocess.PIPE
    if sys.platform == "win32":
        flags = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.BELOW_NORMAL_PRIORITY_CLASS
        return subprocess.Popen(
            command, stdin=pipe, stdout=pipe, env=environment, creationflags=flags
        )
    # A separate process group, which Ctrl-C does not reach, but no separate session: Linux divides
    # the cores among sessions first, and niceness counts only within a session.
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=environment, process_group=0)
    now = os.getpriority(os.PRIO_PROCESS, process.pid)
    os.setpriority(os.PRIO_PROCESS, process.pid, now + niceness)
    return process


def wait_until_loaded(process: subprocess.Popen[bytes]) -> None:
    """Wait until a process that was started beforehand has loaded its modules, or has ended."""
    reader = process.stdout
    assert isinstance(reader, io.BufferedReader)
    reader.peek(1)  # waits for the first answer and leaves it in the buffer
