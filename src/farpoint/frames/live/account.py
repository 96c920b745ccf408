"""What came, what was used, and what was not: nothing is lost without a number."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["LiveAccount"]


@dataclass(frozen=True, kw_only=True)
class LiveAccount:
    """Counts of a live session.

    ``captured == taken + dropped + broken + waiting`` at every moment.

    Attributes
    ----------
    captured : int
        Frames that the source delivered.
    taken : int
        Frames handed on to be worked on.
    dropped : int
        Frames replaced by a newer one before anybody took them, or left when the session ended.
    broken : int
        Frames that could not be decoded.
    waiting : int
        0 or 1: the newest, if it has not been taken.
    disconnects : int
        Times the source was lost: ended, fell silent for good, or raised an error.
    reconnects : int
        Times it was opened again.
    longest_silence_s : float
        Longest time between two frames, or since the last one.
    last_fault : str or None
        Why the source was lost the last time.
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
