"""Only regular files are read, and never more of them than the limit."""

import os
from pathlib import Path

import pytest

from farpoint.camera import load_camera
from farpoint.errors import InputError
from farpoint.regular_files import check_regular_file, read_regular_file, regular_lines


def test_a_file_is_read_up_to_the_limit_and_not_beyond(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"x" * 10)
    assert read_regular_file(path, limit_bytes=10, what="a list") == b"x" * 10
    with pytest.raises(InputError, match=r"file.*too large for a list"):
        read_regular_file(path, limit_bytes=9, what="a list")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_and_a_link_to_a_device_are_refused_at_once(tmp_path):
    pipe, link = tmp_path / "pipe.yaml", tmp_path / "link.yaml"
    os.mkfifo(pipe)
    link.symlink_to("/dev/zero")
    for path in (pipe, link):
        with pytest.raises(InputError, match="no regular file; expected a list"):
            check_regular_file(path, what="a list")
        with pytest.raises(InputError, match="no regular file"):
            load_camera(path)


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="no /proc here")
def test_the_limit_holds_where_the_size_on_record_is_zero():
    with pytest.raises(InputError, match="too large"):
        read_regular_file(Path("/proc/self/maps"), limit_bytes=100, what="a list")


def test_lines_are_read_whole_in_either_encoding_and_no_descriptor_stays(tmp_path):
    path = tmp_path / "file"
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        path.write_bytes("é 1\r\n2\r3".encode(encoding))
        read = regular_lines(path, limit_bytes=100, what="a list")
        assert list(read) == ["é 1\n", "2\n", "3"]
    path.write_bytes(b"1\n" * 70_000)
    before = os.dup(0)
    os.close(before)
    assert sum(1 for _ in regular_lines(path, limit_bytes=140_000, what="a list")) == 70_000
    for bad in (tmp_path, tmp_path / "none", tmp_path / "a\0b"):
        with pytest.raises(InputError, match="expected a list"):
            list(regular_lines(bad, limit_bytes=9, what="a list"))
    for limit, words in ((139_999, "too large for a list"), (9, "too large")):
        with pytest.raises(InputError, match=words):
            list(regular_lines(path, limit_bytes=limit, what="a list"))
    path.write_bytes(b"1\n\xff\n")
    with pytest.raises(InputError, match="expected a list, a text file"):
        list(regular_lines(path, limit_bytes=9, what="a list"))
    path.write_bytes(b"\n" + b"1" * 70_000)
    with pytest.raises(InputError, match=r"line 2: expected a list, got a line of more than 65536"):
        list(regular_lines(path, limit_bytes=100_000, what="a list"))
    after = os.dup(0)
    os.close(after)
    assert after == before
