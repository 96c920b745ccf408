"""A hand moves smoothly, as far and as fast as it was told to."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.errors import InputError
from farpoint.geometry import so3
from farpoint.synthetic import HandheldOptions, handheld_walk


def test_the_walk_keeps_its_pace_and_its_height():
    walk = handheld_walk(301, seed=3)
    position = walk.world_from_body[:, :3, 3]
    assert position[-1, 2] - position[0, 2] == pytest.approx(13.0, abs=0.05)
    assert np.ptp(position[:, 1]) == pytest.approx(0.04, abs=0.002)
    assert np.ptp(position[:, 0]) == pytest.approx(0.04, abs=0.002)


def test_turns_stay_within_their_amplitudes_and_have_no_jumps():
    options = HandheldOptions(look_deg=20.0, tremor_deg=1.0)
    walk = handheld_walk(3001, fps=300.0, seed=4, options=options)
    forward = walk.world_from_body[:, :3, 2]
    yaw = np.degrees(np.arctan2(forward[:, 0], forward[:, 2]))
    assert 10.0 < np.ptp(yaw) < 42.5
    turns = walk.world_from_body[:, :3, :3]
    rate = 300.0 * so3.log(np.swapaxes(turns[:-1], 1, 2) @ turns[1:])
    assert 5.0 < np.degrees(np.linalg.norm(rate, axis=1)).max() < 150.0
    # Between neighbours the rate changes by no more than 6 Hz can.
    assert np.degrees(np.abs(np.diff(rate, axis=0))).max() < 20.0


def test_standing_without_a_tremor_is_standing_still():
    options = HandheldOptions(speed_m_s=0.0, bob_m=0.0, look_deg=0.0, tremor_deg=0.0)
    walk = handheld_walk(5, options=options)
    np.testing.assert_array_equal(walk.world_from_body[4], walk.world_from_body[0])


def test_seeds_are_other_walks_and_the_same_seed_the_same():
    first, again, other = (handheld_walk(30, seed=seed).world_from_body for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.01


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("frames", lambda: handheld_walk(0)),
        ("fps", lambda: handheld_walk(5, fps=0.0)),
        ("seed", lambda: handheld_walk(5, seed=-1)),
        ("speed_m_s", lambda: HandheldOptions(speed_m_s=9.0)),
        ("step_hz", lambda: HandheldOptions(step_hz=0.0)),
        ("bob_m", lambda: HandheldOptions(bob_m=-0.1)),
        ("look_deg", lambda: HandheldOptions(look_deg=float("nan"))),
        ("tremor_deg", lambda: HandheldOptions(tremor_deg=6.0)),
    ],
)
def test_what_is_no_walk_says_why(field, make):
    with pytest.raises(InputError) as error:
        make()
    assert error.value.field == field
