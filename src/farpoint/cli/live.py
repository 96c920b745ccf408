"""``farpoint live``: live motion of a camera or a stream."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.aiding import HeightOptions
from farpoint.cli.common import ImageOptions
from farpoint.cli.progress import Progress
from farpoint.cli.run import in_words, warn
from farpoint.errors import InputError, printable
from farpoint.frames.live import Playback, open_live
from farpoint.live import LiveSession, LiveState
from farpoint.sinks import OutputOptions, ViewerOptions

__all__ = ["Live"]


def _no_video() -> OutputOptions:
    return OutputOptions(overlay=False)


def _viewer_shown() -> ViewerOptions:
    return ViewerOptions(show=True)


@dataclass(frozen=True, kw_only=True)
class Live(ImageOptions):
    """Estimate the motion of a camera or a stream live, until Ctrl-C.

    Attributes
    ----------
    source : str
        Camera index or stream URL. A video or an image sequence is played at its frame rate.
    out : Path or None
        Folder for the outputs; farpoint-out/<source name> by default.
    duration_s : float or None
        Duration of the session, s.
    loop : bool
        Repeat a video or an image sequence endlessly.
    viewer : ViewerOptions
        Options of the display.
    metric : HeightOptions
        Aiding measurements of length.
    """

    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="[INDEX|URL]")] = "0"
    out: Path | None = None
    duration_s: float | None = None
    loop: bool = False
    output: Annotated[OutputOptions, tyro.conf.arg(name="")] = field(default_factory=_no_video)
    viewer: Annotated[ViewerOptions, tyro.conf.arg(name="")] = field(default_factory=_viewer_shown)
    metric: HeightOptions = field(default_factory=HeightOptions)

    def __call__(self) -> None:
        """Run the command."""
        if self.duration_s is not None and not self.duration_s > 0.0:
            raise InputError(f"expected more than 0, got {self.duration_s}", field="--duration-s")
        known = self.lens.known()
        live = open_live(
            self.source,
            loop=self.loop,
            max_megapixels=self.max_megapixels,
            follow_playlists=self.follow_playlists,
        )
        recording = live.frames if isinstance(live, Playback) else None
        with self.lens.naming_file():
            session = LiveSession(
                live,
                self.source,
                known or self.lens.from_source(recording, self.source),
                self.out,
                odometry=self.odometry,
                output=self.output,
                viewer=self.viewer,
                measurements=self.metric.measurements(),
                mask_file=self.mask,
                warn=warn,
            )
        try:
            with session, Progress("frames", None) as progress:
                session.run(
                    math.inf if self.duration_s is None else self.duration_s,
                    lambda state: progress.reach(state.account.taken, _so_far(state)),
                )
        finally:  # Ctrl-C is how most sessions end
            print(f"{session.counts.total()} pairs of frames: {in_words(session.counts)}")
            print(_account(session.state))
            print(f"results in {printable(str(session.path))}")


def _so_far(state: LiveState) -> str:
    return (
        f"latency {1e3 * state.latency_s:.0f} ms, {state.account.dropped} dropped, "
        f"source {state.link}"
    )


def _account(state: LiveState) -> str:
    account = state.account
    broken = f", {account.broken} could not be decoded" if account.broken else ""
    lines = [
        f"{account.captured} frames came, {account.taken} were used, "
        f"{account.dropped} dropped for newer ones{broken}",
        f"source lost {account.disconnects} times, back {account.reconnects} times; "
        f"longest silence {account.longest_silence_s:.1f} s, "
        f"longest latency {1e3 * state.longest_latency_s:.0f} ms",
    ]
    return "\n".join(lines)
