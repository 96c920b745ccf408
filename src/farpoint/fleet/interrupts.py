"""Interrupts that are not lost, although Python ignores an interrupt during a destructor."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["lasting_interrupts"]

_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")


@contextmanager
def lasting_interrupts() -> Iterator[Callable[[], None]]:
    """Context with a function that raises KeyboardInterrupt if an interrupt has arrived.

    A signal raises KeyboardInterrupt in the code that the main thread is executing. In a destructor
    or in the callback of a weak reference, Python prints the exception and continues. Code that
    waits for a long time should call the function repeatedly.
    """
    came = threading.Event()

    def look() -> None:
        if came.is_set():
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield look
        return
    before: dict[int, Any] = {}
    previous_hook = sys.unraisablehook

    def note(number: int, frame: FrameType | None) -> None:
        came.set()
        before[number](number, frame)

    def hook(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt):
            previous_hook(lost)

    for name in _SIGNALS:
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and callable(signal.getsignal(number)):
            before[number] = signal.signal(number, note)
    sys.unraisablehook = hook
    try:
        yield look
    finally:
        sys.unraisablehook = previous_hook
        for number, handler in before.items():
            signal.signal(number, handler)
