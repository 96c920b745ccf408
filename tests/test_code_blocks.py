"""Every code block of the documentation does what it says.

A page is read from top to bottom in a folder of its own, which holds the files of `page_files`:
its console blocks are typed, its Python blocks run in one namespace. `given_names` holds what a
page takes from its reader. A block that cannot run here is marked in its page by
``<!-- not run: REASON -->``.
"""

from __future__ import annotations

import doctest
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_kit import CAMERA, CommandLine

import farpoint as fp
from farpoint.cli import parse
from farpoint.errors import InputError
from farpoint.synthetic import make_point_scene
from farpoint.synthetic.points import PointSceneOptions
from markdown_blocks import ROOT, Block, blocks_of, blocks_of_page, commands_of, pages
from page_files import write_page_files

NOT_RUN = 10
"""Blocks of all pages that are marked as not run."""

RUN = {"run", "live", "evaluate", "camera", "compile", "--version"}
"""Commands that are run as they are typed; `fleet` is, in a process of its own."""

PARSED = {"demo", "bench"}
"""Commands that take a minute and more. The README's `demo` is run by ``.ci/run``."""

INSTALLING = {"pip", "python3", "git", "cd", "uv", "pytest", "bash"}
"""Programs of blocks that install and test. ``.ci/run`` runs those of the README."""

SHOWN = {"text", "yaml", "json", "csv", "bibtex", ""}
"""Languages of blocks that show a file or an output."""

_PLACEHOLDER = re.compile(r"[A-Z]{3,}|.*\[.*")
_EXTRAS = re.compile(r"(?:farpoint|\.)\[([\w,]+)\]")
_SAME = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE

PAGES = [page for page in pages() if blocks_of_page(page)]


@pytest.fixture(scope="module")
def page_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_page_files(tmp_path_factory.mktemp("page-files"))


@pytest.fixture
def folder(page_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the files, as the current folder."""
    place = tmp_path / "page"
    shutil.copytree(page_files, place)
    monkeypatch.chdir(place)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setenv("COLUMNS", "100")
    return place


@pytest.fixture
def type_in(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[Block], None]:
    farpoint = CommandLine(monkeypatch, capsys)
    return lambda block: _type_in(block, farpoint, folder)


def given_names() -> dict[str, Any]:
    """What readers have of their own: matches, a camera, and how it is mounted on an IMU."""
    scene = make_point_scene(PointSceneOptions(camera=CAMERA), seed=1)
    return {
        "__name__": "page",
        "np": np,
        "fp": fp,
        "farpoint": fp,
        "camera": CAMERA,
        "points0": scene.points0,
        "points1": scene.points1,
        "body_from_cam": np.eye(4),
    }


def run_python(block: Block, names: dict[str, Any]) -> None:
    """Run a block; an error names the page and the line."""
    shifted = "\n" * (block.line - 1) + block.text
    exec(compile(shifted, block.page, "exec", dont_inherit=True), names)


def _type_in(block: Block, farpoint: CommandLine, folder: Path) -> None:
    for command in commands_of(block):
        for program, *words in command.parts():
            name = Path(program).name
            if name == "farpoint":
                output = _farpoint(words, farpoint, folder)
            elif name == "python":
                output = _run_process([sys.executable, *words], folder)
            elif name in INSTALLING:
                assert_installable(words)
                output = command.output
            else:
                pytest.fail(f"{block.place}: {name} is not run by this test, and not marked")
        if command.output:
            same = doctest.OutputChecker().check_output(command.output, output, _SAME)
            assert same, f"{block.place}: {command.line} printed\n{output}"


def _farpoint(words: list[str], farpoint: CommandLine, folder: Path) -> str:
    """Run a command, or parse it where it takes long or names no file; what it printed."""
    if words[0] in PARSED or any(_PLACEHOLDER.fullmatch(word) for word in words):
        clear = [word.strip("[]") for word in words]
        assert callable(parse(clear))
        return ""
    if words[0] == "fleet":
        return _run_process([sys.executable, "-m", "farpoint", *words], folder)
    assert words[0] in RUN
    outcome = farpoint(*words)
    assert outcome.code == 0, f"{shlex.join(words)}: {outcome.err}"
    return outcome.out


def _run_process(typed: list[str], folder: Path) -> str:
    """Run a program to its end; what it printed."""
    done = subprocess.run(typed, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{shlex.join(typed)}: {done.stderr}"
    return done.stdout


def assert_installable(words: list[str]) -> None:
    """Files and extras that an installing command names are there."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for extras in _EXTRAS.findall(" ".join(words)):
        assert set(extras.split(",")) <= set(project["optional-dependencies"]), extras
    for flag, value in pairwise(words):
        if flag == "-c" and value.endswith(".txt"):
            assert (ROOT / value).is_file(), value


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_blocks_of_a_page_run(page: Path, type_in: Callable[[Block], None]):
    names = given_names()
    for block in blocks_of_page(page):
        if block.reason is not None:
            continue
        if block.language == "console":
            type_in(block)
        elif block.language == "python":
            run_python(block, names)
        else:
            assert block.language in SHOWN, block.place


def test_blocks_that_are_not_run_are_few_and_say_why():
    marked = [block for page in pages() for block in blocks_of_page(page) if block.reason]
    assert len(marked) == NOT_RUN, [block.place for block in marked]
    assert all(block.language in ("console", "python") for block in marked)


def test_every_mark_stands_right_before_a_block():
    for page in pages():
        marks = len(re.findall(r"^<!-- not run", page.read_text(), re.M))
        assert marks == sum(block.reason is not None for block in blocks_of_page(page)), page


@pytest.mark.parametrize(
    "line",
    [
        "farpoint run nowhere.mp4 --camera camera.yaml",
        "farpoint run drive.mp4 --camra camera.yaml",
        "farpoint bench --tabels paper",
        "farpoint run SOURCE --camra CALIB",
        "ros2 bag play drive",
        "pip install 'farpoint[vidoe]'",
        "farpoint camera camera.yaml\nanother: camera",
    ],
)
def test_a_command_that_does_not_work_is_noticed(line: str, type_in: Callable[[Block], None]):
    [block] = blocks_of(f"```console\n$ {line}\n```\n")
    with pytest.raises((AssertionError, InputError, pytest.fail.Exception)):
        type_in(block)


def test_an_error_of_a_program_is_reported_with_its_line():
    [block] = blocks_of("# Page\n\n```python\nx = 1\nassert x == 2\n```\n", "page.md")
    assert (block.place, block.reason) == ("page.md:4", None)
    with pytest.raises(AssertionError) as raised:
        run_python(block, {})
    assert raised.traceback[-1].lineno == 4  # from 0


def test_a_mark_and_its_block_are_found_together():
    text = "<!-- not run: needs a camera -->\n```console\n$ farpoint live\n```\n"
    [block] = blocks_of(text)
    assert block.reason == "needs a camera"
    [unmarked] = blocks_of(text.split("\n", 1)[1])
    assert unmarked.reason is None
