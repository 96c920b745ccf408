"""README, CHANGELOG and what is promised stay short, plain, and true to the files they name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
CHANGELOG = ROOT / "CHANGELOG.md"
PROMISE = ROOT / "docs" / "promise.md"

FRACTION = re.compile(
    r"\b(?:half|halves|(?:a|an|one|two|three|four|five|seven|eight|nine)[ -]"
    r"(?:thirds?|quarters?|fifths?|sixths?|sevenths?|eighths?|ninths?|tenths?))\b",
    re.I,
)
"""A number that is not a figure."""

# A heading of a release: its number, and the day.
_RELEASE = re.compile(r"^## (?P<version>\d+\.\d+\.\d+) - (?P<day>\d{4}-\d\d-\d\d)$", re.M)
_TEST = re.compile(r"`((?:tests|examples)/[\w/]+(?:\.py)?)`")
_LINK = re.compile(r"\]\(([^)\s]+)\)")


def released_sections() -> dict[str, list[str]]:
    """Lines of each release in the changelog, its heading included."""
    text = CHANGELOG.read_text()
    starts = [*_RELEASE.finditer(text)]
    ends = [*(found.start() for found in starts[1:]), len(text)]
    return {
        found["version"]: text[found.start() : end].splitlines()
        for found, end in zip(starts, ends, strict=True)
    }


@pytest.mark.parametrize(("page", "most"), [(README, 160), (PROMISE, 250)])
def test_a_page_is_short(page: Path, most: int):
    assert len(page.read_text().splitlines()) <= most


def test_the_changelog_has_what_is_not_released_and_short_releases():
    assert "## Unreleased\n" in CHANGELOG.read_text()
    sections = released_sections()
    assert "0.1.0" in sections
    assert {version: len(lines) for version, lines in sections.items() if len(lines) > 40} == {}


def test_the_readme_gives_figures_and_no_fractions_in_words():
    without_code = re.sub(r"`[^`\n]+`", "", README.read_text())  # a table is named halves
    assert FRACTION.findall(without_code) == []
    for words in ("a fifth less", "Half of them", "two thirds", "nine-tenths of it"):
        assert FRACTION.search(words), words


def test_the_readme_begins_with_the_demo_and_the_tests():
    blocks = re.findall(r"^```console\n(.*?)^```", README.read_text(), re.M | re.S)
    assert [block.count("\n") for block in blocks[:2]] == [1, 1]
    assert blocks[0].endswith(".venv/bin/farpoint demo\n")
    assert ".venv/bin/pytest" in blocks[1]


def test_what_is_promised_names_tests_and_examples_that_exist():
    named = set(_TEST.findall(PROMISE.read_text()))
    assert len(named) > 20
    assert {name for name in named if not (ROOT / name).exists()} == set()


def test_what_is_promised_has_no_figure_of_a_script():
    assert "script" not in PROMISE.read_text()


@pytest.mark.parametrize("page", [README, CHANGELOG])
def test_links_within_the_repository_lead_somewhere(page: Path):
    links = {link.split("#")[0] for link in _LINK.findall(page.read_text()) if "://" not in link}
    assert {link for link in links if not (ROOT / link).exists()} == set()
