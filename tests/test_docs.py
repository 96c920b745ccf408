"""Whatever users can call is documented, and whatever is documented exists."""

from __future__ import annotations

import contextlib
import importlib
import re
import sys
from pathlib import Path

import pytest

from farpoint.odometry import OdometryOptions

ROOT = Path(__file__).parents[1]
API = ROOT / "docs" / "api.md"
CLI = ROOT / "docs" / "cli.md"

OPTION = r"(?<![\w-])--[a-z]\w*(?:[-.]\w+)*"

PUBLIC_MODULES = (
    "farpoint",
    "farpoint.fusion",
    "farpoint.metrics",
    "farpoint.plot",
    "farpoint.synthetic",
)
"""Modules whose ``__all__`` is a promise to users."""


def documented_names(text: str) -> dict[str, set[str]]:
    """Names with a directive of their own in the page, by the module it looks them up in."""
    names: dict[str, set[str]] = {}
    module = ""
    for line in text.splitlines():
        if found := re.match(r"\.\. currentmodule:: (\S+)$", line):
            module = found[1]
        elif found := re.match(r"\.\. auto(?:class|function|data|exception):: (\w+)$", line):
            names.setdefault(module, set()).add(found[1])
    return names


def named_options(text: str, command: str) -> set[str]:
    """Options named in the section of a command, up to the next heading of its level.

    ``--group.*`` stands for all options of this group that the section of ``farpoint run`` names.
    """
    section = re.search(rf"^## `farpoint {command}`$(.*?)(?=^## |\Z)", text, re.M | re.S)
    if not section:
        return set()
    named = set(re.findall(OPTION + r"(?!\.\*)(?![\w.-])", section[1]))
    groups = re.findall(r"--\w+\.(?=\*)", section[1])
    if groups:
        named |= {name for name in named_options(text, "run") if name.startswith(tuple(groups))}
    return named


@pytest.mark.parametrize("module", PUBLIC_MODULES)
def test_every_public_name_is_documented(module: str):
    public = set(importlib.import_module(module).__all__)
    assert public - documented_names(API.read_text())[module] == set()


def test_every_documented_name_exists():
    for module, names in documented_names(API.read_text()).items():
        missing = {name for name in names if not hasattr(importlib.import_module(module), name)}
        assert missing == set(), module


@pytest.fixture
def commands() -> dict:
    return importlib.import_module("farpoint.cli").COMMANDS


def offered_options(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> set[str]:
    """Options that a command's own help names; of a switch, the name that turns it on."""
    monkeypatch.setattr(sys, "argv", ["farpoint", command, "--help"])
    monkeypatch.setenv("COLUMNS", "240")
    with contextlib.suppress(SystemExit):
        importlib.import_module("farpoint.cli").main()
    offered = set(re.findall(OPTION, capsys.readouterr().out)) - {"--help"}
    return {name for name in offered if name.replace("no-", "", 1) not in offered - {name}}


def test_every_command_is_documented_and_no_other(commands: dict):
    documented = set(re.findall(r"^## `farpoint (\w+)`$", CLI.read_text(), re.M))
    assert documented == set(commands)


def test_every_option_is_documented_and_no_other(
    commands: dict, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    text = CLI.read_text()
    offered = {name: offered_options(name, monkeypatch, capsys) for name in commands}
    assert "--camera" in offered["run"]
    assert {name: named_options(text, name) for name in commands} == offered


def _documented_defaults() -> dict[str, str]:
    """Of the options of `farpoint run` that stand in a table of three columns."""
    text = CLI.read_text()
    run = text[: text.index("## `farpoint fleet`")]
    return dict(re.findall(r"^\| `--([\w.-]+)` \| ([^|]*?) \|", run, flags=re.MULTILINE))


def test_documented_defaults_are_those_of_the_options():
    options, compared = OdometryOptions(), 0
    for name, told in _documented_defaults().items():
        parts = name.replace("-", "_").split(".")
        value: object = options
        for part in parts:
            value = getattr(value, part, None)
            if value is None:
                break
        if len(parts) > 1 and isinstance(value, (bool, int, float)):
            expected = ("on" if value else "off") if isinstance(value, bool) else value
            assert told == expected or float(told) == expected, name
            compared += 1
    assert compared > 35
