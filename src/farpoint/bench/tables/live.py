"""The tables of a live session with faults: correctness of counts and files, and memory."""

from __future__ import annotations

import tempfile
from pathlib import Path

from farpoint.bench.live_session import LiveTrial, try_live
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.table import Column, Table

__all__ = ["live_tables"]

_SHORT_S, _FULL_S = 60, 600


def live_tables(options: BenchOptions, progress: Progress) -> tuple[Table, ...]:
    """Table of known and counted faults, and table of the memory during the session."""
    seconds = options.pairs or (_FULL_S if options.full else _SHORT_S)
    progress("live", 0, 1)
    with tempfile.TemporaryDirectory(prefix="farpoint-live-") as folder:
        trial = try_live(float(seconds), Path(folder) / "out", seed=options.seed)
    progress("live", 1, 1)
    command = options.command("live")
    return _account_table(trial, seconds, command), _memory_table(trial, command)


def _account_table(trial: LiveTrial, seconds: int, command: str) -> Table:
    state, account = trial.state, trial.state.account
    return Table(
        name="live",
        title=f"A live session of {seconds} s with stalls, black frames and disconnections",
        command=command,
        columns=(Column("what"), Column("expected"), Column("found")),
        rows=tuple((claim.what, claim.expected, claim.found) for claim in trial.claims),
        notes=(
            "a looped drive at 30 frames a second, of which the newest frame is used; expected: "
            "counts of the source, or counts of the session for its files",
            f"{account.taken} frames used, {account.dropped} dropped for newer ones; "
            f"{state.not_drawn} not drawn; {trial.black} frames were black, "
            f"{trial.failed} pairs FAILED; longest silence {account.longest_silence_s:.1f} s, "
            f"longest latency {1e3 * state.longest_latency_s:.0f} ms",
            "the number of dropped frames depends on the machine and differs from run to run",
        ),
    )


def _memory_table(trial: LiveTrial, command: str) -> Table:
    return Table(
        name="live_memory",
        title="The same session over time",
        command=command,
        columns=(
            Column("elapsed_s", 0),
            Column("memory_mb", 1),
            Column("used"),
            Column("dropped"),
            Column("latency_ms", 1),
        ),
        rows=tuple(
            (
                moment.elapsed_s,
                moment.memory_mb,
                moment.state.account.taken,
                moment.state.account.dropped,
                1e3 * moment.state.latency_s,
            )
            for moment in trial.moments
        ),
        notes=(
            "memory of the process, with the pictures of the source, and of the drawing processes",
        ),
    )
