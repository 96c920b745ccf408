"""Signals that end a command properly: every output is completed first."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

__all__ = ["interruptible"]

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_COMPILERS = ("numba", "llvmlite")
_AGAIN_S = 0.05  # s; time until a signal that came during a compilation is handled again


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on Ctrl-C, on SIGTERM, and on SIGHUP of a terminal that closes.

    A signal that the caller of the command ignores (``nohup``) stays ignored. A signal during the
    compilation of a kernel waits for the end of the compilation, because an exception during
    compilation can crash the process.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {}
    for name in _SIGNALS:
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, _interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt(number: int, frame: FrameType | None) -> None:
    if not _is_compiling(frame):
        raise KeyboardInterrupt
    again = threading.Timer(_AGAIN_S, _raise_in_main_thread, (number,))
    again.daemon = True
    again.start()


def _is_compiling(frame: FrameType | None) -> bool:
    """Whether a stack frame belongs to the compiler or to a function called by the compiler."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in _COMPILERS:
            return True
        frame = frame.f_back
    return False


def _raise_in_main_thread(number: int) -> None:
    if hasattr(signal, "pthread_kill"):  # else on Windows, where no call has to be interrupted
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, number)
    else:
        signal.raise_signal(number)
