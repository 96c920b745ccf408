"""The command line: parses, calls, and turns errors into one line and an exit code."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
from collections.abc import Callable, Iterator
from typing import Any

import tyro

from farpoint.cli.bench import Bench
from farpoint.cli.camera import ShowCamera
from farpoint.cli.demo import Demo
from farpoint.cli.evaluate import Evaluate
from farpoint.cli.live import Live
from farpoint.cli.run import Run
from farpoint.errors import InputError, MissingExtraError

__all__ = ["COMMANDS", "main", "parse"]

COMMANDS: dict[str, Callable[..., Any]] = {
    "demo": Demo,
    "run": Run,
    "live": Live,
    "evaluate": Evaluate,
    "bench": Bench,
    "camera": ShowCamera,
}
"""Each command's options, by its name; called without arguments, the record does what it says."""

_WRONG_USAGE = 2
_INTERRUPTED = 130

# tyro's words for a value that a record of options refused: the records it lies in, by the names
# of their fields, and the problem, which begins with the field's own name.
_REFUSED = re.compile(
    r"Error parsing __tyro-dummy-inner__(?:\.(?!metric\b)\w+)?(?P<records>[.\w]*): (?P<field>\w+): "
)


def main() -> int:
    """Run the command of ``sys.argv``; the return value is the exit code of the process."""
    try:
        with _flushed_results():
            parse(sys.argv[1:])()
    except (InputError, MissingExtraError) as error:
        print(f"farpoint: {error}", file=sys.stderr)
        return _WRONG_USAGE
    except KeyboardInterrupt:
        print("farpoint: interrupted; what was computed is in the outputs", file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:  # whoever read the results has seen enough
        _discard_results()
    except OSError as error:  # such as a full disk
        _discard_results()
        place = "" if error.filename is None else f"{error.filename}: "
        print(f"farpoint: {place}{error.strerror or error}", file=sys.stderr)
        return _WRONG_USAGE
    return 0


@contextlib.contextmanager
def _flushed_results() -> Iterator[None]:
    """Write out what was printed, so that a pipe without a reader shows here and not at the exit.

    Left alone where the command failed: that error is the one to tell.
    """
    try:
        yield
    except SystemExit:  # the help was shown
        sys.stdout.flush()
        raise
    sys.stdout.flush()


def _discard_results() -> None:
    """What could not be printed must not be tried again when Python exits."""
    with contextlib.suppress(io.UnsupportedOperation):  # standard output is no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def parse(arguments: list[str]) -> Callable[[], None]:
    """The command, or an InputError in one line where tyro would print a box."""
    box = io.StringIO()
    try:
        with contextlib.redirect_stderr(box):
            return tyro.extras.subcommand_cli_from_dict(
                COMMANDS,
                args=arguments or ["--help"],
                prog="farpoint",
                description="Camera motion from any two images, with an honest covariance.",
            )
    except SystemExit as end:
        if end.code in (None, 0):
            raise
        command = f"{arguments[0]} " if arguments[0] in COMMANDS else ""
        problem = _REFUSED.sub(_option_of, _first_lines(box.getvalue()))
        raise InputError(f"{problem} (see farpoint {command}--help)") from None


def _first_lines(box: str) -> str:
    """What a box of tyro's says above its first rule, in one line."""
    words = []
    for line in box.splitlines()[1:]:
        if "───" in line:
            break
        words.append(line.strip("│ \t"))
    return " ".join(word for word in words if word)


def _option_of(refused: re.Match[str]) -> str:
    """The option as users type it; the outermost record, `metric` apart, gives it no prefix."""
    path = f"{refused['records']}.{refused['field']}".removeprefix(".")
    return f"--{path.replace('_', '-')}: "
