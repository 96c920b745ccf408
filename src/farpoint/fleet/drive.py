"""A drive of a fleet, with the key by which a finished drive is recognised."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import urlsplit

import farpoint
from farpoint.fleet.inputs import state_of_input

__all__ = ["Drive"]


@dataclass(frozen=True, kw_only=True)
class Drive:
    """One source with its options.

    Attributes
    ----------
    source : str
        Source as given by the user.
    camera : str
        Calibration as given by the user; may be empty.
    options : dataclass
        All options that determine the outputs, in addition to the source and the version.
    run : callable
        Runs the drive into a folder. The function is pickled and sent to the worker.
    own_options : str
        Options of this drive only, which distinguish several drives of the same source.
    """

    source: str
    camera: str
    options: Any
    run: Callable[[Path], None]
    own_options: str = ""

    @property
    def name(self) -> str:
        """Name of the folder of the drive, independent of the other drives."""
        whole = self.source if "://" in self.source else str(Path(self.source).absolute())
        identity = json.dumps([whole, self.own_options])
        stem = PurePosixPath(urlsplit(whole).path.rstrip("/")).stem if "://" in whole else ""
        stem = stem or Path(whole).stem or "drive"
        plain = re.sub(r"[^\w.-]+", "-", stem)[:80]
        return f"{plain}-{_digest(identity)[:8]}"

    def key(self) -> str:
        """Hash of inputs, options and version. A folder with the same key is a finished drive."""
        inputs = [state_of_input(name) for name in (self.source, *_files_in(self.options))]
        return _digest(json.dumps([inputs, repr(self.options), farpoint.__version__]))


def _files_in(options: Any) -> Iterator[str]:
    """Every path in a record of options, including nested records."""
    for field in fields(options):
        value = getattr(options, field.name)
        if isinstance(value, Path):
            yield str(value)
        elif is_dataclass(value):
            yield from _files_in(value)


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
