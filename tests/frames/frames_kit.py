"""Pictures that can be told apart, and the files they are written to."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

WIDTH, HEIGHT = 158, 120  # a width that is padded in memory: lines are not contiguous


def picture(number: int) -> np.ndarray:
    """A smooth texture, different for every number, without symmetry under turns and mirrors."""
    rng = np.random.default_rng(number)
    grey = cv2.GaussianBlur(rng.normal(size=(HEIGHT, WIDTH)).astype(np.float32), (0, 0), 4)
    return cv2.normalize(grey, None, 20, 230, cv2.NORM_MINMAX).astype(np.uint8)  # type: ignore


def video_frame(luma: np.ndarray, pixel_format: str) -> Any:
    """An ``av.VideoFrame`` whose luma plane holds exactly `luma`; its colours hold weak noise."""
    height, width = luma.shape
    frame = av.VideoFrame(width, height, pixel_format)
    rng, scale = np.random.default_rng(0), 1 << (frame.format.components[0].bits - 8)
    for number, plane in enumerate(frame.planes):
        shape = (plane.height, plane.line_size // luma.itemsize)
        buffer = rng.integers(112 * scale, 144 * scale, shape).astype(luma.dtype)
        if number == 0:
            buffer[:, :width] = luma
        plane.update(buffer.tobytes())
    return frame


@pytest.fixture
def write_video(tmp_path: Path) -> Callable[..., Path]:
    """A video of ``picture(0), picture(1), ...``."""

    def write(
        name: str,
        *,
        count: int = 30,
        codec: str = "libx264",
        pixel_format: str = "yuv420p",
        milliseconds: list[int] | None = None,
        options: dict[str, str] | None = None,
        luma: Callable[[int], np.ndarray] = picture,
        prepare: Callable[[Any], None] = lambda _stream: None,
    ) -> Path:
        path = tmp_path / name
        times = range(count) if milliseconds is None else milliseconds
        tick = Fraction(1, 25 if milliseconds is None else 1000)
        height, width = luma(0).shape
        with av.open(str(path), "w", options=options or {}) as container:
            stream = container.add_stream(codec, rate=25)
            stream.width, stream.height, stream.pix_fmt = width, height, pixel_format
            stream.codec_context.time_base = tick
            stream.options = {"libx264": {"g": "10"}, "ffv1": {"g": "1"}}.get(codec, {})
            prepare(stream)
            for number, time in enumerate(times):
                frame = video_frame(luma(number), pixel_format)
                frame.pts, frame.time_base = time, tick
                container.mux(stream.encode(frame))
            container.mux(stream.encode())
        return path

    return write


@pytest.fixture
def write_images(tmp_path: Path) -> Callable[..., Path]:
    """A folder of images of the given names holding ``picture(0), picture(1), ...``."""

    def write(folder: str, names: list[str]) -> Path:
        place = tmp_path / folder
        place.mkdir(parents=True, exist_ok=True)
        for number, name in enumerate(names):
            (place / name).write_bytes(encode(picture(number), Path(name).suffix))
        return place

    return write


def encode(image: np.ndarray, suffix: str) -> bytes:
    return cv2.imencode(suffix, image)[1].tobytes()


@contextmanager
def without_rights(path: Path) -> Iterator[None]:
    """Nobody may read `path`; root, who may read everything, becomes nobody for a while."""
    mode, user = path.stat().st_mode, os.geteuid()
    path.chmod(0)
    try:
        if user == 0:
            # Let nobody reach the folder that pytest made for root alone.
            for parent in path.parents:
                if parent.stat().st_uid == 0 and not parent.stat().st_mode & 0o005:
                    parent.chmod(parent.stat().st_mode | 0o055)
            os.seteuid(65534)
        yield
    finally:
        os.seteuid(user)
        path.chmod(mode)
