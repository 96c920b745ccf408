"""A live session, which processes the newest frame of a source and counts all frames."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

from farpoint.aiding import AidingMeasurement
from farpoint.camera import Camera, CameraGuess, camera_for
from farpoint.errors import InputError
from farpoint.frames.live import Capture, LiveAccount, LiveFrame, LiveSource
from farpoint.frames.mask import read_mask
from farpoint.live.rehearsal import rehearse
from farpoint.odometry import FinalPose, Odometry, OdometryOptions, OdometryResult
from farpoint.pose import PoseStatus
from farpoint.sinks import (
    FolderLock,
    LiveViewer,
    MetricSink,
    OutputFolder,
    OutputOptions,
    RunDescription,
    ViewerOptions,
    start_live_viewer,
    start_video_process,
    wait_until_loaded,
)

__all__ = ["LiveSession", "LiveState"]

_FIRST_S = 10.0  # how long an open source may take to deliver its first picture
_TICK_S = 0.25  # how long to wait for a frame before looking at the clock again
_SILENT_S = 1.0  # time without a frame after which a source is reported as silent


def _discard(words: str) -> None:
    del words


@dataclass(frozen=True, kw_only=True)
class LiveState:
    """State of a session.

    Attributes
    ----------
    account : LiveAccount
        Numbers of frames that arrived, of frames that were used, and of frames that were dropped.
    link : str
        State of the source: ``receiving``, ``silent`` or ``lost``.
    latency_s, longest_latency_s : float
        Time from the arrival of a frame until the result is in the outputs, s: for the newest
        frame, and the longest time so far.
    not_drawn : int
        Number of results that the display left out, because drawing was too slow.
    """

    account: LiveAccount
    link: str
    latency_s: float
    longest_latency_s: float
    not_drawn: int


class LiveSession:
    """Odometry of a live source, with outputs to a folder and a display.

    A session is a context manager. Leaving its block, also by Ctrl-C, closes every file.

    Parameters
    ----------
    live : LiveSource
        Source that the session opens. If the connection is lost, the session opens the source
        again.
    source : str
        Source as given by the user.
    camera : Camera or CameraGuess
        Camera of the frames. A guess becomes a camera with the size of the first picture.
    out : Path or None
        Folder for the outputs; ``farpoint-out/<source name>`` if None.
    odometry, output, viewer : dataclasses, optional
        Options of the odometry, of the outputs and of the display. By default there is no display.
    measurements : sequence of AidingMeasurement
        Aiding measurements of length. If any of them is given, the files are converted to metres at
        the end.
    mask_file : Path, optional
        8-bit image of the size of the frames. Black pixels are not tracked.
    warn : callable, optional
        Called with each warning about the results, such as a guessed camera or contradicting aiding
        measurements. ``run.json`` has the warnings, too.

    Raises
    ------
    InputError
        If the source cannot be opened or delivers no picture, if its frames do not have the size of
        the camera (field ``camera``) or of the mask, if outputs cannot be written, or if another
        run is writing into the folder. Earlier outputs in the folder are replaced only after the
        first picture.

    Attributes
    ----------
    path : Path
        Folder of the outputs.
    counts : Counter of PoseStatus
        Number of frame pairs with each status.
    """

    def __init__(
        self,
        live: LiveSource,
        source: str,
        camera: Camera | CameraGuess,
        out: Path | None = None,
        *,
        odometry: OdometryOptions | None = None,
        output: OutputOptions | None = None,
        viewer: ViewerOptions | None = None,
        measurements: Sequence[AidingMeasurement] = (),
        mask_file: Path | None = None,
        warn: Callable[[str], object] = _discard,
    ) -> None:
        self.counts: Counter[PoseStatus] = Counter()
        output, viewer = output or OutputOptions(), viewer or ViewerOptions()
        self._latency_s = self._longest_latency_s = 0.0
        self._indices: dict[int, int] = {}  # index in the source, by index in the odometry
        self._compared_with = 0  # odometry index of frame 0 of the last pair
        with ExitStack() as opened:
            # The two processes load while this process warms up.
            display = opened.enter_context(start_live_viewer()) if viewer.wanted else None
            video = opened.enter_context(start_video_process()) if output.overlay else None
            rehearse(camera)
            for process in (display, video):
                if process is not None:
                    wait_until_loaded(process)
            self._capture = opened.enter_context(Capture(live))
            size = self._first_size()
            camera, notes = camera_for(camera, *size, self._capture.pixel_aspect)
            notes = (*notes, *self._capture.notes)
            for note in notes:
                warn(note)
            mask = None if mask_file is None else read_mask(mask_file, size)
            self._odometry = Odometry(camera, odometry, mask=mask)
            self.path = out or Path("farpoint-out") / self._capture.name
            lock = opened.enter_context(FolderLock(self.path))
            self._display: LiveViewer | None = None
            if viewer.wanted:
                self._display = LiveViewer(
                    viewer, self._capture.name, camera, output.palette, display
                )
                opened.callback(self._display.close)
            description = RunDescription(
                source=source,
                source_name=self._capture.name,
                camera=camera,
                options={
                    "odometry": self._odometry.options,
                    "output": output,
                    "mask": mask_file,
                },
                timestamp_source=self._capture.timestamp_source,
                notes=notes,
                mask=mask,
            )
            folder = OutputFolder(self.path, description, output, video, lock)
            self._folder = opened.enter_context(folder)
            for note in self._folder.notes:
                warn(note)
            if self._display is not None:
                self._folder.add("viewer", self._display)
            if measurements:
                metric = MetricSink(list(measurements), camera, warn, self._folder.put)
                self._folder.add("metric", metric)
                self._folder.at_end(metric.finish)
            self._opened = opened.pop_all()

    @property
    def state(self) -> LiveState:
        """State of the session."""
        return LiveState(
            account=self._capture.account,
            link=self._link(),
            latency_s=self._latency_s,
            longest_latency_s=self._longest_latency_s,
            not_drawn=0 if self._display is None else self._display.left_out,
        )

    def run(
        self,
        duration_s: float = math.inf,
        notice: Callable[[LiveState], None] | None = None,
    ) -> None:
        """Process frames until the source ends or ``duration_s`` is over.

        Parameters
        ----------
        duration_s : float
            Duration from now, s.
        notice : callable, optional
            Called with the state after each frame, and four times per second without frames.
        """
        end_s = time.monotonic() + duration_s
        while (left_s := end_s - time.monotonic()) > 0.0 and not self._capture.ended:
            frame = self._capture.take(min(_TICK_S, left_s))
            if frame is not None:
                self._process(frame)
            state = self.state
            self._record(state)
            if self._display is not None:
                self._display.set_link(state.link)
            if notice is not None:
                notice(state)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # The source is closed first: a waiting frame counts as dropped in ``run.json``.
        self._capture.close()
        self._record(self.state)
        self._write_final_poses(self._odometry.remaining())
        self._folder.write_lens_and_notes(self._odometry)
        self._opened.__exit__(kind, error, trace)

    def _first_size(self) -> tuple[int, int]:
        """Width and height of the first picture, which is not consumed."""
        first = self._capture.peek(_FIRST_S)
        if first is None:
            raise InputError("delivers no picture", file=self._capture.name)
        assert first.image is not None
        height, width = first.image.shape
        return width, height

    def _process(self, taken: LiveFrame) -> None:
        frame = taken.frame
        result = self._numbered(
            self._odometry.process(frame.image, frame.timestamp, fault=frame.fault), frame.index
        )
        self._folder.write(result, frame.image)
        self._write_final_poses(self._odometry.final_poses())
        self._latency_s = time.monotonic() - taken.arrived_s
        self._longest_latency_s = max(self._longest_latency_s, self._latency_s)
        self._folder.check_halves(result, self._odometry)
        if result.pose is not None:
            self.counts[result.pose.status] += 1
        if self._display is not None:
            self._display.set_status(self._latency_s, taken.dropped)

    def _numbered(self, found: OdometryResult, index: int) -> OdometryResult:
        """The result with the frame numbers of the source, where dropped frames leave gaps."""
        self._indices[found.frame1], self._compared_with = index, found.frame0
        return replace(found, frame0=self._indices[found.frame0], frame1=index)

    def _write_final_poses(self, poses: list[FinalPose]) -> None:
        """Write poses with the frame numbers of the source, and forget numbers no longer needed."""
        self._folder.write_final_poses(
            replace(pose, frame1=self._indices[pose.frame1]) for pose in poses
        )
        if poses:
            done = min(poses[-1].frame1, self._compared_with)
            self._indices = {k: v for k, v in self._indices.items() if k >= done}

    def _record(self, state: LiveState) -> None:
        """Write the counts of frames into ``run.json``."""
        facts = {
            **asdict(state.account),
            "not_drawn": state.not_drawn,
            "longest_latency_s": round(state.longest_latency_s, 4),
        }
        self._folder.put("live", facts)

    def _link(self) -> str:
        if not self._capture.connected:
            return "lost"
        return "silent" if self._capture.silence_s > _SILENT_S else "receiving"
