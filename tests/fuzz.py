"""How many mutants the tests of readers make: a few in the suite, many where asked for."""

from __future__ import annotations

import os

__all__ = ["fuzz_count"]


def fuzz_count(few: int) -> int:
    """``few`` times the environment's ``FARPOINT_FUZZ``, 1 by default."""
    return few * int(os.environ.get("FARPOINT_FUZZ", "1"))
