"""Options of the display in the viewer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

__all__ = ["ViewerOptions"]


@dataclass(frozen=True, kw_only=True)
class ViewerOptions:
    """Options of the display, which needs the extra ``rerun``.

    Attributes
    ----------
    show : bool
        Open the Rerun viewer and draw in its window during the run.
    rrd : Path or None
        Record the display into this file, which ``rerun FILE`` opens.
    """

    show: bool = False
    rrd: Path | None = None

    @property
    def wanted(self) -> bool:
        """Whether a display is requested."""
        return self.show or self.rrd is not None
