"""Where the times of images come from, and what happens when they make no sense."""

from __future__ import annotations

import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from farpoint.errors import InputError
from farpoint.frames import files, open_frames
from farpoint.frames.clock import parse_seconds

WriteImages = Callable[..., Path]
NAMES = ["0.png", "1.png", "2.png"]


def times(folder: Path, **options: float) -> tuple[list[float], str]:
    source = open_frames(folder, **options)
    return [frame.timestamp for frame in source], source.timestamp_source


def test_without_any_the_rate_decides_and_says_so(write_images: WriteImages):
    folder = write_images("drive", NAMES)
    assert times(folder) == ([0, 0.1, 0.2], "10 frames a second, assumed")
    assert times(folder, fps=25) == ([0, 0.04, 0.08], "25 frames a second")


@pytest.mark.parametrize("name", ["times.txt", "timestamps.txt"])
@pytest.mark.parametrize("place", [".", ".."])
@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (["0.0", "1.04e-1", "0.25"], [0, 0.104, 0.25]),
        (["# seconds", "5", "", "6", "7.5"], [5, 6, 7.5]),
        # KITTI raw: date and time with nanoseconds; the 26th is the 15243rd day of Unix time.
        (
            [f"2011-09-26 00:00:0{second}.250000000" for second in (1, 2, 3)],
            [15243 * 86400 + second + 0.25 for second in (1, 2, 3)],
        ),
        # TUM's monocular sets: id, time, exposure.
        ([f"{number:05d} 1436020205.{number}5 0.01" for number in range(3)], None),
        # Nanoseconds.
        ([f"14360202050{number}0000000" for number in range(3)], None),
    ],
)
def test_files_of_times(
    write_images: WriteImages, name: str, place: str, rows: list[str], expected: list[float] | None
):
    folder = write_images("drive/image_0", ["a.png", "b.png", "c.png"])
    (folder / place / name).write_text("\n".join(rows) + "\n")
    seconds, source = times(folder, fps=99)
    if expected is None:
        step = 0.1 if " " in rows[0] else 0.01
        start = 1436020205.05 if " " in rows[0] else 1436020205.0
        expected = [start + step * number for number in range(3)]
    assert seconds == pytest.approx(expected, abs=1e-6)
    assert source == name


def test_dates_do_not_depend_on_where_one_is(
    write_images: WriteImages, monkeypatch: pytest.MonkeyPatch
):
    folder = write_images("drive", ["a.png"])
    (folder / "timestamps.txt").write_text("2011-09-26 00:00:00.000000000\n")
    with monkeypatch.context() as patch:
        patch.setenv("TZ", "Asia/Tokyo")
        time.tzset()
        seconds, _ = times(folder)
    time.tzset()
    assert seconds == [15243 * 86400]


def test_a_file_of_times_that_does_not_fit_is_another_ones(write_images: WriteImages):
    folder = write_images("drive", ["a.png", "b.png"])
    (folder / "times.txt").write_text("1\n2\n3\n")
    assert times(folder)[1] == "10 frames a second, assumed"


def test_part_of_a_sequence_takes_the_rows_of_its_frame_numbers(write_images: WriteImages):
    folder = write_images("drive", ["000002.png", "000003.png", "000005.png"])
    (folder / "times.txt").write_text("".join(f"{number * number}\n" for number in range(9)))
    assert times(folder) == ([4, 9, 25], "times.txt")
    (folder / "times.txt").write_text("0\n1\n4\n9\n")  # too short for frame 5
    assert times(folder)[1] == "10 frames a second, assumed"


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        (["0", "one", "2"], 2),
        (["0", "nan", "2"], 2),
        (["0", "1", "inf"], 3),
        (["0", "2", "1"], 3),
        (["2011-09-26 00:00:00", "2011-09-26 00:99:00", "2011-09-26 00:00:02"], 2),
    ],
)
def test_impossible_times_are_named_by_file_and_line(
    write_images: WriteImages, rows: list[str], line: int
):
    folder = write_images("drive", NAMES)
    (folder / "times.txt").write_text("\n".join(rows))
    with pytest.raises(InputError) as caught:
        open_frames(folder)
    assert caught.value.file == str(folder / "times.txt")
    assert caught.value.field == f"line {line}"


def test_binary_times_are_refused(write_images: WriteImages):
    folder = write_images("drive", NAMES)
    (folder / "times.txt").write_bytes(b"0.1\n\x89\xff\x00\x80")
    with pytest.raises(InputError, match=r"times\.txt: expected a list, a text file"):
        open_frames(folder)


@pytest.mark.parametrize(
    ("stems", "expected"),
    [
        (  # EuRoC, ns
            ["1403715273262142976", "1403715273312143104"],
            [1403715273.262142976, 1403715273.312143104],
        ),
        (["1305031229.528748", "1305031229.564425"], [1305031229.528748, 1305031229.564425]),
        # Decimals are no counters: .49 comes before .5.
        (["1305031229.49", "1305031229.5"], [1305031229.49, 1305031229.5]),
        (["1418381798086398", "1418381798149000"], [1418381798.086398, 1418381798.149]),  # us
        (["1418381798086", "1418381798149"], [1418381798.086, 1418381798.149]),  # ms
    ],
)
def test_names_that_are_times(write_images: WriteImages, stems: list[str], expected: list[float]):
    folder = write_images("drive", [f"{stem}.png" for stem in stems])
    assert times(folder, fps=99) == (expected, "file names")
    assert [frame.name for frame in open_frames(folder)] == [f"{stem}.png" for stem in stems]


@pytest.mark.parametrize("stems", [["0000000001", "0000000002"], ["1.5", "2.5"], ["a1", "a2"]])
def test_names_that_are_counters(write_images: WriteImages, stems: list[str]):
    folder = write_images("drive", [f"{stem}.png" for stem in stems])
    assert times(folder)[1] == "10 frames a second, assumed"


@given(st.integers(10**18, 2 * 10**18 - 1))
def test_nanoseconds_are_rounded_once(nanoseconds: int):
    assert parse_seconds(str(nanoseconds)) == float(Fraction(nanoseconds, 10**9))


@given(st.floats(-1e10, 1e10))
def test_seconds_stay_as_they_are(seconds: float):
    assert parse_seconds(repr(seconds)) == seconds


@pytest.mark.parametrize("limit", ["_LARGEST_LIST_BYTES", "_MOST_LINES"])
def test_limits_of_a_list_of_times_hold_for_what_is_read(
    limit: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A KITTI sequence's times.txt, beside its images and its poses."""
    path = tmp_path / "times.txt"
    path.write_text("# times\n" + "1\n" * 50)
    monkeypatch.setattr(files, limit, path.stat().st_size if "BYTES" in limit else 50)
    assert len(files.read_lines(path)) == 50
    monkeypatch.setattr(files, limit, 49)
    with pytest.raises(InputError, match=r"times\.txt: (is too large for|.*most 49 lines)"):
        files.read_lines(path)
