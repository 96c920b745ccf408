"""Identifiers and file names use the field's terms: none of a list of private words.

A word of `WORDS` may be no part of an identifier (``_settled_pose``, ``SettledPose``); a name of
`NAMES` may be no identifier as a whole.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "src" / "farpoint"


def listed(text: str) -> frozenset[str]:
    return frozenset(text.split())


WORDS = listed(
    """
    told untold said heard unheard doubt held met unsettled rival rivals twin twins retreat
    narrowness settle settled settling judged judge challenge contest effort promise haste farther
    grows growth growing alike likeness quieter quietly overlooked stuck lap laps remark remarks
    deal deals dealt patience belief scout scouts bend bends bent bending inherited hint hints film
    filmed race card cards
    """
)
NAMES = listed(
    """
    second_mode rival against right_match wrong_match good_match gives_way plausible_parallax
    Found Seen Judged explain explained follow farther majority_motion between_modes shown turned
    turning moving Course left_behind seen_again Moved persistent_error fading_error door formula
    symbols lesser greater root_of choose combine fused room strung felt
    """
)


def identifiers(text: str) -> Iterator[str]:
    """Names of functions, classes, arguments, variables, attributes and modules."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                yield node.name
            case ast.Name():
                yield node.id
            case ast.arg() | ast.keyword() if node.arg is not None:
                yield node.arg
            case ast.Attribute():
                yield node.attr
            case ast.alias():
                yield from (node.asname or node.name).split(".")
            case ast.ImportFrom() if node.module is not None:
                yield from node.module.split(".")


def is_listed(identifier: str) -> bool:
    words = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", identifier)
    return identifier.strip("_") in NAMES or any(word.lower() in WORDS for word in words)


def listed_names(texts: dict[str, str]) -> list[str]:
    """``file: identifier`` of every listed name, file names included."""
    return sorted(
        {
            f"{file}: {name}"
            for file, text in texts.items()
            for name in (*identifiers(text), *Path(file).with_suffix("").parts)
            if is_listed(name)
        }
    )


def test_no_identifier_or_file_name_is_of_the_list():
    sources = {
        path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in ROOT.rglob("*.py")
    }
    assert len(sources) > 100
    assert listed_names(sources) == []


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("rivals.py", ""),
        ("a.py", "def settle_float(): ..."),
        ("a.py", "class SettledPose: ..."),
        ("a.py", "_HEARD = 1"),
        ("a.py", "def f(doubt_px2): ..."),
        ("a.py", "f(hints=1)"),
        ("a.py", "x.told"),
        ("a.py", "from b.race import c"),
        ("a.py", "import b as film"),
    ],
)
def test_listed_names_are_found(file: str, text: str):
    assert listed_names({file: text}) != []
