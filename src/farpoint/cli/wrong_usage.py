"""Messages of tyro about wrong usage, printed in one line instead of a box."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable
from typing import TypeVar

from farpoint.errors import InputError

__all__ = ["in_one_line"]

T = TypeVar("T")

# tyro's message about a value that an options class refused: the path of field names to the
# options class, then the message of the class, which begins with the name of the field.
_REFUSED = re.compile(
    r"Error parsing __tyro-dummy-inner__(?:\.(?!metric\b)\w+)?(?P<records>[.\w]*): (?P<field>\w+): "
)

_RULE = re.compile("───|---{20}")  # the second in terminals without box characters


def in_one_line(parse: Callable[[], T], see: str) -> T:
    """Result of ``parse``, or an InputError that ends with the command to ``see`` for help."""
    box = io.StringIO()
    try:
        with contextlib.redirect_stderr(box):
            return parse()
    except SystemExit as end:
        if end.code in (None, 0):
            raise
        problem = _REFUSED.sub(_option_of, _first_lines(box.getvalue()))
        raise InputError(f"{problem} (see {see})") from None


def _first_lines(box: str) -> str:
    """Text of a box of tyro, in one line, up to the first horizontal rule."""
    words = []
    for line in box.splitlines()[1:]:
        if _RULE.search(line):
            if any(words):
                break
        else:
            words.append(line.strip("│ \t"))
    return " ".join(word for word in words if word)


def _option_of(refused: re.Match[str]) -> str:
    """The option as typed on the command line.

    Only fields of `metric` have a prefix from the outermost options class.
    """
    path = f"{refused['records']}.{refused['field']}".removeprefix(".")
    return f"--{path.replace('_', '-')}: "
