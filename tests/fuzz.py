"""Mutants for the tests of readers: a few in the suite, many where asked for."""

from __future__ import annotations

import os
import random
import re
from collections.abc import Sequence

__all__ = ["fuzz_count", "mutant"]

ODD = ("1e300", "-1e308", "nan", "inf", "", "-1", "0", "9" * 400, "x", "1e-320", "\x1b[31m", "\x00")
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")


def fuzz_count(few: int) -> int:
    """``few`` times the environment's ``FARPOINT_FUZZ``, 1 by default."""
    return few * int(os.environ.get("FARPOINT_FUZZ", "1"))


def mutant(text: str, rng: random.Random, odd: Sequence[str] = ODD) -> bytes:
    """A text with odd numbers, cuts, lines out of place or a byte of noise."""
    for _ in range(rng.choice((1, 1, 4))):
        where = rng.randrange(5)
        if where < 3 and (found := list(NUMBER.finditer(text))):
            hit = rng.choice(found)
            text = text[: hit.start()] + rng.choice(odd) + text[hit.end() :]
        elif where == 3:
            text = text[: rng.randrange(len(text) + 1)]
        else:
            lines = text.splitlines(keepends=True)
            rng.shuffle(lines)
            text = "".join(lines)
    data = bytearray(text.encode())
    if data and rng.random() < 0.2:
        data[rng.randrange(len(data))] = rng.randrange(256)
    return bytes(data)
