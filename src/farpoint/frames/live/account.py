"""Counts of the frames of a live session."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["LiveAccount"]


@dataclass(frozen=True, kw_only=True)
class LiveAccount:
    """Counts of a live session; ``captured == taken + dropped + broken + waiting`` at any time.

    Attributes
    ----------
    captured : int
        Frames that the source delivered.
    taken : int
        Frames that were processed.
    dropped : int
        Frames that were not processed, because a newer frame arrived or the session ended.
    broken : int
        Frames that could not be decoded.
    waiting : int
        1 if the newest frame has not been taken for processing, otherwise 0.
    disconnects : int
        Number of times the source was lost: the source ended, sent no frames, or raised an error.
    reconnects : int
        Number of times the source was opened again.
    longest_silence_s : float
        Longest time between two frames, or time since the last frame if longer.
    last_fault : str or None
        Reason of the last loss of the source.
    """

    captured: int = 0
    taken: int = 0
    dropped: int = 0
    broken: int = 0
    waiting: int = 0
    disconnects: int = 0
    reconnects: int = 0
    longest_silence_s: float = 0.0
    last_fault: str | None = None
