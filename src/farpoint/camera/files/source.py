"""A calibration file in memory: its text, and its contents as YAML, JSON or XML."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from farpoint.camera.files.fields import Fields
from farpoint.camera.files.npz import MAGIC, arrays_of_npz
from farpoint.errors import InputError
from farpoint.regular_files import read_regular_file

__all__ = ["CalibrationFile"]

_MOST_DIGITS = 18
LARGEST_BYTES = 1 << 24
"""Size limit of a calibration file. Calibrations have a few kilobytes; a larger file is a video or
an image (convention)."""

LARGEST_YAML_BYTES = 1 << 20
"""Size limit of a YAML file. The YAML parser takes a second for this size."""
# Largest number of items of a YAML file after its aliases are expanded.
MOST_ITEMS = 100_000


@dataclass(frozen=True)
class CalibrationFile:
    """The bytes of a file, with the views (text, lines, fields) that the format readers use.

    Attributes
    ----------
    path : Path
        Path of the file. A camera without a name is named by the file name without the suffix.
    data : bytes
        Bytes of the file.
    """

    path: Path
    data: bytes

    @classmethod
    def open(cls, path: Path) -> CalibrationFile:
        """Read a file, or raise an InputError with the cause."""
        data = read_regular_file(path, limit_bytes=LARGEST_BYTES, what="a calibration")
        if not data.strip():
            raise InputError("the file is empty; expected a calibration", file=path)
        return cls(path, data)

    @cached_property
    def text(self) -> str:
        """The contents as UTF-8 text; empty if the contents are not text."""
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            return ""

    @cached_property
    def lines(self) -> list[str]:
        """Lines of the text, without comments after ``#`` and without empty lines."""
        stripped = (line.split("#", 1)[0].strip() for line in self.text.splitlines())
        return [line for line in stripped if line]

    @property
    def fields(self) -> Fields:
        """The mapping at the top of a YAML, JSON, XML or NumPy file; empty for other files."""
        content = self._content
        return Fields(content if isinstance(content, dict) else {}, self.path)

    @property
    def fault(self) -> InputError | None:
        """Reason why a YAML, JSON, XML or NumPy file could not be parsed, or else None."""
        return self._content if isinstance(self._content, InputError) else None

    @property
    def is_archive(self) -> bool:
        """Whether the file begins like a NumPy archive."""
        return self.data.startswith(MAGIC)

    def _arrays(self) -> Any:
        try:
            return arrays_of_npz(self.data)
        except ValueError as error:
            return InputError(
                f"malformed NumPy archive: {' '.join(str(error).split())[:120]}", file=self.path
            )

    @cached_property
    def _content(self) -> Any:
        if self.is_archive:
            return self._arrays()
        text = self.text.lstrip()
        parse = _parse_json if text[:1] == "{" else _parse_xml if text[:1] == "<" else _parse_yaml
        try:
            return parse(self.text)
        except _MalformedError as malformed:
            return InputError(malformed.problem, file=self.path, field=malformed.place)
        except RecursionError:
            return InputError("is nested too deeply; expected a calibration", file=self.path)


class _MalformedError(Exception):
    def __init__(self, problem: str, line: int | None):
        self.problem = problem
        self.place = None if line is None else f"line {line}"
        super().__init__(problem)


def _whole(digits: str) -> int | float:
    """A whole number of JSON. A number with too many digits becomes a float, possibly infinite."""
    return int(digits) if len(digits) <= _MOST_DIGITS else float(digits)


def _mapping(pairs: Iterable[tuple[Any, Any]]) -> dict[Any, Any]:
    """A mapping. A key that occurs twice with different values raises an error."""
    found: dict[Any, Any] = {}
    for key, value in pairs:
        if found.setdefault(key, value) != value:
            raise _MalformedError(f"has {key} twice, with different values", None)
    return found


def _parse_json(text: str) -> Any:
    try:
        return json.loads(text, parse_int=_whole, object_pairs_hook=_mapping)
    except json.JSONDecodeError as error:
        raise _MalformedError(f"malformed JSON: {error.msg}", error.lineno) from None
    except ValueError:
        # Python reads no integer of thousands of digits.
        raise _MalformedError("malformed JSON: a number is too long", None) from None


def _parse_yaml(text: str) -> Any:
    """Parse YAML. Every scalar stays a string, and tags are ignored, so no code is executed.

    OpenCV's dialect is accepted: the header ``%YAML:1.0``, ``key:value`` without the space, tabs,
    and the tag ``!!opencv-matrix``.
    """
    # Imported on use: programs that read no calibration need not wait for the import.
    import yaml

    if len(text) > LARGEST_YAML_BYTES:
        raise _MalformedError(
            f"is too large for a calibration: more than {LARGEST_YAML_BYTES >> 20} MB", None
        )
    text = re.sub(r"\A(\s*)%YAML[^\n]*", r"\1", text).expandtabs(4)
    text = re.sub(r"(?m)^([ ]*[A-Za-z_][\w.]*):(?=[^\s:/\\])", r"\1: ", text)
    try:
        # A file may end in the mark of a next document, as `ros2 topic echo` prints it.
        content, *others = [*yaml.load_all(text, Loader=_yaml_loader())] or [None]
        if any(other not in (None, "", content) for other in others):
            raise _MalformedError("holds several YAML documents; expected one calibration", None)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise _MalformedError(
            f"malformed YAML: {error.problem or error.context}",
            None if mark is None else mark.line + 1,
        ) from None
    except yaml.YAMLError as error:
        raise _MalformedError(f"malformed YAML: {str(error).splitlines()[0]}", None) from None
    if "*" in text and not _is_bounded(content):
        raise _MalformedError("malformed YAML: its aliases stand for too much", None)
    return content


@cache
def _yaml_loader() -> type[Any]:
    """A loader that reads scalars as strings and refuses a key with two different values."""
    import yaml

    class Loader(yaml.BaseLoader):
        def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
            """Mapping as in the base class, but a key with two different values is an error."""
            found = super().construct_mapping(node, deep=deep)
            if len(found) < len(node.value):
                pairs = (
                    (self.construct_object(key, deep=True), self.construct_object(value, deep=True))
                    for key, value in node.value
                )
                _mapping(pairs)
            return found

    return Loader


def _is_bounded(content: Any) -> bool:
    """Whether the content has at most `MOST_ITEMS` items after every alias is expanded."""
    waiting, count = [content], 0
    while waiting:
        item = waiting.pop()
        children = (
            item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()
        )
        count += 1 + len(children)
        if count > MOST_ITEMS:
            return False
        waiting.extend(children)
    return True


def _parse_xml(text: str) -> Any:
    """XML as nested mappings of tag to text, in the form that OpenCV's FileStorage writes.

    A document type is refused, so no entity is defined or expanded.
    """
    if (doctype := text.find("<!DOCTYPE")) >= 0:
        raise _MalformedError(
            "a document type is not accepted in XML", text.count("\n", 0, doctype) + 1
        )
    try:
        return _tree(ElementTree.fromstring(text.strip().encode()))
    except ElementTree.ParseError as error:
        raise _MalformedError("malformed XML", error.position[0]) from None
    except (ValueError, LookupError):
        raise _MalformedError("malformed XML: its encoding is not UTF-8", 1) from None


def _tree(element: ElementTree.Element) -> Any:
    if len(element) == 0:
        return (element.text or "").strip()
    return _mapping((child.tag, _tree(child)) for child in element)
