"""Numbers that are times: the unit of a number, and file names that are times."""

from __future__ import annotations

import math
import re
from pathlib import Path

__all__ = ["parse_seconds", "seconds_in_name"]

# Unix time in ms, us or ns, or in seconds with decimals; any other number is a counter.
_STAMP_NAME = re.compile(r"[1-9][0-9]{12}|[1-9][0-9]{15}|[1-9][0-9]{18}|[0-9]{9,10}\.[0-9]+")


def parse_seconds(text: str) -> float:
    """Seconds from a number in seconds, or in ms, us or ns if the number is too large for seconds.

    Raises ValueError if the text is no finite number.
    """
    # Integers stay exact until the division: a Unix time in nanoseconds exceeds 2^53.
    value = int(text) if text.isascii() and text.isdigit() else float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    # Unix time in seconds has 10 digits until the year 2286; three more for each smaller unit.
    for limit, unit in ((1e11, 1), (1e14, 10**3), (1e17, 10**6)):
        if abs(value) < limit:
            return value / unit
    return value / 10**9


def seconds_in_name(path: Path) -> float | None:
    """Time, s, from a file name that is a Unix time in seconds with decimals, ms, us or ns.

    Image names are nanoseconds in EuRoC sequences and seconds in TUM sequences. The result is None
    for counters and all other names.
    """
    return parse_seconds(path.stem) if _STAMP_NAME.fullmatch(path.stem) else None
