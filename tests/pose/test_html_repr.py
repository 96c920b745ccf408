"""What a notebook shows of a pose and of a result."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from pose_kit import estimate, point_scene

import farpoint as fp
from farpoint.geometry import so3


class Cells(HTMLParser):
    """The words of each cell, and the tags that were left open."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        del attrs
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def cells(shown: object) -> dict[str, str]:
    """Title and rows of a card."""
    parser = Cells(shown._repr_html_())  # type: ignore[attr-defined]
    assert parser.open == []
    title, *words = parser.words
    return {"title": title, **dict(zip(words[::2], words[1::2], strict=True))}


@pytest.fixture(scope="module")
def pose() -> fp.RelativePose:
    return estimate(point_scene(1))


def test_a_pose_shows_its_numbers_with_their_sigma(pose: fp.RelativePose):
    card = cells(pose)
    assert card["title"] == "RelativePose: OK"
    assert card["reason"] == pose.reason
    assert pose.rotation_cam1_from_cam0 is not None
    x, y, z = np.rad2deg(so3.log(pose.rotation_cam1_from_cam0))
    for value in (x, y, z):
        assert f"{value:+.4f} \N{PLUS-MINUS SIGN} " in card["rotation x, y, z"]
    assert pose.heading_cam0 is not None
    right = np.rad2deg(np.arctan2(pose.heading_cam0[0], pose.heading_cam0[2]))
    assert card["heading right, up"].startswith(f"{right:+.3f} ")
    assert card["matches"].startswith(f"{pose.stats.matches}: {pose.stats.far} far")


def test_what_is_not_there_is_not_shown():
    failed = fp.estimate_relative_pose(np.empty((0, 2)), np.empty((0, 2)), point_scene(1).camera)
    card = cells(failed)
    assert card["title"] == "RelativePose: FAILED"
    assert set(card) == {"title", "reason", "matches"}


def test_words_cannot_break_the_page(pose: fp.RelativePose):
    assert cells(replace(pose, reason="<b>&"))["reason"] == "<b>&"


def test_a_result_shows_frames_times_and_motion(pose: fp.RelativePose):
    odometry = fp.Odometry(point_scene(1).camera)
    first = odometry.process(None, 3.25, fault="none")
    result = replace(first, pose=pose, frame1=7)
    card = cells(result)
    assert card["title"] == "OdometryResult: OK"
    assert card["frames"] == "0 to 7"
    assert card["times"] == "3.250 s to 3.250 s"
    assert card["reason"] == pose.reason
    assert cells(replace(result, pose=None))["title"] == "OdometryResult: first frame"
