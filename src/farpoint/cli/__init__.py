"""The command line: parses, calls, and turns errors into one line and an exit code."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Callable
from typing import Any

import tyro

from farpoint.cli.bench import Bench
from farpoint.cli.camera import ShowCamera
from farpoint.cli.demo import Demo
from farpoint.cli.evaluate import Evaluate
from farpoint.cli.run import Run
from farpoint.errors import InputError, MissingExtraError

__all__ = ["COMMANDS", "main"]

COMMANDS: dict[str, Callable[..., Any]] = {
    "demo": Demo,
    "run": Run,
    "evaluate": Evaluate,
    "bench": Bench,
    "camera": ShowCamera,
}
"""Each command's options, by its name; called without arguments, the record does what it says."""

_WRONG_USAGE = 2
_INTERRUPTED = 130


def main() -> int:
    """Run the command of ``sys.argv``; the return value is the exit code of the process."""
    try:
        _parse(sys.argv[1:])()
    except (InputError, MissingExtraError) as error:
        print(f"farpoint: {error}", file=sys.stderr)
        return _WRONG_USAGE
    except KeyboardInterrupt:
        print("farpoint: interrupted; what was computed is in the outputs", file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:
        # Whoever read the results has seen enough; keep Python from flushing into the void.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _parse(arguments: list[str]) -> Callable[[], None]:
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
        raise InputError(_first_lines(box.getvalue())) from None


def _first_lines(box: str) -> str:
    """What a box of tyro's says above its first rule, in one line."""
    words = []
    for line in box.splitlines()[1:]:
        if "───" in line:
            break
        words.append(line.strip("│ \t"))
    return " ".join(word for word in words if word) + " (see farpoint --help)"
