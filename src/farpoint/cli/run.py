"""``farpoint run``: motion from a source of images, with the results in a folder."""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.aiding import AidingMeasurement
from farpoint.camera import Camera, CameraGuess, camera_for
from farpoint.cli.common import RecordedOptions
from farpoint.cli.progress import Progress
from farpoint.errors import InputError, printable
from farpoint.frames import Frame, FrameSource, open_frames
from farpoint.frames.bags import BagImages
from farpoint.frames.mask import read_mask
from farpoint.odometry import Odometry, OdometryOptions
from farpoint.pose import PoseStatus
from farpoint.sinks import (
    BagSink,
    FolderLock,
    MetricSink,
    OutputFolder,
    OutputOptions,
    RunDescription,
    ViewerOptions,
    open_viewer,
)

__all__ = ["Run", "in_words", "process_frames", "warn"]


@dataclass(frozen=True, kw_only=True)
class Run(RecordedOptions):
    """Turn a video or images into motions with covariances, a trajectory, an overlay and a report.

    Attributes
    ----------
    source : str
        Video file, image folder or pattern, KITTI / EuRoC / TUM folder, bag, camera index, or URL.
    out : Path or None
        Folder for the outputs; farpoint-out/<source name> by default.
    bag : Path or None
        MCAP file to write the motions into, as messages of ROS 2.
    viewer : ViewerOptions
        Options of the display.
    """

    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    out: Path | None = None
    bag: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    viewer: Annotated[ViewerOptions, tyro.conf.arg(name="")] = field(default_factory=ViewerOptions)

    def __call__(self) -> None:
        """Run the command."""
        # Errors of the calibration are raised before errors of the source.
        known = self.lens.known()
        frames = open_frames(
            self.source,
            fps=self.fps,
            max_megapixels=self.max_megapixels,
            follow_playlists=self.follow_playlists,
            topic=self.topic,
        )
        camera = known or self.lens.from_source(frames, self.source)
        out = self.out or Path("farpoint-out") / frames.name
        with self.lens.naming_file():
            process_frames(
                frames,
                self.source,
                camera,
                out,
                self.odometry,
                self.output,
                self.viewer,
                self.metric.measurements(frames.bag if isinstance(frames, BagImages) else None),
                mask_file=self.mask,
                bag_file=self.bag,
            )


def process_frames(
    frames: FrameSource,
    source: str,
    camera: Camera | CameraGuess,
    out: Path,
    options: OdometryOptions,
    output: OutputOptions,
    viewer: ViewerOptions | None = None,
    measurements: Sequence[AidingMeasurement] = (),
    lock: FolderLock | None = None,
    mask_file: Path | None = None,
    bag_file: Path | None = None,
) -> None:
    """Run odometry over ``frames``, write the results into ``out``, and print a summary.

    A guessed camera gets the size of the first image. A caller that writes more files into ``out``
    locks the folder and passes the lock.

    Raises
    ------
    InputError
        If images do not have the size of the camera (field ``camera``) or of the mask, if no image
        can be decoded, if ``out`` or a recording cannot be written, or if another run is writing
        into ``out``.
    """
    timed = _Timed(frames, source)
    # The first image is read before the folder is opened, so that a wrong calibration raises an
    # error before earlier results are replaced.
    first = _up_to_an_image(timed)
    image = first[-1][0].image
    assert image is not None  # otherwise `timed` raises
    height, width = image.shape
    aspect = getattr(frames, "pixel_aspect", 1.0)
    camera, notes = camera_for(camera, width, height, aspect)
    notes = (*notes, *frames.notes)
    mask = None if mask_file is None else read_mask(mask_file, image.shape[::-1])
    description = RunDescription(
        source=source,
        source_name=frames.name,
        camera=camera,
        options={"odometry": options, "output": output, "mask": mask_file},
        frame_count=frames.count,
        timestamp_source=frames.timestamp_source,
        notes=notes,
        mask=mask,
    )
    odometry = Odometry(camera, options, mask=mask)
    with ExitStack() as opened:
        # The lock comes first, because the display and the bag may write into the folder.
        lock = lock or opened.enter_context(FolderLock(out))
        # The display is opened before the folder: if it fails, no earlier result is replaced.
        display = None
        if viewer is not None and viewer.wanted:
            display = open_viewer(viewer, frames.name, camera, output.palette)
            opened.callback(display.close)
        metric: MetricSink | None = None
        bag = None
        if bag_file is not None:
            _refuse_source(bag_file, source)
            metres = (lambda: metric.now if metric else None) if measurements else None
            bag = BagSink(bag_file, lambda: odometry.lens.camera, metres, lambda: timed.time_ns)
            opened.callback(bag.close)
        folder = opened.enter_context(OutputFolder(out, description, output, lock=lock))
        for note in (*notes, *folder.notes):  # last, so that an error above is the only line
            warn(note)
        if display is not None:
            folder.add("viewer", display)
        if measurements:
            metric = MetricSink(list(measurements), camera, warn, folder.put)
            folder.add("metric", metric)
            folder.at_end(metric.finish)
        if bag is not None:
            folder.add("bag", bag)
        counts = _run_into(folder, chain(first, timed), odometry, frames.count)
    print(f"{sum(counts.values())} pairs of frames: {in_words(counts)}")
    print(f"time stamps: {frames.timestamp_source}")
    print(f"results in {printable(str(out))}")


