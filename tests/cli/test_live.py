"""``farpoint live``: watched until Ctrl-C, with valid files and a true account."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from cli_kit import (
    PATIENCE_S,
    CommandLine,
    assert_refused,
    encoded,
    record_of,
    rows_of,
    start,
    there_and_back,
    wait_for_rows,
    write_folder,
    write_phone_pictures,
    write_video,
)

from farpoint.sinks.motions import read_motions
from farpoint.synthetic.paths import CAMERA_HEIGHT_M
from farpoint.synthetic.sequence import RenderedSequence
from farpoint.trajectory.files import read_tum

HEIGHT_M = str(CAMERA_HEIGHT_M)

Pictures = tuple[np.ndarray, ...]


@pytest.fixture
def video(tmp_path: Path, images: Pictures) -> Path:
    return write_video(tmp_path / "drive.avi", there_and_back(images), fps=30)


def test_a_video_is_processed_to_its_end(
    farpoint: CommandLine, tmp_path: Path, video: Path, calibration: Path
):
    out = tmp_path / "out"
    outcome = farpoint("live", video, "--camera", calibration, "--no-show", "--out", out)
    assert outcome.code == 0
    record = record_of(out)
    live = record["live"]
    assert (record["state"], record["source"]["timestamps"]) == ("done", "wall clock")
    assert live["captured"] == 22
    assert live["captured"] == live["taken"] + live["dropped"]
    assert f"22 frames came, {live['taken']} were used, {live['dropped']} dropped" in outcome.out
    assert "source lost 0 times" in outcome.out
    assert f"results in {out}" in outcome.out
    assert len(rows_of(out)) == live["taken"] - 1
    assert not (out / "overlay.mp4").exists()  # only where it is asked for
    assert "latency" in outcome.err
    assert "source receiving" in outcome.err


def test_a_video_can_be_looped(
    farpoint: CommandLine, tmp_path: Path, video: Path, calibration: Path
):
    arguments = ("--camera", calibration, "--no-show", "--no-report", "--out", tmp_path / "out")
    outcome = farpoint("live", video, *arguments, "--loop", "--duration-s", "2")
    assert outcome.code == 0
    assert record_of(tmp_path / "out")["live"]["captured"] > 30


def test_ctrl_c_closes_all_files(tmp_path: Path, images: Pictures, calibration: Path):
    chunk = pytest.importorskip("rerun.chunk")
    shots, out = write_folder(tmp_path / "shots", there_and_back(images)), tmp_path / "out"
    rrd = tmp_path / "live.rrd"
    arguments = ("--camera", calibration, "--loop", "--no-show", "--rrd", rrd, "--out", out)
    process = start("live", shots, *arguments)
    wait_for_rows(out / "motions.csv", 5, process)
    process.send_signal(signal.SIGINT)
    said, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert told.splitlines()[-1] == "farpoint: interrupted; what was computed is in the outputs"
    assert "Traceback" not in told
    record = record_of(out)
    live = record["live"]
    assert record["state"] == "interrupted"
    assert f"{live['captured']} frames came, {live['taken']} were used" in said
    assert live["captured"] == live["taken"] + live["dropped"]
    motions, poses = read_motions(out / "motions.csv"), read_tum(out / "trajectory.tum")
    # A frame in hand when the signal came may be in one file and not in the next.
    assert 0 <= live["taken"] - 1 - len(motions) <= 1
    assert 0 <= len(motions) - (len(poses) - 1) <= 1
    shown = [part for part in chunk.RrdReader(rrd).stream() if part.entity_path == "/image"]
    assert 0 <= live["taken"] - live["not_drawn"] - sum(part.num_rows for part in shown) <= 1
    assert (out / "report.html").read_text().rstrip().endswith("</html>")


def test_a_wrong_calibration_costs_no_earlier_result(
    farpoint: CommandLine, tmp_path: Path, images: Pictures, calibration: Path
):
    shots, out = write_folder(tmp_path / "shots", [i[:100] for i in images]), tmp_path / "out"
    outcome = farpoint("live", shots, "--camera", calibration, "--no-show", "--out", out)
    assert_refused(outcome, calibration, "image size", "240x100")
    assert not out.exists()


def test_a_guessed_camera_is_reported(farpoint: CommandLine, tmp_path: Path, video: Path):
    out = tmp_path / "out"
    outcome = farpoint("live", video, "--fov", "67.4", "--no-show", "--out", out)
    assert outcome.code == 0
    (note,) = record_of(out)["notes"]
    assert note.startswith("Not calibrated: the camera is a guess: a field of view of 67.4 deg")
    assert f"farpoint: {note}" in outcome.err.splitlines()
    assert record_of(out)["camera"]["parameters"]["fx"] == pytest.approx(180.0, rel=1e-3)
    assert any(row["status"] == "OK" for row in rows_of(out))


def test_auto_takes_what_the_images_tell(farpoint: CommandLine, tmp_path: Path, images: Pictures):
    shots, out = write_phone_pictures(tmp_path / "phone", images[:3], 28), tmp_path / "out"
    outcome = farpoint("live", shots, "--camera", "auto", "--no-show", "--out", out)
    assert outcome.code == 0
    assert "28 mm in 35 mm equivalents, from EXIF" in record_of(out)["notes"][0]


def test_a_known_height_puts_the_files_in_metres(
    farpoint: CommandLine,
    tmp_path: Path,
    images: Pictures,
    calibration: Path,
    drive: RenderedSequence,
):
    video, out = (
        write_video(tmp_path / "slow.avi", there_and_back(images), fps=10),
        tmp_path / "out",
    )
    quick = ("--camera", calibration, "--no-show", "--no-report", "--out", out)
    assert farpoint("live", video, *quick, "--metric.height", HEIGHT_M).code == 0
    metric = record_of(out)["metric"]
    assert (metric["unit"], metric["contradictions"]) == ("m", [])
    places = there_and_back(drive.world_from_cam[:, :3, 3])
    frames = [int(row["frame1"]) for row in rows_of(out)]
    true = np.linalg.norm([places[frame] - places[0] for frame in frames], axis=1)
    found = np.linalg.norm(read_tum(out / "trajectory.tum").world_from_body[1:, :3, 3], axis=1)
    np.testing.assert_allclose(found, true, rtol=0.1, atol=0.3)


def test_what_is_black_in_the_mask_is_not_tracked(
    farpoint: CommandLine, tmp_path: Path, video: Path, calibration: Path, images: Pictures
):
    white = np.full_like(images[0], 255)
    upper = white.copy()
    upper[72:] = 0
    counts = []
    for mask, name in ((white, "white"), (upper, "upper")):
        (tmp_path / f"{name}.png").write_bytes(encoded(mask))
        quick = ("--camera", calibration, "--no-show", "--no-report", "--out", tmp_path / name)
        assert farpoint("live", video, *quick, "--mask", tmp_path / f"{name}.png").code == 0
        assert record_of(tmp_path / name)["options"]["mask"] == str(tmp_path / f"{name}.png")
        counts.append(np.median([int(row["tracks"]) for row in rows_of(tmp_path / name)]))
    assert counts[1] < 0.7 * counts[0]


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (("--mask", "mask.png"), ("mask.png", "240x144", "got 240x100")),
        (("--max-megapixels", "0.03"), ("delivers no picture",)),
        (("--max-megapixels", "-1"), ("max_megapixels", "-1")),
    ],
)
def test_what_does_not_fit_is_refused_before_the_folder_is_made(
    farpoint: CommandLine,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    images: Pictures,
    calibration: Path,
    option: tuple[str, str],
    words: tuple[str, ...],
):
    monkeypatch.chdir(tmp_path)
    shots, out = write_folder(tmp_path / "shots", images[:4]), tmp_path / "out"
    Path("mask.png").write_bytes(encoded(images[0][:100]))
    quick = ("--camera", calibration, "--no-show", "--out", out)
    assert_refused(farpoint("live", shots, *quick, *option), *words)
    assert not out.exists()


def test_playlists_are_followed_if_asked_for(
    farpoint: CommandLine, tmp_path: Path, video: Path, calibration: Path
):
    playlist, out = tmp_path / "list.ffconcat", tmp_path / "out"
    playlist.write_text(f"ffconcat version 1.0\nfile {video.name}\n")
    quick = ("--camera", calibration, "--no-show", "--no-report", "--out", out)
    assert_refused(farpoint("live", playlist, *quick), "is a playlist", "--follow-playlists")
    assert farpoint("live", playlist, *quick, "--follow-playlists").code == 0
    assert record_of(out)["live"]["captured"] == 22


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("missing.mp4",), ("missing.mp4", "no such file")),
        (("987",), ("no camera of index 987",)),
        (("0", "--duration-s", "0"), ("--duration-s", "more than 0")),
    ],
)
def test_what_cannot_be_watched_is_named(
    farpoint: CommandLine, calibration: Path, arguments: tuple[str, ...], words: tuple[str, ...]
):
    outcome = farpoint("live", *arguments, "--camera", calibration, "--no-show")
    assert_refused(outcome, *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), ("--camera: missing", "--fov DEG")),
        (("--camera", "auto"), ("--camera: a live source has no focal length", "--fov DEG")),
        (("--fov", "70", "--camera", "auto"), ("--fov", "not both")),
        (("--fov", "70", "--metric.height", "-1"), ("height", "-1")),
        (("--fov", "70", "--metric.height-sigma", "0"), ("--metric.height-sigma", "0")),
    ],
)
def test_a_lens_that_nobody_knows_is_refused_before_the_source_is_opened(
    farpoint: CommandLine, arguments: tuple[str, ...], words: tuple[str, ...]
):
    assert_refused(farpoint("live", "987", *arguments, "--no-show"), *words)
