"""Text panes: the status as a coloured lane, and the values of the newest pair."""

from __future__ import annotations

from typing import Any

from farpoint.errors import optional_import
from farpoint.odometry import OdometryResult
from farpoint.pose import PoseStatus
from farpoint.pose.html_repr import pose_rows
from farpoint.sinks.overlay.palette import Palette
from farpoint.sinks.viewer import places

__all__ = ["Strip"]


class Strip:
    """Panes of the status, drawn at each change, and of the values of every pair.

    Parameters
    ----------
    recording : rerun.RecordingStream
        Recording that receives the drawings.
    palette : Palette
        Colours.
    """

    def __init__(self, recording: Any, palette: Palette) -> None:
        self._rr = optional_import("rerun", extra="rerun", purpose="the display")
        self._recording = recording
        self._status: PoseStatus | None = None
        lanes = self._rr.StateConfiguration(
            values=[status.value for status in PoseStatus],
            labels=[status.value for status in PoseStatus],
            colors=[palette.good, palette.partial, palette.still, palette.bad],
        )
        recording.log(places.STATUS, lanes, static=True)

    def draw(self, result: OdometryResult) -> None:
        """Add one pair."""
        pose = result.pose
        if pose is None:
            return
        if pose.status is not self._status:
            self._recording.log(places.STATUS, self._rr.StateChange(state=pose.status.value))
            self._status = pose.status
        lines = [f"**{pose.status.value}**, frames {result.frame0} to {result.frame1}"]
        lines += [f"{name}: {value}" for name, value in pose_rows(pose)]
        # Two blanks at its end break a line of Markdown without a gap.
        text = self._rr.TextDocument("  \n".join(lines), media_type="text/markdown")
        self._recording.log(places.VALUES, text)
