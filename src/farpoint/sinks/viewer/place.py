"""Output of a recording, checked before another process draws into it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from farpoint.errors import require
from farpoint.sinks.files import check_writable
from farpoint.sinks.viewer.options import ViewerOptions
from farpoint.sinks.viewer.window import open_window

__all__ = ["Place", "claim"]


@dataclass(frozen=True, kw_only=True)
class Place:
    """A file that can be written, a window that is open, or both.

    Attributes
    ----------
    rrd : Path or None
        The file.
    url : str or None
        Address of the window.
    """

    rrd: Path | None
    url: str | None

    @property
    def name(self) -> str:
        """Name in messages."""
        return "the display" if self.rrd is None else str(self.rrd)


def claim(options: ViewerOptions) -> Place:
    """Check the output file and open the window, as the options request.

    Raises
    ------
    InputError
        If the file cannot be written or the window cannot be opened.
    MissingExtraError
        If rerun-sdk is not installed.
    """
    require("rerun", extra="rerun", purpose="the display")
    if options.rrd is not None:
        check_writable(options.rrd)  # Rerun would report the error in its own thread
    return Place(
        rrd=None if options.rrd is None else options.rrd.absolute(),
        url=open_window() if options.show else None,
    )
