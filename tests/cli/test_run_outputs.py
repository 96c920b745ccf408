"""What a run leaves behind, and says: the same for the same seed, byte for byte."""

from __future__ import annotations

import json
import re
from pathlib import Path

import av
import numpy as np
import pytest
from cli_kit import (
    HEIGHT,
    WIDTH,
    CommandLine,
    assert_refused,
    record_of,
    rows_of,
    statuses_of,
    write_folder,
    write_video,
)

from farpoint.sinks.motions import read_motions
from farpoint.synthetic.sequence import RenderedSequence
from farpoint.trajectory.files import read_tum

Pictures = tuple[np.ndarray, ...]

TRUE_PATH = '<polyline class="curve truth"'
FILES = {
    "motions.csv",
    "trajectory.tum",
    "trajectory.kitti",
    "positions.csv",
    "halves.csv",
    "overlay.mp4",
    "report.html",
    "run.json",
    "camera.yaml",
}


@pytest.fixture
def shots(tmp_path: Path, images: Pictures) -> Path:
    return write_folder(tmp_path / "drive" / "images", images)


def contents(folder: Path) -> dict[str, bytes | str]:
    """Every file of a run, without what the clock on the wall put into it."""
    files: dict[str, bytes | str] = {path.name: path.read_bytes() for path in folder.iterdir()}
    record = record_of(folder)
    del record["wall_clock"]
    files["run.json"] = json.dumps(record)
    return files


def test_a_run_writes_every_file_and_says_where(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path, images: Pictures
):
    out = tmp_path / "out"
    outcome = farpoint("run", shots, "--camera", calibration, "--out", out)
    assert outcome.code == 0
    assert {path.name for path in out.iterdir()} == FILES
    pairs = len(images) - 1
    assert outcome.out.splitlines() == [
        f"{pairs} pairs of frames: {pairs} OK, 0 ROTATION_ONLY, 0 STATIC, 0 FAILED",
        "time stamps: 10 frames a second, assumed",
        f"results in {out}",
    ]
    count = len(images)
    *meanwhile, last = outcome.err.splitlines()
    assert re.fullmatch(rf"{count}/{count} frames, [\d.]+/s", last)
    # On a busy machine it says in between how far it is.
    assert all(
        re.fullmatch(rf"\d+/{count} frames, [\d.]+/s, \d+ s left", each) for each in meanwhile
    )
    assert len(read_motions(out / "motions.csv")) == pairs
    assert len(read_tum(out / "trajectory.tum")) == len(images)
    record = record_of(out)
    assert record["state"] == "done"
    assert record["camera"]["size"] == [WIDTH, HEIGHT]
    assert record["source"]["timestamps"] == "10 frames a second, assumed"
    with av.open(str(out / "overlay.mp4")) as film:
        assert sum(1 for _ in film.decode(video=0)) == len(images)


