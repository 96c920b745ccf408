"""The command line: parses arguments, calls the command, and reports an error in one line."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Callable
from typing import Any

import tyro

from farpoint import __version__
from farpoint.cli.bench import Bench
from farpoint.cli.camera import ShowCamera
from farpoint.cli.compile import Compile
from farpoint.cli.demo import Demo
from farpoint.cli.evaluate import Evaluate
from farpoint.cli.fleet import Fleet
from farpoint.cli.live import Live
from farpoint.cli.run import Run
from farpoint.cli.streams import lasting_streams
from farpoint.cli.wrong_usage import in_one_line
from farpoint.errors import InputError, MissingExtraError, printable
from farpoint.interrupts import interruptible

__all__ = ["COMMANDS", "main", "parse"]

COMMANDS: dict[str, Callable[..., Any]] = {
    "demo": Demo,
    "run": Run,
    "fleet": Fleet,
    "live": Live,
    "evaluate": Evaluate,
    "bench": Bench,
    "camera": ShowCamera,
    "compile": Compile,
}
"""Options class of each command, by name; calling an instance runs the command."""

_WRONG_USAGE = 2
_INTERRUPTED = 130


def main() -> int:
    """Run the command of ``sys.argv``; the return value is the exit code of the process."""
    with lasting_streams():
        try:
            with interruptible():
                return _run(sys.argv[1:])
        except (InputError, MissingExtraError) as error:
            return _refuse(str(error))
        except KeyboardInterrupt:
            print("farpoint: interrupted; what was computed is in the outputs", file=sys.stderr)
            return _INTERRUPTED
        except OSError as error:  # such as a full disk
            place = "" if error.filename is None else f"{error.filename}: "
            return _refuse(f"{place}{error.strerror or error}")


def _run(arguments: list[str]) -> int:
    if not arguments:
        with contextlib.redirect_stdout(sys.stderr), contextlib.suppress(SystemExit):
            parse(["--help"])
        return _WRONG_USAGE
    if arguments == ["--version"]:
        print(f"farpoint {__version__}")
        return 0
    try:
        code = parse(arguments)()
    except SystemExit:  # the help was shown
        sys.stdout.flush()
        raise
    sys.stdout.flush()  # a full disk raises an error here, not when Python exits
    return code or 0


def _refuse(problem: str) -> int:
    _discard_results()
    print(f"farpoint: {printable(problem)}", file=sys.stderr)
    return _WRONG_USAGE


def _discard_results() -> None:
    """Discard text that could not be printed, so that Python does not print the text at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        with contextlib.suppress(io.UnsupportedOperation):  # standard output is no file
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def parse(arguments: list[str]) -> Callable[[], int | None]:
    """The parsed command; wrong usage raises an InputError of one line instead of tyro's box."""
    command = f"{arguments[0]} " if arguments[0] in COMMANDS else ""
    return in_one_line(
        lambda: tyro.extras.subcommand_cli_from_dict(
            COMMANDS,
            args=arguments,
            prog="farpoint",
            description="Camera motion from any two images, with an honest covariance.",
        ),
        see=f"farpoint {command}--help",
    )
