"""Faults inside a stream: that pair has a status and a reason, and the run goes on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli_kit import (
    CAMERA,
    HEIGHT,
    NOT_AN_IMAGE,
    WIDTH,
    CommandLine,
    RunOver,
    encoded,
    record_of,
    rows_of,
    statuses_of,
    write_video,
)

from farpoint.synthetic.sequence import render_drive

Pictures = tuple[np.ndarray, ...]


def assert_goes_on(run_over: RunOver, images: list[np.ndarray | bytes], status: str, reason: str):
    """Frame 4 has a fault; every other frame is compared with the last good one."""
    outcome, out = run_over(images)
    assert outcome.code == 0
    assert statuses_of(out) == ["OK"] * 3 + [status] + ["OK"] * (len(images) - 5)
    (told,) = record_of(out)["reasons"]
    assert (told["frame0"], told["frame1"], told["status"]) == (3, 4, status)
    assert reason in told["reason"]
    assert f"{len(images) - 2} OK" in outcome.out
    assert len((out / "trajectory.tum").read_text().splitlines()) == len(images)


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (np.zeros((HEIGHT, WIDTH), np.uint8), "shows nothing to track"),
        (np.full((HEIGHT, WIDTH), 255, np.uint8), "shows nothing to track"),
        (np.full((48, 80), 90, np.uint8), "is 80x48, the sequence 240x144"),
        (NOT_AN_IMAGE, "cannot be decoded as an image"),
        (b"", "the file is empty"),
    ],
    ids=["black", "white", "other-size", "no-image", "empty-file"],
)
def test_a_bad_frame_costs_its_own_pair(
    run_over: RunOver, images: Pictures, fault: np.ndarray | bytes, reason: str
):
    # Put in, not put in place of another: its neighbours can be compared with each other.
    assert_goes_on(run_over, [*images[:4], fault, *images[4:]], "FAILED", reason)


def test_a_truncated_image_costs_its_own_pair(run_over: RunOver, images: Pictures):
    half = encoded(images[4])[: len(encoded(images[4])) // 2]
    assert_goes_on(run_over, [*images[:4], half, *images[4:]], "FAILED", "PNG is truncated")


def test_a_frozen_frame_is_a_camera_that_stands(run_over: RunOver, images: Pictures):
    assert_goes_on(run_over, [*images[:4], *images[3:]], "STATIC", "")


def test_the_size_may_change_for_good(run_over: RunOver, images: Pictures):
    small = [image[::2, ::2] for image in images[4:]]
    outcome, out = run_over([*images[:4], *small])
    assert outcome.code == 0
    assert statuses_of(out) == ["OK"] * 3 + ["FAILED"] * len(small)
    assert {(row["frame0"], row["frame1"]) for row in rows_of(out)[3:]} == {
        ("3", str(4 + number)) for number in range(len(small))
    }


def test_after_a_cut_the_motion_is_found_again(run_over: RunOver, images: Pictures):
    elsewhere = [frame.image for frame in render_drive(CAMERA, frames=4, seed=8)]
    outcome, out = run_over([*images[:4], *(image for image in elsewhere if image is not None)])
    assert outcome.code == 0
    assert statuses_of(out) == ["OK"] * 3 + ["FAILED"] + ["OK"] * 3
    (told,) = record_of(out)["reasons"]
    assert (told["frame0"], told["frame1"]) == (3, 4)
    assert told["reason"].endswith(".")


@pytest.mark.parametrize("first", [NOT_AN_IMAGE, np.zeros((HEIGHT, WIDTH), np.uint8)])
def test_a_run_may_begin_with_a_bad_frame(
    run_over: RunOver, images: Pictures, first: np.ndarray | bytes
):
    outcome, out = run_over([first, *images[:4]])
    assert outcome.code == 0
    assert statuses_of(out) == ["FAILED"] + ["OK"] * 3


def test_the_first_image_fixes_the_size_even_if_it_is_black(run_over: RunOver, images: Pictures):
    black, other = np.zeros((HEIGHT, WIDTH), np.uint8), np.full((48, 80), 90, np.uint8)
    outcome, out = run_over([black, other, *images[:3]])
    assert outcome.code == 0
    assert statuses_of(out) == ["FAILED"] * 2 + ["OK"] * 2
    assert "is 80x48" in record_of(out)["reasons"][1]["reason"]


def test_a_truncated_video_is_read_as_far_as_it_goes(
    tmp_path: Path, images: Pictures, calibration: Path, farpoint: CommandLine
):
    video = write_video(tmp_path / "drive.avi", images)
    video.write_bytes(video.read_bytes()[: int(0.6 * video.stat().st_size)])
    out = tmp_path / "out"
    outcome = farpoint("run", video, "--camera", calibration, "--out", out)
    assert outcome.code == 0
    statuses = statuses_of(out)
    assert 4 <= len(statuses) < len(images)
    assert statuses[:3] == ["OK"] * 3
    assert statuses[-1] == "FAILED"
    assert "the video ends at" in record_of(out)["reasons"][-1]["reason"]
    assert "Traceback" not in outcome.err


def test_damage_in_the_middle_of_a_video_costs_few_pairs(
    tmp_path: Path, images: Pictures, calibration: Path, farpoint: CommandLine
):
    video = write_video(tmp_path / "drive.avi", images)
    data = bytearray(video.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 2000] = bytes(2000)
    video.write_bytes(data)
    out = tmp_path / "out"
    outcome = farpoint("run", video, "--camera", calibration, "--out", out, "--no-report")
    assert outcome.code == 0
    statuses = statuses_of(out)
    # A packet whose head is gone is not even missed.
    assert len(images) - 3 <= len(statuses) < len(images)
    assert "FAILED" in statuses
    assert statuses.count("OK") >= len(images) - 5
    assert statuses[-1] == "OK"
    assert all("decode" in told["reason"] for told in record_of(out)["reasons"])
