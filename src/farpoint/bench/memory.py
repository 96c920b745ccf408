"""How much memory this process takes."""

from __future__ import annotations

import sys
from pathlib import Path

__all__ = ["resident_mb"]


def resident_mb() -> float:
    """Memory that the process holds now, MB; its largest so far where only that is told."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        import resource  # not on Windows

        largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return largest / (1e6 if sys.platform == "darwin" else 1e3)
    import resource

    return pages * resource.getpagesize() / 1e6
