"""Standard streams that nobody reads, signals of services, and messages with odd characters."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from cli_kit import (
    FARPOINT,
    CommandLine,
    assert_refused,
    record_of,
    rows_of,
    start,
    wait_for_rows,
    write_folder,
)

from farpoint import __version__
from farpoint.cli import streams

CLOSED = {
    "stdin": partial(os.close, 0),
    "stdout": partial(os.close, 1),
    "stderr": partial(os.close, 2),
    "all": lambda: [os.close(k) for k in range(3)],
}


def code_of(*arguments: str | Path, closed: str, cwd: Path) -> int:
    return subprocess.run(
        [*FARPOINT, *map(str, arguments)], preexec_fn=CLOSED[closed], cwd=cwd, timeout=120
    ).returncode


@pytest.mark.parametrize("closed", CLOSED)
def test_a_closed_stream_changes_neither_the_code_nor_the_outcome(
    closed: str, tmp_path: Path, calibration: Path, images: tuple[np.ndarray, ...]
):
    shots, out = write_folder(tmp_path / "shots", images[:4]), tmp_path / "out"
    run = ("run", shots, "--camera", calibration, "--out", out, "--no-overlay", "--no-report")
    assert code_of(*run, closed=closed, cwd=tmp_path) == 0
    assert len(rows_of(out)) == 3
    # Nothing printed has gone into a file that was given the closed stream's number.
    assert all("pairs of frames" not in path.read_text() for path in out.glob("*.*"))
    # What prints most, where it is printed: tables and help on stdout, errors and usage on stderr.
    if closed in ("stdout", "all"):
        assert code_of("evaluate", out, closed=closed, cwd=tmp_path) == 0
        assert code_of("--help", closed=closed, cwd=tmp_path) == 0
    if closed in ("stderr", "all"):
        assert code_of("camera", tmp_path / "none", closed=closed, cwd=tmp_path) == 2
        assert code_of(closed=closed, cwd=tmp_path) == 2


TALKATIVE = """
import os, sys
from farpoint.cli import main
from farpoint.odometry import Odometry

quiet = Odometry.process

def talkative(*arguments, **options):
    for descriptor in (1, 2):  # as libraries in C do, past Python's streams
        os.write(descriptor, b"CHATTER\\n")
    return quiet(*arguments, **options)

Odometry.process = talkative
sys.exit(main())
"""


def test_what_is_printed_past_python_gets_into_no_output(
    tmp_path: Path, calibration: Path, images: tuple[np.ndarray, ...]
):
    shots, out = write_folder(tmp_path / "shots", images[:4]), tmp_path / "out"
    run = ("run", shots, "--camera", calibration, "--out", out, "--no-overlay", "--no-report")
    done = subprocess.run(
        [sys.executable, "-c", TALKATIVE, *map(str, run)],
        preexec_fn=CLOSED["all"],
        cwd=tmp_path,
        timeout=120,
    )
    assert done.returncode == 0
    assert len(rows_of(out)) == 3
    assert all(b"CHATTER" not in path.read_bytes() for path in out.iterdir() if path.is_file())


KEEPER = """
import os, runpy, sys

lasting_streams = runpy.run_path(sys.argv[2])["lasting_streams"]
with lasting_streams(), open(sys.argv[1], "w") as file:
    for descriptor in (1, 2):
        os.write(descriptor, b"chatter")
    print("said")
    print("said", file=sys.stderr)
    file.write("kept")
