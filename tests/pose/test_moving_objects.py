"""One compact object that moves by itself, before a camera that moves or does not."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import estimate

from farpoint import PoseStatus
from farpoint.pose.one_object import is_one_object
from farpoint.synthetic.pairs import HardPair, crossing
from farpoint.synthetic.pairs.pair import vga_camera


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
def test_a_camera_at_rest_has_no_sure_direction(share):
    poses = [estimate(crossing(seed, share=share, at_rest=True)) for seed in range(30)]
    assert sum(pose.status is PoseStatus.OK for pose in poses) <= 2


def wrong_directions(scenes: list[HardPair]) -> int:
    """How many are off by more than 10 degrees."""
    count = 0
    for scene in scenes:
        direction, t = estimate(scene).direction_cam1_from_cam0, scene.translation_cam1_from_cam0
        if direction is not None:
            cosine = float(direction @ t) / float(np.linalg.norm(t))
            count += cosine < np.cos(np.radians(10.0))
    return count


@pytest.mark.parametrize(("share", "most"), [(0.2, 1), (0.4, 12)])
def test_hardly_any_direction_is_that_of_a_crossing_object(share, most):
    """Of a single motion, 25 of 40 are with 0.4 of the matches."""
    assert (
        wrong_directions([crossing(seed, share=share, at_rest=False) for seed in range(40)]) <= most
    )


def test_near_points_all_over_the_image_are_no_object():
    rng = np.random.default_rng(0)
    rays = vga_camera().unproject(rng.uniform((0, 0), vga_camera().size, (200, 2)))
    labels = np.where(rng.uniform(size=200) < 0.1, 2, 1).astype(np.uint8)
    assert not is_one_object(rays, labels)
    together = np.argsort(np.linalg.norm(rays - rays[7], axis=1))[:20]
    labels = np.ones(200, np.uint8)
    labels[together] = 2
    assert is_one_object(rays, labels)
    # Far points between them are seen past no object.
    labels[together[::2]] = 1
    assert not is_one_object(rays, labels)
    assert not is_one_object(rays, np.full(200, 2, np.uint8))
    assert not is_one_object(rays, np.zeros(200, np.uint8))
