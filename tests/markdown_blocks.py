"""Code blocks of Markdown pages: where they stand, in which language, and why one is not run."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]

_FENCE = re.compile(
    r"^(?:<!-- not run: (?P<reason>.+?) -->\n+)?"
    r"^(?P<fence>```+)(?P<language>[^\n`]*)\n(?P<text>.*?)^(?P=fence)[ \t]*$",
    re.M | re.S,
)
_PROMPT = "$ "


@dataclass(frozen=True, kw_only=True)
class Block:
    """A fenced block of a page.

    Attributes
    ----------
    page : str
        Path of the page from the root of the repository.
    line : int
        Line of its first line of code, from 1.
    language : str
        What stands behind the fence.
    text : str
        Its lines.
    reason : str or None
        Why it is not run, from the comment ``<!-- not run: REASON -->`` before it.
    """

    page: str
    line: int
    language: str
    text: str
    reason: str | None = None

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"


@dataclass(frozen=True, kw_only=True)
class Command:
    """A line behind a prompt, and the output that the page shows for it, if any."""

    line: str
    output: str

    def parts(self) -> Iterator[list[str]]:
        """Words of each command of a line joined by ``&&``."""
        words = shlex.split(self.line, comments=True)
        while "&&" in words:
            end = words.index("&&")
            yield words[:end]
            words = words[end + 1 :]
        yield words


def pages() -> list[Path]:
    """All Markdown pages of the repository that people read."""
    docs = ROOT / "docs"
    found = [*ROOT.glob("*.md"), *docs.rglob("*.md")]
    return sorted(page for page in found if "_build" not in page.relative_to(ROOT).parts)


def blocks_of(text: str, page: str = "page.md") -> list[Block]:
    """All fenced blocks of a page, but for the directives of Sphinx."""
    return [
        Block(
            page=page,
            line=text.count("\n", 0, found.start("text")) + 1,
            language=found["language"].strip(),
            text=found["text"],
            reason=found["reason"],
        )
        for found in _FENCE.finditer(text)
        if not found["language"].startswith("{")
    ]


def blocks_of_page(page: Path) -> list[Block]:
    return blocks_of(page.read_text(), page.relative_to(ROOT).as_posix())


def commands_of(block: Block) -> list[Command]:
    """Commands of a console block; a backslash at the end of a line continues it."""
    commands: list[Command] = []
    for line in block.text.replace("\\\n", " ").splitlines(keepends=True):
        if line.startswith(_PROMPT):
            commands.append(Command(line=line.removeprefix(_PROMPT).strip(), output=""))
        elif commands:
            last = commands.pop()
            commands.append(Command(line=last.line, output=last.output + line))
        else:
            raise ValueError(f"{block.place}: a console block begins with a prompt")
    return commands