def test_the_default_folder_is_named_after_the_sequence(
    farpoint: CommandLine,
    tmp_path: Path,
    shots: Path,
    calibration: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.chdir(tmp_path)
    outcome = farpoint("run", shots, "--camera", calibration, "--no-overlay", "--no-report")
    assert outcome.out.endswith(f"results in {Path('farpoint-out/drive')}\n")
    assert {path.name for path in Path("farpoint-out/drive").iterdir()} == FILES - {
        "overlay.mp4",
        "report.html",
    }


def test_the_same_seed_gives_the_same_files(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path
):
    runs = []
    for seed, out in ((5, tmp_path / "a"), (5, tmp_path / "b"), (6, tmp_path / "c")):
        farpoint("run", shots, "--camera", calibration, "--out", out, "--seed", str(seed))
        runs.append(contents(out))
    first, again, other = runs
    assert first == again
    assert first["motions.csv"] != other["motions.csv"]


def test_a_video_and_its_pictures_give_the_same_motions(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path, images: Pictures
):
    arguments = ("--camera", calibration, "--no-overlay", "--no-report", "--out")
    farpoint("run", shots, *arguments, tmp_path / "a")
    video = write_video(tmp_path / "drive.mp4", images)
    outcome = farpoint("run", video, *arguments, tmp_path / "b")
    assert "time stamps: video" in outcome.out
    of_images, of_video = (read_motions(tmp_path / name / "motions.csv") for name in "ab")
    np.testing.assert_allclose(of_video.timestamp1, of_images.timestamp1, atol=1e-9)
    turned = 2.0 * np.linalg.norm(of_video.quat_xyzw - of_images.quat_xyzw, axis=1)
    assert np.median(np.rad2deg(turned)) < 0.1  # what compression and its grey values change


def test_options_reach_the_estimator(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path
):
    arguments = ("run", shots, "--camera", calibration, "--no-overlay", "--no-report")
    options = ("--tracker.max-tracks", "40", "--pose.no-refine", "--fps", "25")
    assert farpoint(*arguments, *options, "--out", tmp_path / "few").code == 0
    rows = rows_of(tmp_path / "few")
    assert max(int(row["tracks"]) for row in rows) <= 40
    assert float(rows[0]["timestamp1"]) == 1 / 25
    odometry = record_of(tmp_path / "few")["options"]["odometry"]
    assert odometry["tracker"]["max_tracks"] == 40
    assert odometry["pose"]["refine"] is False


def test_a_run_is_evaluated_without_any_truth(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path, images: Pictures
):
    out, pairs = tmp_path / "out", len(images) - 1
    quick = ("--camera", calibration, "--out", out, "--no-overlay", "--no-report")
    farpoint("run", shots, *quick, "--halves-every", "2")
    table = farpoint("evaluate", out).out
    tested = (pairs + 1) // 2
    assert f"pairs {pairs} (0 with truth)" in table
    assert f"two halves of the matches, {tested} pairs: {tested} compared" in table
    assert "trajectory" not in table
    halves = json.loads(farpoint("evaluate", out, "--json").out)["halves"]
    assert halves["pose"]["count"] == tested
    assert halves["ratio"]["dof"] == 5 * tested
    # Rendered images and honest covariances: no half of a hundred matches is far off.
    assert 0.1 < halves["ratio"]["ratio"] < 4.0
    refused = farpoint("evaluate", out, "--pairs", tmp_path / "pairs.csv")
    assert refused.err == "farpoint: --pairs: errors pair by pair need --truth\n"
    refused = farpoint("evaluate", out, "--report")
    assert refused.err == "farpoint: --report: a true path in the report needs --truth\n"

    farpoint("run", shots, *quick, "--halves-every", "0")
    assert not (out / "halves.csv").exists()
    assert "halves" not in farpoint("evaluate", out).out


def test_a_run_is_evaluated_against_its_truth(
    farpoint: CommandLine,
    tmp_path: Path,
    shots: Path,
    calibration: Path,
    drive: RenderedSequence,
):
    out, truth, pairs = tmp_path / "out", tmp_path / "truth.tum", tmp_path / "pairs.csv"
    farpoint("run", shots, "--camera", calibration, "--out", out, "--no-overlay", "--no-report")
    drive.write_truth(truth)
    table = farpoint("evaluate", out, "--truth", truth, "--pairs", pairs, "--report")
    assert TRUE_PATH in (out / "report.html").read_text()
    assert (table.code, table.err) == (0, "")
    assert "rotation, deg" in table.out
    assert len(pairs.read_text().splitlines()) == len(statuses_of(out)) + 1
    figures = json.loads(farpoint("evaluate", out, "--truth", truth, "--json").out)
    assert np.rad2deg(figures["motions"]["rotation_rad"]["median"]) < 0.03
    assert np.rad2deg(figures["motions"]["direction_rad"]["median"]) < 0.4
    assert figures["trajectory"]["poses"] == len(statuses_of(out)) + 1
    assert np.rad2deg(figures["trajectory"]["rpe_rotation_rad"]["median"]) < 0.03
    # A car whose speed hardly changes: unit steps show the path.
    assert figures["trajectory"]["ate_sim3"]["rmse"] < 0.1


def test_the_demo_meets_its_truth(farpoint: CommandLine, tmp_path: Path):
    outcome = farpoint("demo", "--frames", "8", "--out", tmp_path / "demo")
    assert outcome.code == 0
    assert {path.name for path in (tmp_path / "demo").iterdir()} == {*FILES, "truth.tum"}
    assert statuses_of(tmp_path / "demo") == ["OK"] * 7
    assert TRUE_PATH in (tmp_path / "demo" / "report.html").read_text()
    last_words = outcome.out[outcome.out.index("\nOpen ") :]
    for name in ("overlay.mp4", "report.html", "motions.csv"):
        assert str(tmp_path / "demo" / name) in last_words
    medians = {
        line.split(",")[0]: float(line.split()[3])
        for line in outcome.out.splitlines()
        if re.match("(rotation|direction), deg", line)
    }
    assert medians["rotation"] < 0.02
    assert medians["direction"] < 0.2
    assert "report.html" in outcome.out


def test_the_demo_in_the_hand_tells_what_it_found_of_lens_and_shutter(
    farpoint: CommandLine, tmp_path: Path
):
    outcome = farpoint("demo", "--handheld", "--frames", "6", "--no-overlay", "--out", tmp_path)
    assert outcome.code == 0
    lens = json.loads((tmp_path / "run.json").read_text())["lens"]
    rows = {line[:12].strip(): line[12:].split() for line in outcome.out.splitlines()}
    given, found, sigma, true, _ = rows["fx"][-5:]
    assert (float(given), float(true)) == (525.0, 500.0)
    assert float(found) == pytest.approx(lens["found"]["fx"], rel=1e-4)
    assert float(sigma) == pytest.approx(lens["sigma"]["fx"], rel=0.1)
    given, found, sigma, true, _ = rows["read-out, ms"][-5:]
    assert (given, float(true)) == ("-", 23.333)
    assert float(found) == pytest.approx(1e3 * lens["readout_s"], rel=1e-4)
    assert float(sigma) == pytest.approx(1e3 * lens["readout_sigma_s"], rel=0.1)


def test_the_display_is_recorded_beside_the_outputs(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path, images: Pictures
):
    reader = pytest.importorskip("rerun.chunk").RrdReader
    rrd = tmp_path / "drive.rrd"
    arguments = ("--camera", calibration, "--no-overlay", "--no-report", "--rrd", rrd)
    assert farpoint("run", shots, *arguments, "--out", tmp_path / "with").code == 0
    parts = [part for part in reader(rrd).stream() if part.entity_path == "/image"]
    assert sum(part.num_rows for part in parts) == len(images)
    assert "viewer" in record_of(tmp_path / "with")["wall_clock"]["stages_s"]
    # The display changes nothing of what is computed.
    without = (*arguments[:-2], "--out", tmp_path / "without")
    assert farpoint("run", shots, *without).code == 0
    for name in ("motions.csv", "trajectory.tum"):
        written = [(tmp_path / out / name).read_bytes() for out in ("with", "without")]
        assert written[0] == written[1]


def test_a_display_that_cannot_be_had_replaces_nothing(
    farpoint: CommandLine, tmp_path: Path, shots: Path, calibration: Path
):
    out, rrd = tmp_path / "out", tmp_path / "missing" / "drive.rrd"
    outcome = farpoint("run", shots, "--camera", calibration, "--out", out, "--rrd", rrd)
    assert_refused(outcome, rrd, "cannot be written")
    assert not out.exists()
