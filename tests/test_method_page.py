"""The pages of the method stay short, name files that exist, and use the field's words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS, PACKAGE = ROOT / "docs", ROOT / "src" / "farpoint"

CODE_FILE = r"`((?:\w+/)+\w+\.py)`"
MOST_LINES = {"method.md": 600, "trajectory.md": 180}
PAGES = (*MOST_LINES, "conventions.md")

# Words of the left column of the project's list of names, and fractions in words.
AVOIDED = re.compile(
    r"\b(?:told|untold|hears?|heard|says?|doubt\w*|rivals?|twins?|narrowness|overlooked|quiet\w*|"
    r"stuck|retreats?|challenge\w*|contest\w*|haste|plausible|alike|"
    r"(?:a|one|two|three|four|nine) (?:third|quarter|fifth|tenth|eighth|twentieth)s?)\b",
    re.IGNORECASE,
)


def page(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def sections(text: str, heading: str) -> list[str]:
    """Subsections below a heading of the second level."""
    start = text.index(f"\n## {heading}\n")
    body = re.split(r"\n## ", text[start + 4 :])[0]
    return re.split(r"\n### ", body)[1:]


@pytest.mark.parametrize("name", MOST_LINES)
def test_pages_stay_short(name: str):
    assert len(page(name).splitlines()) <= MOST_LINES[name]


@pytest.mark.parametrize("name", MOST_LINES)
def test_named_files_exist(name: str):
    named = re.findall(CODE_FILE, page(name))
    assert len(named) > 5
    assert [path for path in named if not (PACKAGE / path).is_file()] == []


@pytest.mark.parametrize("heading", ["The likelihood", "Covariance"])
def test_every_term_has_its_equation_first_and_its_file(heading: str):
    terms = sections(page("method.md"), heading)
    assert len(terms) > 5
    for term in terms:
        title, text = term.split("\n", 1)
        assert text.strip().startswith("$$"), title
        assert re.search(CODE_FILE, text), title


@pytest.mark.parametrize("name", PAGES)
def test_pages_use_the_words_of_the_field(name: str):
    text = re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)", "", page(name), flags=re.DOTALL)
    assert AVOIDED.findall(text) == []
