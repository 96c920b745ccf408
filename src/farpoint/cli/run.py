"""``farpoint run``: a source of images in, a folder of results out."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from farpoint.camera import Camera, load_camera
from farpoint.cli.progress import Progress
from farpoint.frames import Frame, FrameSource, open_frames
from farpoint.odometry import Odometry, OdometryOptions
from farpoint.pose import PoseStatus
from farpoint.sinks import OutputFolder, OutputOptions, RunDescription

__all__ = ["Run", "process_frames"]

UNIT_STEPS = (
    "The scale of the translation is not estimated: every pair with a direction moves by one unit, "
    "so positions show the shape of the path only where the speed was constant."
)


@dataclass(frozen=True, kw_only=True)
class Run:
    """Turn a video or images into motions with covariances, a trajectory, an overlay and a report.

    Attributes
    ----------
    source : str
        Video file, image folder or pattern, KITTI / EuRoC / TUM folder, camera index, stream URL.
    camera : Path
        Calibration file.
    name : str or None
        Camera to take from a calibration file of several.
    out : Path or None
        Folder for the outputs; farpoint-out/<source name> by default.
    fps : float or None
        Frames a second of images without time stamps; 10 by default.
    odometry : OdometryOptions
        Options of tracking and estimation.
    output : OutputOptions
        Which outputs are made.
    """

    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    camera: Path
    name: str | None = None
    out: Path | None = None
    fps: float | None = None
    odometry: Annotated[OdometryOptions, tyro.conf.arg(name="")] = field(
        default_factory=OdometryOptions
    )
    output: Annotated[OutputOptions, tyro.conf.arg(name="")] = field(default_factory=OutputOptions)

    def __call__(self) -> None:
        """Do it."""
        camera = load_camera(self.camera, self.name)
        frames = open_frames(self.source, fps=self.fps)
        out = self.out or Path("farpoint-out") / frames.name
        process_frames(frames, self.source, camera, out, self.odometry, self.output)


def process_frames(
    frames: FrameSource,
    source: str,
    camera: Camera,
    out: Path,
    options: OdometryOptions,
    output: OutputOptions,
) -> None:
    """Run odometry over ``frames`` into the folder ``out``; prints what was found."""
    description = RunDescription(
        source=source,
        source_name=frames.name,
        camera=camera,
        options={"odometry": options, "output": output},
        frame_count=frames.count,
        timestamp_source=frames.timestamp_source,
        notes=(UNIT_STEPS,),
    )
    odometry = Odometry(camera, options)
    counts: Counter[PoseStatus] = Counter()
    progress = Progress("frames", frames.count)
    with OutputFolder(out, description, output) as folder:
        try:
            for frame, seconds in _timed(frames):
                folder.add_time("read", seconds)
                result = odometry.process(frame.image, frame.timestamp, fault=frame.fault)
                folder.write(result, frame.image)
                if result.pose is not None:
                    counts[result.pose.status] += 1
                progress.step()
        finally:
            for stage, seconds in odometry.seconds.items():
                folder.add_time(stage, seconds)
            progress.close()
    print(f"{sum(counts.values())} pairs of frames: {_in_words(counts)}")
    print(f"results in {out}")


def _timed(frames: FrameSource) -> Iterator[tuple[Frame, float]]:
    """Each frame with the seconds that reading it took."""
    iterator = iter(frames)
    while True:
        start = time.perf_counter()
        frame = next(iterator, None)
        if frame is None:
            return
        yield frame, time.perf_counter() - start


def _in_words(counts: Counter[PoseStatus]) -> str:
    return ", ".join(f"{counts[status]} {status.value}" for status in PoseStatus)
