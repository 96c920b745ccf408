"""The two errors a user can cause, and what their one line must say."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from types import ModuleType

__all__ = ["InputError", "MissingExtraError", "optional_import", "require"]


class InputError(ValueError):
    """Something given to farpoint cannot be used: says which, where, and what was expected.

    Parameters
    ----------
    problem : str
        What was found and what was expected, without a full stop.
    file : str or Path, optional
        The file the problem lies in; named first in the message.
    field : str, optional
        The argument, key, line or column the problem lies in; named after the file.
    """

    def __init__(self, problem: str, *, file: str | Path | None = None, field: str | None = None):
        self.problem = problem
        self.file = None if file is None else str(file)
        self.field = field
        message = ": ".join(part for part in (self.file, self.field, problem) if part)
        # A name or a value may hold a line break; the message is one line all the same.
        super().__init__(" ".join(message.splitlines()))


class MissingExtraError(ImportError):
    """An optional library is absent: names the extra that brings it."""


def optional_import(module: str, *, extra: str, purpose: str) -> ModuleType:
    """Import an optional library on use, or say in one line how to get it.

    Parameters
    ----------
    module : str
        Name as in an import statement, such as ``"cv2"``.
    extra : str
        The extra of farpoint that installs it, such as ``"video"``.
    purpose : str
        What it is needed for, as the subject of a sentence, such as ``"reading video"``.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise _missing(module, extra, purpose) from error


def require(module: str, *, extra: str, purpose: str) -> None:
    """Raise what `optional_import` would where a library is absent, without loading it."""
    if importlib.util.find_spec(module) is None:
        raise _missing(module, extra, purpose)


def _missing(module: str, extra: str, purpose: str) -> MissingExtraError:
    return MissingExtraError(
        f"{purpose} needs {module}: install it with pip install 'farpoint[{extra}]'"
    )
