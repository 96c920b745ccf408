"""Loaded by each worker of a local cluster when it starts."""

from __future__ import annotations

import signal

__all__ = ["dask_setup"]


def dask_setup(worker: object) -> None:
    """Leave Ctrl-C, which goes to every process of a terminal, to the process that leads."""
    del worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
