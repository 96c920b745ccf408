"""Only regular files are read, and never more of them than the limit."""

import os
from pathlib import Path

import pytest

from farpoint.camera import load_camera
from farpoint.errors import InputError
from farpoint.regular_files import check_regular_file, read_regular_file


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