def _refuse_source(bag_file: Path, source: str) -> None:
    """Refuse outputs that would replace the source."""
    images = Path(source)
    if bag_file.exists() and images.exists() and bag_file.samefile(images):
        raise InputError("is the source itself", file=bag_file, field="--bag")
    if images.is_dir() and bag_file.resolve().parent == images.resolve():
        raise InputError("expected a place outside of the source", file=bag_file, field="--bag")


def _run_into(
    folder: OutputFolder,
    timed: Iterable[tuple[Frame, float]],
    odometry: Odometry,
    frame_count: int | None,
) -> Counter[PoseStatus]:
    """Process every frame and write the results; returns the number of pairs of each status."""
    counts: Counter[PoseStatus] = Counter()
    with Progress("frames", frame_count) as progress:
        try:
            for frame, seconds in timed:
                folder.add_time("read", seconds)
                result = odometry.process(frame.image, frame.timestamp, fault=frame.fault)
                folder.write(result, frame.image)
                folder.write_final_poses(odometry.final_poses())
                folder.check_halves(result, odometry)
                if result.pose is not None:
                    counts[result.pose.status] += 1
                progress.step()
        finally:
            folder.finish_path(odometry)
    for note in odometry.notes:
        warn(note)
    return counts


def warn(words: str) -> None:
    """Print a warning for the user, separate from the results."""
    print(f"farpoint: {printable(words)}", file=sys.stderr)


def _up_to_an_image(timed: Iterator[tuple[Frame, float]]) -> list[tuple[Frame, float]]:
    """The first frames, up to and including the first frame that could be decoded."""
    first = []
    for frame, seconds in timed:
        first.append((frame, seconds))
        if frame.image is not None:
            break
    return first


class _Timed:
    """Iterator over frames, each with the seconds that reading took.

    Raises InputError if no frame has an image.

    Attributes
    ----------
    time_ns : int or None
        Time of the last frame, if the source has times in ns.
    """

    time_ns: int | None = None

    def __init__(self, frames: FrameSource, source: str) -> None:
        self._frames, self._source = iter(frames), source
        self._any_image = False

    def __iter__(self) -> Iterator[tuple[Frame, float]]:
        return self

    def __next__(self) -> tuple[Frame, float]:
        start = time.perf_counter()
        frame = next(self._frames, None)
        if frame is None:
            if not self._any_image:
                raise InputError("holds no image that can be decoded", file=self._source)
            raise StopIteration
        self._any_image = self._any_image or frame.image is not None
        self.time_ns = frame.time_ns
        return frame, time.perf_counter() - start


def in_words(counts: Counter[PoseStatus]) -> str:
    """Number of pairs of each status, as text."""
    return ", ".join(f"{counts[status]} {status.value}" for status in PoseStatus)
