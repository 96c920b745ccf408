"""Signals as KeyboardInterrupt, so that outputs are completed before the process ends."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

__all__ = ["interruptible"]

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
_COMPILERS = ("numba", "llvmlite")
_AGAIN_S = 0.05  # s; time until a signal that came during a compilation is handled again


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt on Ctrl-C, on SIGTERM, and on SIGHUP of a terminal that closes.

    A signal that the caller ignores (``nohup``) stays ignored. A signal during the compilation of a
    kernel waits for the end of the compilation, because an exception during compilation can crash
    the process. Python ignores an exception in a destructor or a callback: the signal is then sent
    once more. Outside of the main thread the context has no effect.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before, unraisable, again = {}, sys.unraisablehook, _SendAgain()

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not _is_compiling(frame):
            raise KeyboardInterrupt
        again.send_later(number)

    def send_again(lost: Any) -> None:
        if before and issubclass(lost.exc_type, KeyboardInterrupt):
            again.send_later(next(iter(before)))
        else:
            unraisable(lost)

    for name in _SIGNALS:
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, interrupt)
    sys.unraisablehook = send_again
    try:
        yield
        again.finish()
    finally:
        again.drop()
        sys.unraisablehook = unraisable
        for number, handler in before.items():
            signal.signal(number, handler)


class _SendAgain:
    """A signal that is sent to the main thread after 0.05 s."""

    def __init__(self) -> None:
        self._timer: threading.Timer | None = None

    def send_later(self, number: int) -> None:
        """Send the signal after 0.05 s, in place of a signal that is on its way."""
        self.drop()
        self._timer = threading.Timer(_AGAIN_S, _send_to_main_thread, (number,))
        self._timer.daemon = True
        self._timer.start()

    def finish(self) -> None:
        """Wait until a signal that is on its way has been sent."""
        if self._timer is not None:
            self._timer.join()

    def drop(self) -> None:
        """Forget a signal that is on its way."""
        if self._timer is not None:
            self._timer.cancel()


def _is_compiling(frame: FrameType | None) -> bool:
    """Whether a stack frame belongs to the compiler or to a function called by the compiler."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).partition(".")[0] in _COMPILERS:
            return True
        frame = frame.f_back
    return False


def _send_to_main_thread(number: int) -> None:
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, number)  # ends a call that waits
    else:  # on Windows
        signal.raise_signal(number)
