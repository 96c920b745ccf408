"""Bags that are cut off, damaged, or never closed: what is there is read, what is lost is said."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags_kit import (
    KINDS,
    Kind,
    Sent,
    compressed_message,
    file_of,
    foxglove_mcap,
    image_message,
    info_message,
    png,
    proto,
    proto_stamp,
    write_bag,
)
from frames_kit import picture

from farpoint.errors import InputError
from farpoint.frames import Frame, open_frames
from fuzz import fuzz_count
from memory import peak_bytes

TENTH_NS = 10**8
COMPRESSIONS = [("ros1", ""), ("ros1", "lz4"), ("sqlite3", ""), ("mcap", ""), ("mcap", "storage")]


def images(count: int) -> list[Sent]:
    """Large enough that a bag has several chunks."""
    small = [np.tile(picture(number), (2, 2)) for number in range(8)]
    return [
        image_message(small[number % 8], "mono8", TENTH_NS * (number + 1))
        for number in range(count)
    ]


def good(frames: list[Frame]) -> list[Frame]:
    """Those with an image, which must be the one of their time."""
    whole = [frame for frame in frames if frame.image is not None]
    for frame in whole:
        number = round(frame.timestamp * 10) - 1
        np.testing.assert_array_equal(frame.image, np.tile(picture(number % 8), (2, 2)))
    return whole


def assert_in_order(frames: list[Frame]) -> None:
    times = [frame.timestamp for frame in frames]
    assert times == sorted(times)
    assert [frame.index for frame in frames] == list(range(len(frames)))


@pytest.mark.parametrize(("kind", "compression"), COMPRESSIONS)
@pytest.mark.parametrize("share", [0.3, 0.7, 0.97])
def test_a_bag_that_is_cut_off_gives_what_is_there_and_says_where_it_ends(
    tmp_path: Path, kind: Kind, compression: Any, share: float
):
    path = write_bag(tmp_path, kind, images(60), compression=compression)
    file = file_of(path)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    frames = list(open_frames(path))
    assert_in_order(frames)
    # A compressed chunk that is cut off is lost: it holds up to a megabyte.
    lost = {"": 3, "lz4": 12, "storage": 20}[compression]
    assert len(good(frames)) >= share * 60 - lost
    if len(good(frames)) < 60:
        faults = [frame.fault for frame in frames if frame.fault]
        assert faults
        assert any(word in faults[-1] for word in ("byte", "row", "malformed"))


@pytest.mark.parametrize(("kind", "compression"), COMPRESSIONS)
def test_damage_in_the_middle_costs_what_was_there(tmp_path: Path, kind: Kind, compression: Any):
    path = write_bag(tmp_path, kind, images(80), compression=compression)
    file = file_of(path)
    data = bytearray(file.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 3000] = bytes(3000)
    file.write_bytes(data)
    frames = list(open_frames(path))
    assert_in_order(frames)
    whole = [f for f in frames if f.image is not None]
    assert 78 - 25 * bool(compression) <= len(whole) <= 80
    assert len({f.timestamp for f in whole}) == len(whole)
    if compression:  # the chunk is lost, but its index says what it held
        assert len(frames) == 80
        assert all("the chunk at byte" in (f.fault or "the chunk at byte") for f in frames)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_records_whose_lengths_are_wrong_are_passed_over(tmp_path: Path, kind: Kind):
    path = write_bag(tmp_path, kind, images(80))
    file = file_of(path)
    data = bytearray(file.read_bytes())
    # The head of a chunk in the middle.
    if kind == "ros1":
        heads = [hit.start() for hit in re.finditer(rb"op=\x05", data)]
    else:
        heads, at = [], 8
        while data[at] != 0x0F:
            heads += [at] if data[at] == 0x06 else []
            at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    at = next(start for start in heads if start > len(data) // 3)
    data[at - 30 : at + 30] = b"\xff" * 60
    file.write_bytes(data)
    frames = list(open_frames(path))
    assert_in_order(frames)
    assert len(good(frames)) >= 80 - 2 * 15  # MCAP: all, since messages in a chunk are found, too
    assert good(frames)[-1].timestamp == 8.0  # those behind it are read
    assert any("reading goes on at byte" in (frame.fault or "") for frame in frames)


def test_a_wrong_length_among_messages_without_chunks_is_passed_over(tmp_path: Path):
    messages = [
        (
            TENTH_NS * k,
            proto((1, proto_stamp(TENTH_NS * (k + 1))), (2, png(picture(k))), (3, "png")),
        )
        for k in range(6)
    ]
    path = tmp_path / "x.mcap"
    foxglove_mcap(path, messages, type_name="foxglove.CompressedImage")
    data = bytearray(path.read_bytes())
    at = data.index(b"\x89PNG", data.index(b"\x89PNG") + 10)  # the second message
    data[at - 40 : at - 30] = b"\xee" * 10  # the length of its record
    path.write_bytes(data)
    frames = list(open_frames(path))
    assert [f.timestamp for f in frames if f.image is not None] == [0.1, 0.3, 0.4, 0.5, 0.6]
    assert "reading goes on at byte" in (frames[1].fault or "")


def test_a_header_that_contradicts_the_recording_is_damaged_unless_the_next_agrees(tmp_path: Path):
    sent = images(20)
    for number in (5, 6, 12):
        other = image_message(np.tile(picture(number % 8), (2, 2)), "mono8", 10**14 + number)
        sent[number] = replace(other, recorded_ns=sent[number].recorded_ns)
    path = write_bag(tmp_path, "mcap", sent)
    frames = list(open_frames(path))
    refused = [frame.index for frame in frames if frame.fault]
    # 5 alone is not believed, with 6 it is; and so on the way back, at 7.
    assert refused == [5, 7, 12]
    assert frames[6].timestamp == pytest.approx(1e5)
    assert frames[12].timestamp == pytest.approx(1.3)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_recording_that_was_never_closed_has_no_index_and_is_read(tmp_path: Path, kind: Kind):
    path = write_bag(tmp_path, kind, images(40))
    file = file_of(path)
    data = bytearray(file.read_bytes())
    if kind == "ros1":
        at = data.index(b"index_pos=") + 10
        end = int.from_bytes(data[at : at + 8], "little")
        data[at : at + 8] = bytes(8)
    else:
        end = int.from_bytes(data[-28:-20], "little")  # where the summary begins
    file.write_bytes(data[:end])
    opened = open_frames(path)
    assert opened.count == 40
    assert len(good(list(opened))) == 40


def test_a_missing_part_of_a_bag_is_reported(tmp_path: Path):
    path = write_bag(tmp_path, "sqlite3", images(4))
    metadata = path / "metadata.yaml"
    text = metadata.read_text()
    metadata.write_text(text.replace("- drive-sqlite3.db3", "- gone.db3\n  - drive-sqlite3.db3"))
    frames = list(open_frames(path))
    assert frames[0].fault == "gone.db3: is missing"
    assert len(good(frames)) == 4
    metadata.write_bytes(b"\xff\x00not: [yaml")
    assert len(good(list(open_frames(path)))) == 4
    shutil.rmtree(path)
    path.mkdir()
    metadata.write_text(text)
    with pytest.raises(InputError, match="is missing"):
        open_frames(path)


@pytest.mark.parametrize("data", [b"", b"#ROSBAG V1.2\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3"])
def test_files_that_are_no_bag_are_one_line(tmp_path: Path, data: bytes, suffix: str):
    path = tmp_path / f"x{suffix}"
    path.write_bytes(data)
    with pytest.raises(InputError) as refused:
        open_frames(path)
    assert "\n" not in str(refused.value)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("kind", KINDS)
def test_mutants_of_bags_never_crash(tmp_path: Path, kind: Kind):
    sent = [compressed_message(png(picture(k)[:20, :30]), TENTH_NS * (k + 1)) for k in range(12)]
    path = write_bag(tmp_path, kind, sent)
    file = file_of(path)
    data, rng = file.read_bytes(), np.random.default_rng(1)
    for _ in range(fuzz_count(60)):
        mutant = bytearray(data)
        for at in rng.integers(0, len(data), rng.integers(1, 30)):
            mutant[at] = rng.integers(256)
        if rng.random() < 0.3:
            del mutant[rng.integers(len(mutant)) :]
        file.write_bytes(mutant)
        try:
            frames = list(open_frames(path))
        except InputError as error:
            assert "\n" not in str(error)  # noqa: PT017
        else:
            assert [frame.index for frame in frames] == list(range(len(frames)))


def test_mutants_of_messages_of_foxglove_never_crash(tmp_path: Path):
    raw = proto((1, proto_stamp(TENTH_NS)), (2, png(picture(0)[:20, :30])), (3, "png"), (4, "c"))
    rng = np.random.default_rng(2)
    messages = []
    for number in range(fuzz_count(300)):
        mutant = bytearray(raw)
        for at in rng.integers(0, 40, rng.integers(1, 4)):
            mutant[at] = rng.integers(256)
        messages.append((number, bytes(mutant)))
    path = tmp_path / "x.mcap"
    foxglove_mcap(path, [(0, raw), *messages], type_name="foxglove.CompressedImage", end=False)
    frames = list(open_frames(path))
    assert len(frames) == len(messages) + 2  # the last one says that the file has no end
    assert any(frame.fault for frame in frames[:-1])
    assert "ends without its last record" in (frames[-1].fault or "")


@pytest.mark.parametrize(("kind", "compression"), COMPRESSIONS)
def test_memory_does_not_grow_with_the_bag(tmp_path: Path, kind: Kind, compression: Any):
    peaks = []
    for count in (60, 480):
        path = write_bag(tmp_path, kind, images(count), compression=compression, name=f"n{count}")

        def read(path: Path = path) -> None:
            for frame in open_frames(path):
                assert frame.fault is None

        read()
        peaks.append(peak_bytes(read))
    assert peaks[1] < peaks[0] + 200_000


@pytest.mark.parametrize(
    ("intact", "damaged"), [(b"float64[9] k", b"float64[9] q"), (b"Time stamp", b"Time stanp")]
)
def test_a_damaged_definition_is_a_fault_of_its_messages(
    tmp_path: Path, intact: bytes, damaged: bytes
):
    sent = [info_message(size=(8, 8), k=[9.0, 0, 4, 0, 9, 4, 0, 0, 1])]
    sent += [image_message(np.zeros((8, 8), np.uint8), "mono8", stamp) for stamp in (1, 2, 3)]
    file = file_of(write_bag(tmp_path, "mcap", sent))
    data = file.read_bytes()
    assert intact in data
    file.write_bytes(data.replace(intact, damaged))
    with pytest.raises(InputError):
        open_frames(file).camera()
