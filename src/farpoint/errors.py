"""Errors that a user can cause. Each message is one line."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from types import ModuleType

__all__ = ["InputError", "MissingExtraError", "optional_import", "printable", "require"]


class InputError(ValueError):
    """An argument, option or file cannot be used.

    The message names the cause and the expected value.

    Parameters
    ----------
    problem : str
        The given and the expected value, without a full stop.
    file : str or Path, optional
        The file at fault, which the message names first.
    field : str, optional
        The argument, key, line or column at fault, which the message names after the file.
    """

    def __init__(self, problem: str, *, file: str | Path | None = None, field: str | None = None):
        self.problem = problem
        self.file = None if file is None else str(file)
        self.field = field
        message = ": ".join(part for part in (self.file, self.field, problem) if part)
        super().__init__(printable(message))


def printable(text: str) -> str:
    r"""Escape every character that cannot be printed, so that text stays on one line.

    File names and the contents of files may hold newlines, control characters and escape sequences.

    Examples
    --------
    >>> printable('a\nb')
    'a\\nb'
    """
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text
    )


class MissingExtraError(ImportError):
    """An optional library is absent. The message names the extra that installs the library."""


def optional_import(module: str, *, extra: str, purpose: str) -> ModuleType:
    """Import an optional library, or raise `MissingExtraError` if the library is absent.

    Parameters
    ----------
    module : str
        Name as in an import statement, such as ``"cv2"``.
    extra : str
        The extra of farpoint that installs the library, such as ``"video"``.
    purpose : str
        Use of the library, as the subject of a sentence, such as ``"reading video"``.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise _missing(module, extra, purpose) from error


def require(module: str, *, extra: str, purpose: str) -> None:
    """Raise `MissingExtraError` if a library is absent, without loading the library."""
    if importlib.util.find_spec(module) is None:
        raise _missing(module, extra, purpose)


def _missing(module: str, extra: str, purpose: str) -> MissingExtraError:
    return MissingExtraError(
        f"{purpose} needs {module}: install it with pip install 'farpoint[{extra}]'"
    )
