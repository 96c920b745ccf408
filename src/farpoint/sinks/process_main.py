"""Program of a process with a sink: ``python -m farpoint.sinks.process_main [MODULE ...]``.

Messages are pickled. The first message makes the sink; every other message is a method and its
arguments. The answer to each message is None or an error. One more answer is sent before the first
message, as soon as the modules of the command line are loaded. At the end of the messages the sink
is closed, also if the process that sends the messages has died.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable
from functools import partial
from typing import Any, BinaryIO, NoReturn

from farpoint.sinks.sink import Sink

__all__ = ["main"]


def main() -> NoReturn:
    """Answer all messages, and then end the process."""
    _end_with_messages_only()
    messages, answers = _pipes()
    for module in sys.argv[1:]:
        with contextlib.suppress(ImportError):  # the sink itself reports a missing library
            importlib.import_module(module)
    _answer(answers, None)  # the modules are loaded
    worker = _Worker()
    while (step := _next(messages)) is not None:
        _answer(answers, _attempt(partial(worker.handle, step)))
        del step  # frees the image before the wait for the next message
    _answer(answers, _attempt(worker.close))
    # The sink is closed. No destructors run: a library that could not write would wait in them.
    os._exit(0)


def _end_with_messages_only() -> None:
    """Ignore signals to the process group; the sender of the messages handles such signals."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, name):  # Windows has no SIGHUP
            signal.signal(getattr(signal, name), signal.SIG_IGN)


class _Worker:
    """Executes the messages."""

    def __init__(self) -> None:
        self._sink: Sink | None = None

    def handle(self, message: Any) -> None:
        if isinstance(message, tuple):
            method, arguments = message
            getattr(self._sink, method)(*arguments)
        else:
            self._sink = message()

    def close(self) -> None:
        if self._sink is not None:  # None if making it has failed
            self._sink.close()


def _next(messages: BinaryIO) -> Any | None:
    """The next message; None at the end of the messages, also if the end is within a message."""
    try:
        return pickle.load(messages)
    except (EOFError, OSError, pickle.UnpicklingError):
        return None


def _pipes() -> tuple[BinaryIO, BinaryIO]:
    """Pipes of messages and answers, hidden from libraries that print or read."""
    messages, answers = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return os.fdopen(messages, "rb"), os.fdopen(answers, "wb")


def _attempt(step: Callable[[], None]) -> BaseException | None:
    try:
        step()
    except BaseException as error:
        return _portable(error)
    return None


def _portable(error: BaseException) -> BaseException:
    """The error if it can be pickled; otherwise an error with the same message."""
    error.add_note("".join(["in the process that draws:\n", *traceback.format_exception(error)]))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _answer(answers: BinaryIO, problem: BaseException | None) -> None:
    with contextlib.suppress(OSError):  # the reader has ended
        answers.write(pickle.dumps(problem, protocol=5))
        answers.flush()


if __name__ == "__main__":
    main()
