"""A court of walls with windows: one window is taken for the next."""

from __future__ import annotations

import numpy as np
import pytest
from pose_kit import estimate, rotation_error

from farpoint import PoseStatus
from farpoint.synthetic.pairs import court


@pytest.mark.parametrize(("matches", "repeated"), [(150, 0.4), (250, 0.45), (500, 0.45)])
def test_a_window_taken_for_the_next_is_a_wrong_match(matches, repeated):
    # With wrong matches anywhere, a pose between right and repeated ones, with more noise, is the
    # likelier: 6 to 12 of 40 are off by more than a degree.
    off_deg = []
    for seed in range(30):
        scene = court(seed, matches=matches, repeated=repeated)
        pose = estimate(scene)
        assert pose.status is PoseStatus.OK
        off_deg.append(
            np.degrees(np.linalg.norm(rotation_error(pose, scene.rotation_cam1_from_cam0)))
        )
    assert max(off_deg) < 1.0
    assert np.median(off_deg) < 0.12
