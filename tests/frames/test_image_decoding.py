"""One image file: grey values, and an account of every kind of damage, without noise."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from frames_kit import encode, picture, without_rights
from hypothesis import given, settings
from hypothesis import strategies as st

from farpoint.frames.decode import UnreadableImageError, read_grey
from farpoint.frames.integrity import find_damage

PNG = encode(picture(0), ".png")
JPEG = encode(picture(0), ".jpg")
PROGRESSIVE = cv2.imencode(".jpg", picture(0), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
WARNING = 3  # OpenCV's level of the log
THUMBNAIL = b"\xff\xe1\x00\x0c" + b"\xff\xd8\xff\xda\x00\x02zz\xff\xd9"


@pytest.mark.parametrize("suffix", [".png", ".pgm", ".tif", ".bmp"])
def test_lossless_formats_give_back_what_was_written(tmp_path: Path, suffix: str):
    path = tmp_path / f"größe 図{suffix}"
    path.write_bytes(encode(picture(3), suffix))
    np.testing.assert_array_equal(read_grey(path), picture(3))


def test_sixteen_bits_keep_the_upper_eight(tmp_path: Path):
    (tmp_path / "a.png").write_bytes(encode(picture(1).astype(np.uint16) * 256 + 201, ".png"))
    np.testing.assert_array_equal(read_grey(tmp_path / "a.png"), picture(1))


def test_colour_becomes_luma(tmp_path: Path):
    colour = np.stack([picture(1), picture(2), picture(3)], axis=-1)  # blue, green, red
    (tmp_path / "a.png").write_bytes(encode(colour, ".png"))
    luma = colour @ [0.114, 0.587, 0.299]  # BT.601
    np.testing.assert_allclose(read_grey(tmp_path / "a.png"), luma, atol=1.01)  # libpng rounds down


def test_what_a_codec_grumbles_about_is_no_noise(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """libjpeg writes to the descriptor itself, whatever OpenCV's log is set to."""
    (tmp_path / "a.jpg").write_bytes(JPEG[:-2] + b"UU" + JPEG[-2:])  # as many webcams do
    whole = cv2.imdecode(np.frombuffer(JPEG, np.uint8), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(read_grey(tmp_path / "a.jpg"), whole)
    print("still there", file=sys.stderr)
    os.write(2, b"the descriptor, too")
    assert capfd.readouterr().err == "still there\nthe descriptor, too"


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "empty"),
        (b"no image", "cannot be decoded"),
        (PNG[: len(PNG) // 2], "PNG is truncated"),
        (PNG[:-1], "PNG is truncated"),
        (PNG[:500] + bytes(20) + PNG[520:], "PNG is damaged"),
        (JPEG[: len(JPEG) // 2], "JPEG is truncated"),
        (JPEG[:1060] + JPEG[1300:], "JPEG is damaged"),
        (PROGRESSIVE[:900] + JPEG[-2:], "JPEG is damaged"),
        # A thumbnail, which has an end of its own, in front of a scan that breaks off.
        (JPEG[:2] + THUMBNAIL + JPEG[2:-300], "JPEG is truncated"),
        (encode(picture(0), ".pgm")[:900], "cannot be decoded"),
        (b"P5 100000 100000 255\n", "has 10000 megapixels; expected 100 at most"),
    ],
)
def test_damage_has_a_reason_and_makes_no_noise(
    tmp_path: Path, data: bytes, why: str, capfd: pytest.CaptureFixture[str]
):
    path = tmp_path / "a.png"
    path.write_bytes(data)
    logging = getattr(cv2.utils, "logging", cv2)
    logging.setLogLevel(WARNING)
    with pytest.raises(UnreadableImageError, match=why):
        read_grey(path)
    assert capfd.readouterr().err == ""
    assert logging.getLogLevel() == WARNING


def test_files_that_cannot_be_read_have_a_reason(tmp_path: Path):
    with pytest.raises(UnreadableImageError, match="no such file"):
        read_grey(tmp_path / "nothing.png")
    (tmp_path / "locked.png").write_bytes(PNG)
    with (
        without_rights(tmp_path / "locked.png"),
        pytest.raises(UnreadableImageError, match="Permission denied"),
    ):
        read_grey(tmp_path / "locked.png")


def test_whole_files_are_not_suspected():
    assert find_damage(PNG) is None
    assert find_damage(JPEG) is None
    assert find_damage(JPEG[:2] + THUMBNAIL + JPEG[2:]) is None
    assert find_damage(JPEG + b"what a camera appends") is None
    assert find_damage(encode(picture(0), ".tif")) is None


@settings(max_examples=200, deadline=None)
@given(place=st.integers(8, len(PNG) - 1), change=st.integers(1, 255))
def test_no_single_byte_of_a_png_changes_unnoticed(place: int, change: int):
    damaged = bytearray(PNG)
    damaged[place] ^= change
    assert find_damage(bytes(damaged)) is not None
