"""Memory and processor time of this process and its child processes."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

__all__ = ["children_cpu_s", "resident_mb"]

# Indices of fields after the name in /proc/PID/stat: parent, CPU time in user and in kernel mode.
_PARENT, _USER, _KERNEL = 1, 11, 12


def resident_mb() -> float:
    """Memory in use, MB; if the system does not report this figure, the peak of this process."""
    import resource  # not on Windows

    try:
        pages = sum(_resident_pages(pid) for pid in [os.getpid(), *(pid for pid, _ in _children())])
    except OSError:
        largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return largest / (1e6 if sys.platform == "darwin" else 1e3)
    return pages * resource.getpagesize() / 1e6


def children_cpu_s() -> float:
    """CPU time, s, of the running processes that this process has started; 0 if unknown."""
    ticks = sum(int(fields[_USER]) + int(fields[_KERNEL]) for _, fields in _children())
    return ticks / os.sysconf("SC_CLK_TCK")


def _children() -> Iterator[tuple[int, list[str]]]:
    """Process id and status fields of each running process that this process has started."""
    for place in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = place.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
        except OSError:  # it has just ended
            continue
        if int(fields[_PARENT]) == os.getpid():
            yield int(place.parent.name), fields


def _resident_pages(pid: int) -> int:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        if pid == os.getpid():
            raise
        return 0  # it has just ended
