"""Print the N-th console command of the README, so that what is documented is what is run."""

import re
import sys
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def commands(text: str) -> list[str]:
    """The commands of all ``console`` blocks, without their prompts."""
    blocks = re.findall(r"^```console\n(.*?)^```", text, re.M | re.S)
    return [
        line.removeprefix("$ ")
        for block in blocks
        for line in block.splitlines()
        if line.startswith("$ ")
    ]


if __name__ == "__main__":
    print(commands(README.read_text())[int(sys.argv[1]) - 1])
