"""Coverage of the covariances of `Odometry` on compressed video of rendered streets."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from farpoint.bench.consistency import CONSISTENCY_COLUMNS, consistency_cells, pose_errors
from farpoint.bench.options import BenchOptions, Progress
from farpoint.bench.table import Cell, Column, Table
from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.odometry import Odometry
from farpoint.pose import PoseStatus, RelativePose
from farpoint.synthetic import RenderedSequence, render_drive

__all__ = ["codecs_table"]

_PAIRS = 60
_PAIRS_PER_STREET = 20
_FPS = (30, 10)
# With a known shutter, so that the covariances contain nothing of an unknown one.
_CAMERAS = tuple(
    Camera.pinhole(
        width, height, 0.7 * width, 0.7 * width, (width - 1) / 2, (height - 1) / 2
    ).with_readout(0.0)
    for width, height in ((480, 270), (640, 480))
)


def codecs_table(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """The table with a row for each size, frame rate and codec, yielded after each row."""
    rows: list[tuple[Cell, ...]] = []
    pairs = options.pairs or _PAIRS
    streets = -(-pairs // _PAIRS_PER_STREET)
    frames = -(-pairs // streets) + 1
    total = len(_CAMERAS) * len(_FPS) * len(_CODECS)
    for camera in _CAMERAS:
        for fps in _FPS:
            seeds = range(options.seed, options.seed + streets)
            drives = [render_drive(camera, frames=frames, fps=fps, seed=seed) for seed in seeds]
            images = [
                [frame.image for frame in drive if frame.image is not None] for drive in drives
            ]
            for name, through in _CODECS.items():
                progress(f"{name}, {fps} frames a second", len(rows), total)
                decoded = [through(each, fps) for each in images]
                assert camera.size is not None
                rows.append((name, fps, camera.size[0], *_figures(drives, decoded, fps)))
                yield _table(rows, options)
    progress("codecs", total, total)


def _table(rows: Sequence[tuple[Cell, ...]], options: BenchOptions) -> Table:
    return Table(
        name="codecs",
        title="Coverage of odometry on compressed video of rendered streets",
        command=options.command("codecs"),
        columns=(
            Column("codec"),
            Column("fps"),
            Column("width"),
            Column("pairs"),
            Column("OK"),
            Column("correlation", 3),
            Column("half_ratio", 2),
            *CONSISTENCY_COLUMNS,
        ),
        rows=tuple(rows),
        notes=(
            f"{_PAIRS_PER_STREET} pairs in each street; crf: constant rate factor of x264 and x265 "
            "(their defaults are 23 and 28); q: quality of JPEG",
            "correlation: mean correlation of neighbouring residuals; half_ratio: mean split-half "
            "ratio; the other columns are those of the table of coverage",
        ),
    )


def _figures(
    drives: Sequence[RenderedSequence], videos: Sequence[list[np.ndarray]], fps: float
) -> tuple[Cell, ...]:
    poses: list[RelativePose] = []
    truths = []
    for drive, images in zip(drives, videos, strict=True):
        odometry = Odometry(drive.camera)
        for k, image in enumerate(images):
            result = odometry.process(image, k / fps)
            if result.pose is not None:
                poses.append(result.pose)
                truths.append(drive.cam1_from_cam0(result.frame0, result.frame1))
    truth = np.array(truths)
    return (
        len(poses),
        sum(pose.status is PoseStatus.OK for pose in poses),
        _mean([pose.stats.residual_correlation for pose in poses]),
        _mean([pose.stats.half_ratio for pose in poses]),
        *consistency_cells(pose_errors(poses, truth[:, :3, :3], truth[:, :3, 3])),
    )


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _uncompressed(images: list[np.ndarray], fps: float) -> list[np.ndarray]:
    del fps
    return images


def _through_jpeg(quality: int, images: list[np.ndarray], fps: float) -> list[np.ndarray]:
    """Images after compression to JPEG, one by one."""
    del fps
    cv2: Any = optional_import("cv2", extra="video", purpose="encoding JPEG")
    settings = [cv2.IMWRITE_JPEG_QUALITY, quality]
    coded = [cv2.imencode(".jpg", image, settings)[1] for image in images]
    return [cv2.imdecode(code, cv2.IMREAD_GRAYSCALE) for code in coded]


def _through_video(codec: str, crf: int, images: list[np.ndarray], fps: float) -> list[np.ndarray]:
    """Images of a video after compression with a constant rate factor."""
    av: Any = optional_import("av", extra="video", purpose="encoding video")
    height, width = images[0].shape
    memory = io.BytesIO()
    with av.open(memory, "w", format="mp4") as video:
        stream = video.add_stream(codec, rate=int(fps))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.thread_count = 1  # deterministic
        stream.options = {"crf": str(crf)} | _QUIET.get(codec, {})
        for image in images:
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
            video.mux(stream.encode(frame))
        video.mux(stream.encode())
    memory.seek(0)
    with av.open(memory) as video:
        return [frame.to_ndarray(format="gray") for frame in video.decode(video=0)]


_QUIET = {"libx265": {"x265-params": "log-level=0:pools=1"}}
_CODECS: dict[str, Callable[[list[np.ndarray], float], list[np.ndarray]]] = {
    "uncompressed": _uncompressed,
    "JPEG, q 75": partial(_through_jpeg, 75),
    "JPEG, q 50": partial(_through_jpeg, 50),
    "H.264, crf 18": partial(_through_video, "libx264", 18),
    "H.264, crf 23": partial(_through_video, "libx264", 23),
    "H.264, crf 28": partial(_through_video, "libx264", 28),
    "HEVC, crf 23": partial(_through_video, "libx265", 23),
    "HEVC, crf 28": partial(_through_video, "libx265", 28),
}
