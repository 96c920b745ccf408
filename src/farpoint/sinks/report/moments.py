"""The worst moments of a run, which a reader should check first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from farpoint.pose import PoseStatus
from farpoint.sinks.motions import Motions

__all__ = ["Moment", "MomentSeeker"]

_MAX_STRETCHES = 4
_LONG_GAP = 1.5  # as a multiple of the usual time between frames


@dataclass(frozen=True, kw_only=True)
class Moment:
    """One pair of frames, or a stretch of pairs, with a problem.

    Attributes
    ----------
    time_s : float
        Time of the newer frame of the first pair, s since the first frame of the run.
    frame0, frame1 : int
        Indices of the frames of the first pair.
    title : str
        Name of the problem.
    reason : str
        Reason of the problem, in a sentence; may be empty.
    """

    time_s: float
    frame0: int
    frame1: int
    title: str
    reason: str = ""


@dataclass(kw_only=True)
class _Stretch:
    status: PoseStatus
    first: tuple[float, int, int]
    last_frame: int
    pairs: int = 0


class MomentSeeker:
    """Search for the worst moments of a run, part by part, with bounded memory.

    Parameters
    ----------
    start_s : float
        Time stamp of the first frame.
    """

    def __init__(self, start_s: float) -> None:
        self._start_s = start_s
        self._extremes: dict[str, tuple[float, Moment]] = {}
        self._stretches: list[_Stretch] = []
        self._open: _Stretch | None = None
        self._usual_gap_s = np.inf

    def look(self, motions: Motions, quantities: Mapping[str, np.ndarray]) -> None:
        """Examine the next rows of ``motions.csv``, with the values of the curves in these rows."""
        counted = np.maximum(motions.far + motions.near + motions.outliers, 1)
        known = motions.status != PoseStatus.FAILED
        share = np.where(known, 100.0 * motions.outliers / counted, np.nan)
        gap = motions.timestamp1 - motions.timestamp0
        self._extreme(
            motions, quantities["direction_sigma"], "Direction least sure", "1-sigma", "deg"
        )
        self._extreme(
            motions, quantities["rotation_sigma"], "Rotation least sure", "1-sigma", "deg"
        )
        self._extreme(motions, share, "Most outliers", "of the matches", "%")
        self._usual_gap_s = min(self._usual_gap_s, float(np.median(gap)))
        if gap.max() > _LONG_GAP * self._usual_gap_s:
            self._extreme(motions, gap, "Longest time between frames", "without a frame", "s")
        for row in np.flatnonzero(motions.status != PoseStatus.OK):
            self._not_ok(motions, int(row))

    def found(self, reasons: Mapping[int, str]) -> list[Moment]:
        """The stretches of pairs that are not OK, longest first, then extremes of other pairs.

        Parameters
        ----------
        reasons : mapping of int to str
            Reason why a pair is not OK, by the index of the newer frame.
        """
        self._close()
        moments = [self._described(stretch, reasons) for stretch in self._stretches]
        seen = {moment.frame1 for moment in moments}
        return moments + [m for _, m in self._extremes.values() if m.frame1 not in seen]

    def _extreme(
        self, motions: Motions, values: np.ndarray, title: str, what: str, unit: str
    ) -> None:
        if not np.isfinite(values).any():
            return
        row = int(np.nanargmax(values))
        value = float(values[row])
        if title not in self._extremes or value > self._extremes[title][0]:
            time_s, frame0, frame1 = self._place(motions, row)
            self._extremes[title] = (
                value,
                Moment(
                    time_s=time_s,
                    frame0=frame0,
                    frame1=frame1,
                    title=title,
                    reason=f"{value:.3g} {unit} {what}.",
                ),
            )

    def _not_ok(self, motions: Motions, row: int) -> None:
        status, place = motions.status[row], self._place(motions, row)
        stretch = self._open
        # The pairs of a stretch have the same status and are consecutive.
        if stretch is None or stretch.status is not status or stretch.last_frame < place[2] - 1:
            self._close()
            stretch = self._open = _Stretch(status=status, first=place, last_frame=place[2])
        stretch.pairs += 1
        stretch.last_frame = place[2]

    def _close(self) -> None:
        if self._open is not None:
            self._stretches.append(self._open)
            self._stretches.sort(key=lambda stretch: -stretch.pairs)
            del self._stretches[_MAX_STRETCHES:]
        self._open = None

    def _place(self, motions: Motions, row: int) -> tuple[float, int, int]:
        time_s = float(motions.timestamp1[row]) - self._start_s
        return time_s, int(motions.frame0[row]), int(motions.frame1[row])

    def _described(self, stretch: _Stretch, reasons: Mapping[int, str]) -> Moment:
        time_s, frame0, frame1 = stretch.first
        pairs = "one pair" if stretch.pairs == 1 else f"{stretch.pairs} pairs in a row"
        return Moment(
            time_s=time_s,
            frame0=frame0,
            frame1=frame1,
            title=f"{stretch.status.value}: {pairs}",
            reason=reasons.get(frame1, ""),
        )
