"""Bags of thousands of messages of which half are damaged: the others are read, all are counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags_kit import KINDS, Kind, compressed_message, file_of, png, write_bag
from frames_kit import picture

from farpoint.frames import open_frames

TENTH_NS = 10**8


def half_damaged(number: int, data: bytes) -> bytes:
    """Every second message is cut off, zero, noise, or of a wrong time."""
    if number % 2 == 0:
        return data
    rng = np.random.default_rng(number)
    if number % 10 == 1:
        return data[: len(data) // 2]
    if number % 10 == 3:
        return bytes(len(data))
    if number % 10 == 5:
        return rng.bytes(len(data))
    if number % 10 == 7:
        return data[:20] + rng.bytes(40) + data[60:]
    return b""


@pytest.mark.parametrize(("kind", "first"), [*((kind, 0) for kind in KINDS), ("mcap", 1)])
def test_ten_thousand_messages_half_of_them_damaged(tmp_path: Path, kind: Kind, first: int):
    shots = [png(picture(number)[:40, :50]) for number in range(8)]
    sent = (
        compressed_message(shots[number % 8], TENTH_NS * (number + 1)) for number in range(10_000)
    )
    path = write_bag(tmp_path, kind, sent, damage=lambda k, data: half_damaged(k + first, data))
    frames = list(open_frames(path))
    assert len(frames) == 10_000
    times = [frame.timestamp for frame in frames]
    assert times == sorted(times)
    whole = [frame for frame in frames if frame.fault is None]
    assert len(whole) >= 5_000
    for frame in frames[first::2]:
        assert frame.timestamp == (frame.index + 1) / 10
        np.testing.assert_array_equal(frame.image, picture(frame.index % 8)[:40, :50])
    faults = [frame for frame in frames if frame.fault is not None]
    assert len(faults) >= 4_990  # noise may hit what does not matter
    assert {(frame.index + first) % 2 for frame in faults} == {1}


@pytest.mark.parametrize("kind", KINDS)
def test_bytes_turned_in_half_of_the_messages(tmp_path: Path, kind: Kind):
    """In the file, anywhere in the record of a message: its envelope, its fields, its image."""
    count = 2000
    shots = [png(picture(number)[:40, :50]) for number in range(8)]
    sent = [compressed_message(shots[k % 8], TENTH_NS * (k + 1)) for k in range(count)]
    path = write_bag(tmp_path, kind, sent)
    file = file_of(path)
    data, rng = bytearray(file.read_bytes()), np.random.default_rng(4)
    marks, at = [], data.find(b"\x89PNG")
    while at >= 0:
        marks.append(at)
        at = data.find(b"\x89PNG", at + 1)
    assert len(marks) == count
    for mark in marks[1::2]:
        for turn in rng.integers(-90, 900, 4):
            data[mark + turn] ^= 1 << rng.integers(8)
    file.write_bytes(data)
    frames = list(open_frames(path))
    assert [frame.index for frame in frames] == list(range(len(frames)))
    whole = [frame for frame in frames if frame.image is not None]
    faults = [frame for frame in frames if frame.fault]
    assert len(whole) > 0.45 * count
    assert len(faults) > 0.45 * count
    right = sum(
        np.array_equal(frame.image, picture(round(10 * frame.timestamp - 1) % 8)[:40, :50])
        for frame in whole
    )
    assert right > 0.98 * len(whole)
