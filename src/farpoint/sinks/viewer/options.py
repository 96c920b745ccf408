"""Whether the run is displayed, and where."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["ViewerOptions"]


@dataclass(frozen=True, kw_only=True)
class ViewerOptions:
    """Where the display goes; it needs the extra ``rerun``.

    Attributes
    ----------
    show : bool
        Open the Rerun viewer and draw in it as the run goes.
    rrd : Path or None
        Record the display into this file, to be looked at later with rerun FILE.
    """

    show: bool = False
    rrd: Path | None = None

    @property
    def wanted(self) -> bool:
        """Whether there is a display at all."""
        return self.show or self.rrd is not None
