"""Figures of the documentation are files of ``farpoint bench``, and pages show what these hold."""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from farpoint.bench.options import TABLES
from farpoint.cli import parse

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
FILES = sorted((DOCS / "measured").glob("*.json"))
README = ROOT / "README.md"

_DIRECTIVE = re.compile(r"^```\{measured\} (\w+)$", re.M)


def _load() -> ModuleType:
    """The extension of the docs; they are no package."""
    spec = importlib.util.spec_from_file_location("measured_table", DOCS / "measured_table.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


pytest.importorskip("sphinx")
measured_table = _load()


def named_files() -> set[str]:
    """Files that pages show, by their stems."""
    return {name for page in DOCS.rglob("*.md") for name in _DIRECTIVE.findall(page.read_text())}


def test_every_file_is_shown_and_every_file_shown_is_there():
    assert named_files() == {file.stem for file in FILES}
    assert FILES


def test_no_table_of_what_is_promised_is_measured_by_hand():
    _, found, measured = (DOCS / "promise.md").read_text().partition("\n## Measured\n")
    assert found
    assert len(_DIRECTIVE.findall(measured)) > 10
    assert [line for line in measured.splitlines() if line.startswith("|")] == []


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_a_file_is_of_a_command_that_makes_it(file: Path):
    table = measured_table.read_table(file)
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", table.date)
    program, *words = shlex.split(table.command)
    assert (program, words[:2]) == ("farpoint", ["bench", "--tables"])
    assert words[2] in TABLES
    assert callable(parse(words))


TABLE: dict[str, Any] = {
    "date": "2026-11-28",
    "environment": "a machine",
    "command": "farpoint bench --tables fruit",
    "columns": [
        {"name": "name", "decimals": 0},
        {"name": "count", "decimals": 0},
        {"name": "weight_kg", "decimals": 2},
    ],
    "rows": [["apple", 12, 1.23457], ["pear", 3, None], ["plum", 0, 0.5]],
}


@pytest.fixture
def pages(tmp_path: Path) -> Path:
    """A documentation of one page with one table."""
    (tmp_path / "conf.py").write_text(
        f"import sys\nsys.path.insert(0, {str(DOCS)!r})\n"
        "extensions = ['measured_table', 'myst_parser']\n"
    )
    (tmp_path / "measured").mkdir()
    (tmp_path / "measured" / "fruit.json").write_text(json.dumps(TABLE))
    return tmp_path


def build(pages: Path, block: str) -> str:
    """Text of the page that shows a block."""
    from sphinx.application import Sphinx
    from sphinx.util.docutils import docutils_namespace, patch_docutils

    (pages / "index.md").write_text(f"# Page\n\n{block}")
    out = str(pages / "out")
    with patch_docutils(str(pages)), docutils_namespace():
        app = Sphinx(str(pages), str(pages), out, out, "text", status=None, warningiserror=True)
        app.build(force_all=True)
    return (pages / "out" / "index.txt").read_text()


def rows_of(text: str) -> list[list[str]]:
    """Cells of a table as Sphinx writes it as text."""
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in text.splitlines()
        if line.startswith("|") and not line.startswith("|=")
    ]


def test_a_page_shows_rows_columns_headings_command_and_day(pages: Path):
    text = build(
        pages,
        "```{measured} fruit\n"
        ":columns: weight_kg as weight (kg), name\n"
        ":where: count = 12 | 3\n```\n",
    )
    assert rows_of(text) == [["weight (kg)", "name"], ["1.23", "apple"], ["", "pear"]]
    assert '"farpoint bench --tables fruit", 2026-11-28' in text


def test_a_page_shows_all_without_options(pages: Path):
    rows = rows_of(build(pages, "```{measured} fruit\n```\n"))
    assert rows[0] == ["name", "count", "weight_kg"]
    assert rows[3] == ["plum", "0", "0.50"]
    assert len(rows) == 4


@pytest.mark.parametrize(
    ("block", "text", "problem"),
    [
        ("```{measured} nuts\n```\n", None, r"nuts\.json: .*No such file"),
        ("```{measured} fruit\n```\n", '{"date": ', r"fruit\.json: "),
        ("```{measured} fruit\n```\n", "[]", r"fruit\.json: expected an object"),
        (
            "```{measured} fruit\n```\n",
            json.dumps({**TABLE, "command": None}),
            r"fruit\.json: command: expected a str",
        ),
        (
            "```{measured} fruit\n```\n",
            json.dumps({**TABLE, "rows": [[1, 2]]}),
            r"fruit\.json: rows: expected some, each of 3 cells",
        ),
        (
            "```{measured} fruit\n:columns: wait_kg\n```\n",
            None,
            r"fruit\.json: no column 'wait_kg'",
        ),
        ("```{measured} fruit\n:where: name = fig\n```\n", None, r"fruit\.json: no row where"),
        ("```{measured} fruit\n:where: name\n```\n", None, r"fruit\.json: expected COLUMN = VALUE"),
    ],
)
def test_what_cannot_be_shown_ends_the_build_naming_the_file(
    pages: Path, block: str, text: str | None, problem: str
):
    from sphinx.errors import ExtensionError

    if text is not None:
        (pages / "measured" / "fruit.json").write_text(text)
    with pytest.raises(ExtensionError, match=r"^index\.md:3: .*" + problem):
        build(pages, block)
