"""Samples of more than 8 bits, pages of TIFF files, and images too large to decode."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from farpoint.errors import InputError
from farpoint.frames import open_frames
from farpoint.frames.depth import GreyTable

GREY = np.random.default_rng(0).integers(0, 256, (48, 64)).astype(np.uint8)


def write(folder: Path, images: list[np.ndarray]) -> Path:
    folder.mkdir()
    for k, image in enumerate(images):
        cv2.imwrite(str(folder / f"{k}.png"), image)
    return folder


def frames_of(source: Path) -> tuple[list, tuple[str, ...]]:
    opened = open_frames(source)
    return list(opened), opened.notes


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_the_upper_8_of_the_bits_in_use(tmp_path: Path, bits: int):
    frames, notes = frames_of(write(tmp_path / "a", [GREY.astype(np.uint16) << (bits - 8)] * 3))
    for frame in frames:
        np.testing.assert_array_equal(frame.image, GREY)
    assert bool(notes) == (bits != 16)
    assert all(f"{bits} bits in 16" in note for note in notes)


def test_a_narrow_span_is_stretched_equally_in_all_images(tmp_path: Path):
    counts = 7800 + 2 * GREY.astype(np.uint16)
    frames, (note,) = frames_of(write(tmp_path / "a", [counts, counts + 60]))
    first, second = (frame.image.astype(float) for frame in frames)
    assert np.ptp(first) > 100
    np.testing.assert_allclose(second - first, 60 * 255 / (2 * 570), atol=2.0)
    assert (GreyTable.for_images([counts])(2 * counts) == 255).all()  # saturated, not wrapped
    assert "the same in all images" in note


def test_the_brightest_of_the_sequence_decides_not_the_first_image(tmp_path: Path):
    dark, bright = GREY.astype(np.uint16), GREY.astype(np.uint16) << 4
    frames, _ = frames_of(write(tmp_path / "a", [dark, *[bright] * 7]))
    np.testing.assert_array_equal(frames[-1].image, GREY)


def test_tables_never_wrap():
    for bits in (8, 10, 12, 14, 16):
        assert (np.diff(GreyTable.upper_bits(bits).values.astype(int)) >= 0).all()
    flat = GreyTable.for_images([np.full((9, 9), 30000, np.uint16)])
    assert (np.diff(flat.values.astype(int)) >= 0).all()


@pytest.mark.parametrize(("form", "shift"), [("gray10le", 2), ("gray12le", 4), ("gray16le", 4)])
def test_deep_video(tmp_path: Path, form: str, shift: int):
    path = tmp_path / "deep.mkv"
    with av.open(str(path), "w") as out:
        stream = out.add_stream("ffv1", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, form
        for _ in range(3):
            picture = av.VideoFrame(64, 48, form)
            plane = np.zeros((48, picture.planes[0].line_size // 2), "<u2")
            plane[:, :64] = GREY.astype(np.uint16) << shift
            picture.planes[0].update(plane.tobytes())
            out.mux(stream.encode(picture))
        out.mux(stream.encode())
    frames, notes = frames_of(path)
    assert len(frames) == 3
    for frame in frames:
        np.testing.assert_array_equal(frame.image, GREY)
    assert bool(notes) == (form == "gray16le")


def stack(path: Path, pages: list[np.ndarray]) -> Path:
    first, *others = [Image.fromarray(page) for page in pages]
    first.save(path, save_all=True, append_images=others)
    return path


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_pages_are_frames(tmp_path: Path, kind: type):
    pages = [
        np.roll(GREY, k, axis=1).astype(kind) * (1 if kind is np.uint8 else 256) for k in range(5)
    ]
    folder = tmp_path / "stack"
    folder.mkdir()
    file = stack(folder / "b.tif", pages[1:])
    cv2.imwrite(str(folder / "a.tif"), pages[0])
    frames, _ = frames_of(folder)
    assert [frame.name for frame in frames][:2] == ["a.tif page 0", "b.tif page 0"]
    for frame, page in zip(frames, pages, strict=True):
        np.testing.assert_array_equal(frame.image, page if kind is np.uint8 else page >> 8)
    assert len(frames_of(file)[0]) == 4
    with pytest.raises(InputError, match="is one image"):
        open_frames(folder / "a.tif")


def test_a_damaged_page_is_a_frame_with_a_fault(tmp_path: Path):
    file = stack(tmp_path / "a.tif", [GREY] * 4)
    whole = file.read_bytes()
    for cut in (len(whole) // 2, len(whole) - 40):
        file.write_bytes(whole[:cut])
        try:
            frames = list(open_frames(file))
        except InputError:
            continue
        assert all((frame.image is None) == (frame.fault is not None) for frame in frames)


def huge_png(path: Path, side: int) -> Path:
    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    pixels = zlib.compress(bytes(1000))
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )
    return path


@pytest.mark.parametrize("side", [12_000, 30_000, 65_000])
def test_a_huge_image_is_refused_by_its_header(tmp_path: Path, side: int):
    folder = write(tmp_path / "a", [GREY])
    huge_png(folder / "1.png", side)
    good, huge = open_frames(folder)
    assert good.image is not None
    assert huge.image is None
    assert "megapixels; expected 100 at most" in str(huge.fault)


def test_the_limit_can_be_moved(tmp_path: Path):
    folder = write(tmp_path / "a", [GREY])
    (frame,) = open_frames(folder, max_megapixels=1e-3)
    assert "megapixels" in str(frame.fault)
    with pytest.raises(InputError, match="max_megapixels: expected a positive number"):
        open_frames(folder, max_megapixels=0.0)
