"""The window of the viewer: a separate process, which only this machine can reach."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time

from farpoint.errors import InputError, optional_import

__all__ = ["open_window"]

_LOOPBACK = "127.0.0.1"
_TIMEOUT_S = 20.0
# Memory limit of the viewer, because a live session may run without an end.
_MEMORY = "2GB"


def open_window() -> str:
    """Start the Rerun viewer and return the address that recordings are sent to.

    The viewer listens on the loopback interface only (Rerun's default is all interfaces) and sends
    no usage statistics. The window stays open after the end of this process.

    Raises
    ------
    MissingExtraError
        If rerun-sdk is not installed.
    InputError
        If the viewer ends at once, as on a machine without a display.
    """
    optional_import("rerun_cli", extra="rerun", purpose="the viewer")
    port = _free_port()
    command = [sys.executable, "-m", "rerun_cli", "--bind", _LOOPBACK, "--port", str(port)]
    process = subprocess.Popen(
        [*command, "--memory-limit", _MEMORY, "--expect-data-soon"],
        # With CI set, Rerun sends no usage statistics. The permanent setting of the user ("rerun
        # analytics disable") is not changed.
        env={**os.environ, "CI": "true"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C ends the run, not the window
    )
    _wait_until_it_listens(process, port)
    return f"rerun+http://{_LOOPBACK}:{port}/proxy"


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((_LOOPBACK, 0))
        return probe.getsockname()[1]


def _wait_until_it_listens(process: subprocess.Popen[bytes], port: int) -> None:
    end = time.monotonic() + _TIMEOUT_S
    while process.poll() is None and time.monotonic() < end:
        with socket.socket() as probe:
            probe.settimeout(0.5)
            if probe.connect_ex((_LOOPBACK, port)) == 0:
                return
        time.sleep(0.05)
    process.terminate()
    raise InputError(
        "the viewer does not start, as where there is no display; --rrd FILE records instead",
        field="--show",
    )