"""


@pytest.mark.parametrize("closed", CLOSED)
def test_a_file_opened_later_never_takes_the_place_of_a_closed_stream(closed: str, tmp_path: Path):
    path = tmp_path / "output"
    done = subprocess.run(
        [sys.executable, "-c", KEEPER, path, streams.__file__],
        preexec_fn=CLOSED[closed],
        capture_output=True,
    )
    assert done.returncode == 0
    assert path.read_text() == "kept"


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
@pytest.mark.parametrize(
    ("arguments", "code"), [(("--help",), 0), (("camera", "none.yaml"), 2), ((), 2)]
)
def test_a_reader_that_has_gone_changes_no_code(
    stream: str, arguments: tuple[str, ...], code: int, tmp_path: Path
):
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run([*FARPOINT, *arguments], cwd=tmp_path, **{stream: write})
        assert done.returncode == code
    finally:
        os.close(write)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_service_that_is_stopped_keeps_what_it_computed(
    number: signal.Signals, tmp_path: Path, calibration: Path, images: tuple[np.ndarray, ...]
):
    shots = write_folder(tmp_path / "shots", images * 40)
    out = tmp_path / "out"
    process = start("run", shots, "--camera", calibration, "--out", out, "--no-report")
    wait_for_rows(out / "motions.csv", 3, process)
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.splitlines()[-1] == "farpoint: interrupted; what was computed is in the outputs"
    assert len(rows_of(out)) >= 3
    assert record_of(out)["state"] == "interrupted"


def test_a_hang_up_that_the_caller_ignores_stays_ignored(
    tmp_path: Path, calibration: Path, images: tuple[np.ndarray, ...]
):
    shots, out = write_folder(tmp_path / "shots", images * 4), tmp_path / "out"
    run = ("run", shots, "--camera", calibration, "--out", out, "--no-overlay", "--no-report")
    process = subprocess.Popen(
        [*FARPOINT, *map(str, run)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=partial(signal.signal, signal.SIGHUP, signal.SIG_IGN),
    )
    wait_for_rows(out / "motions.csv", 2, process)
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=60)
    assert process.returncode == 0
    assert len(rows_of(out)) == 4 * len(images) - 1


def test_the_version_is_printed(farpoint: CommandLine):
    said = farpoint("--version")
    assert (said.code, said.out, said.err) == (0, f"farpoint {__version__}\n", "")


def test_no_command_is_wrong_usage(farpoint: CommandLine):
    said = farpoint()
    assert said.code == 2
    assert said.out == ""
    assert said.err.startswith("usage: farpoint")


@pytest.mark.parametrize(
    "name", ["a\nb.yaml", "\x1b[31mred.yaml", "tab\tbell\x07.yaml", "\u202e.yaml"]
)
def test_a_name_cannot_break_a_message(name: str, tmp_path: Path, farpoint: CommandLine):
    said = farpoint("camera", tmp_path / name)
    assert_refused(said, "no such file", name.encode("unicode_escape").decode())
    assert said.err.rstrip("\n").isprintable()


def test_a_name_of_bytes_that_are_no_text_is_shown(tmp_path: Path):
    name = os.fsencode(tmp_path) + b"/\xff\xfe.yaml"
    done = subprocess.run([*FARPOINT, "camera", name], capture_output=True, check=False)
    assert done.returncode == 2
    assert rb"\udcff\udcfe.yaml: no such file" in done.stderr
    assert done.stderr.count(b"\n") == 1


def test_a_name_that_the_terminal_cannot_show_is_no_error(tmp_path: Path):
    done = subprocess.run(
        [*FARPOINT, "camera", tmp_path / "straße.yaml"],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
    )
    assert done.returncode == 2
    assert rb"stra\xdfe.yaml: no such file" in done.stderr


def test_the_contents_of_a_file_cannot_break_a_message(tmp_path: Path, farpoint: CommandLine):
    path = tmp_path / "camera.yaml"
    path.write_text(
        'camera_model: "pin\\e[31mhole\\n"\nintrinsics: [1, 1, 1, 1]\nresolution: [2, 2]\n'
    )
    said = farpoint("camera", path)
    assert said.code == 2
    assert said.err.count("\n") == 1
    assert said.err.rstrip("\n").isprintable()


@pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full")
def test_a_full_disk_behind_standard_output_is_reported():
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([*FARPOINT, "--version"], stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 2
    assert done.stderr == b"farpoint: No space left on device\n"


def test_a_stream_that_was_closed_is_no_terminal():
    """Libraries ask at the end of Python, when tests have closed what they captured."""
    with contextlib.redirect_stdout(io.StringIO()) as captured, streams.lasting_streams():
        lasting = sys.stdout
        captured.close()
        assert not lasting.isatty()
