"""A short drive as files, and the command line called in process."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from farpoint.camera import Camera
from farpoint.cli import main
from farpoint.cli.lens import LensOptions
from farpoint.cli.run import Run
from farpoint.sinks import OutputOptions

WIDTH, HEIGHT, FOCAL = 240, 144, 180.0
CAMERA = Camera.pinhole(WIDTH, HEIGHT, FOCAL, FOCAL, 119.5, 71.5)

CALIBRATION = f"""\
sensor_type: camera
resolution: [{WIDTH}, {HEIGHT}]
camera_model: pinhole
intrinsics: [{FOCAL}, {FOCAL}, 119.5, 71.5]
distortion_model: radial-tangential
distortion_coefficients: [0.0, 0.0, 0.0, 0.0]
"""

_EXIF_IFD, _FOCAL_LENGTH_35MM = 0x8769, 0xA405

NOT_AN_IMAGE = b"this is not an image"

Images = Sequence[np.ndarray | bytes]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a command ended, and what it said."""

    code: int
    out: str
    err: str


class CommandLine:
    """``farpoint ...`` in this process."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch, self._capsys = monkeypatch, capsys

    def __call__(self, *arguments: str | Path) -> Outcome:
        self._monkeypatch.setattr(sys, "argv", ["farpoint", *map(str, arguments)])
        self._capsys.readouterr()
        try:
            code = main()
        except SystemExit as end:
            code = int(end.code or 0)
        said = self._capsys.readouterr()
        return Outcome(code=code, out=said.out, err=said.err)


def assert_refused(outcome: Outcome, *words: str | Path) -> None:
    """Exit code 2, one line on stderr that says every word, and nothing on stdout."""
    assert outcome.code == 2
    assert outcome.out == ""
    assert outcome.err.startswith("farpoint: ")
    assert outcome.err.count("\n") == 1
    assert outcome.err.endswith("\n")
    for word in words:
        assert str(word) in outcome.err


def encoded(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def there_and_back(images: Sequence[np.ndarray]) -> list[np.ndarray]:
    """A drive that can be repeated without a jump."""
    return [*images, *images[-2:0:-1]]


def write_folder(folder: Path, images: Images) -> Path:
    """Numbered PNG files; bytes are written as they are."""
    folder.mkdir(parents=True)
    for number, image in enumerate(images):
        data = image if isinstance(image, bytes) else encoded(image)
        (folder / f"{number:06d}.png").write_bytes(data)
    return folder


def write_phone_pictures(folder: Path, images: Sequence[np.ndarray], focal_mm: int) -> Path:
    """JPEG files whose EXIF tells the focal length, in 35 mm equivalents."""
    folder.mkdir(parents=True)
    for number, image in enumerate(images):
        exif = Image.Exif()
        exif.get_ifd(_EXIF_IFD)[_FOCAL_LENGTH_35MM] = focal_mm
        picture = Image.fromarray(image)
        picture.save(folder / f"{number}.jpg", exif=exif.tobytes(), quality=95)
    return folder


def write_video(path: Path, images: Sequence[np.ndarray], fps: int = 10) -> Path:
    """A film in which every picture can be decoded by itself."""
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("mpeg4", rate=fps)
        stream.width, stream.height = images[0].shape[::-1]
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, fps)
        stream.codec_context.gop_size = 1
        stream.codec_context.bit_rate = 20_000_000
        for number, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
            frame.pts, frame.time_base = number, Fraction(1, fps)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def rows_of(folder: Path) -> list[dict[str, str]]:
    """The rows of ``motions.csv``."""
    with (folder / "motions.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def statuses_of(folder: Path) -> list[str]:
    return [row["status"] for row in rows_of(folder)]


def record_of(folder: Path) -> dict[str, Any]:
    """``run.json``."""
    return json.loads((folder / "run.json").read_text())


def quick_run(place: Path, images: Images) -> Path:
    """The outputs of a run without pictures, for fixtures of a module: nothing is captured."""
    calibration = place / "sensor.yaml"
    calibration.write_text(CALIBRATION)
    Run(
        source=str(write_folder(place / "shots", images)),
        lens=LensOptions(camera=calibration),
        out=place / "out",
        output=OutputOptions(overlay=False, report=False),
    )()
    return place / "out"


RunOver = Callable[[Images], tuple[Outcome, Path]]
"""Runs over images in a folder; how it ended, and the folder of its outputs."""


FARPOINT = (sys.executable, "-m", "farpoint")
PATIENCE_S = 120.0
BUFFERED = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
"""What is printed may be written only when the process ends: the usual case."""


def start(*arguments: str | Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*FARPOINT, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=BUFFERED,
        process_group=0,
        preexec_fn=_hear_signals,
    )


def _hear_signals() -> None:
    """Tests in the background (``&``, ``nohup``) ignore signals, and would pass that on."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def wait_for_rows(path: Path, count: int, process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not path.exists() or len(path.read_text().splitlines()) <= count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)
