"""``--mask FILE``: what is black is not used, and a file that is no mask is refused in one line."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from cli_kit import (
    HEIGHT,
    NOT_AN_IMAGE,
    WIDTH,
    CommandLine,
    assert_refused,
    encoded,
    record_of,
    write_folder,
)

from farpoint.sinks.overlay.layout import Layout

Pictures = tuple[np.ndarray, ...]

MASK = np.full((HEIGHT, WIDTH), 255, np.uint8)
MASK[96:] = 0


def test_the_black_part_is_recorded_and_hatched_in_the_overlay(
    farpoint: CommandLine, tmp_path: Path, calibration: Path, images: Pictures
) -> None:
    source, mask = write_folder(tmp_path / "shots", images[:3]), tmp_path / "mask.png"
    # Of colours with transparency: neither changes what is white.
    mask.write_bytes(encoded(cv2.cvtColor(MASK, cv2.COLOR_GRAY2BGRA)))
    arguments = ("run", source, "--camera", calibration, "--no-report")
    assert farpoint(*arguments, "--out", tmp_path / "plain").code == 0
    assert farpoint(*arguments, "--out", tmp_path / "masked", "--mask", mask).code == 0
    assert record_of(tmp_path / "plain")["options"]["mask"] is None
    assert record_of(tmp_path / "masked")["options"]["mask"] == str(mask)
    pane = Layout.of_image(WIDTH, HEIGHT).pane_slices(0)
    plain, masked = (first_picture(tmp_path / name)[pane] for name in ("plain", "masked"))
    used = slice(30, 90 * len(plain) // HEIGHT)
    unused = slice(100 * len(plain) // HEIGHT, None)
    assert np.abs(plain[used] - masked[used]).mean() < 4.0
    assert masked[unused].mean() < 0.7 * plain[unused].mean()


def first_picture(out: Path) -> np.ndarray:
    with av.open(str(out / "overlay.mp4")) as film:
        return next(film.decode(video=0)).to_ndarray(format="gray").astype(float)


def write(data: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(data)


def huge_png() -> bytes:
    """Of a gigapixel by its header; there is next to nothing behind it."""
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 32000, 32000, 8, 0, 0, 0, 0))]
    chunks += [(b"IDAT", zlib.compress(bytes(9))), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path.unlink(missing_ok=True), ["no such file", "mask"]),
        (lambda path: path.mkdir(), ["is a folder", "mask"]),
        (os.mkfifo, ["no regular file", "mask"]),
        (lambda path: path.symlink_to("/dev/zero"), ["no regular file", "mask"]),
        (write(b""), ["mask", "8-bit image"]),
        (write(NOT_AN_IMAGE), ["mask", "8-bit image"]),
        (write(encoded(MASK)[:200]), ["mask", "8-bit image"]),
        (write(encoded(MASK[:-1])), [f"{WIDTH}x{HEIGHT}", f"got {WIDTH}x{HEIGHT - 1}"]),
        (write(huge_png()), [f"{WIDTH}x{HEIGHT}", "got 1024 megapixels"]),
        (write(encoded(MASK.T)), [f"{WIDTH}x{HEIGHT}", f"got {HEIGHT}x{WIDTH}"]),
        (write(encoded(MASK.astype(np.uint16) * 257)), ["8-bit image, got uint16"]),
        (write(encoded(MASK // 255)), ["white", "brightest is 1"]),
        (write(encoded(0 * MASK)), ["white", "brightest is 0"]),
    ],
)
def test_what_is_no_mask_of_the_frames(
    farpoint: CommandLine,
    tmp_path: Path,
    calibration: Path,
    images: Pictures,
    make: Callable[[Path], object],
    words: list[str],
) -> None:
    source, mask = write_folder(tmp_path / "shots", images[:2]), tmp_path / "mask.png"
    make(mask)
    out = tmp_path / "out"
    outcome = farpoint("run", source, "--camera", calibration, "--out", out, "--mask", mask)
    assert_refused(outcome, mask, *words)
    assert not out.exists()


def test_a_guessed_camera_adds_no_line_to_a_refusal(
    farpoint: CommandLine, tmp_path: Path, images: Pictures
) -> None:
    source, mask = write_folder(tmp_path / "shots", images[:2]), tmp_path / "mask.png"
    mask.write_bytes(NOT_AN_IMAGE)
    refused = farpoint("run", source, "--fov", "60", "--out", tmp_path / "out", "--mask", mask)
    assert refused.code == 2
    assert len(refused.err.splitlines()) == 1
