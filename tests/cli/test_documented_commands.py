"""Commands that the documentation tells people to type are commands that farpoint takes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from farpoint.cli import COMMANDS, parse
from farpoint.errors import InputError
from markdown_blocks import pages

PAGES = pages()


def documented_commands() -> list[str]:
    """What follows ``farpoint`` in the console blocks, without the brackets of what is optional."""
    found: dict[str, None] = {}
    for page in PAGES:
        for block in re.findall(r"^```console\n(.*?)^```$", page.read_text(), re.M | re.S):
            lines = re.findall(r"^\$ (.*)$", block.replace("\\\n", " "), re.M)
            for command in (part for line in lines for part in re.split(r"&&|\|", line)):
                program, *words = shlex.split(command.translate({ord(c): None for c in "[]"}))
                if Path(program).name == "farpoint":
                    found[shlex.join(words)] = None
    return list(found)


def test_the_documentation_names_every_command():
    assert {command.split()[0] for command in documented_commands()} == set(COMMANDS)


@pytest.mark.parametrize("command", documented_commands())
def test_a_documented_command_can_be_typed(command: str):
    assert callable(parse(shlex.split(command)))


def test_the_check_can_fail():
    with pytest.raises(InputError, match="--camra"):
        parse(["run", "drive.mp4", "--camra", "calib.yaml"])
