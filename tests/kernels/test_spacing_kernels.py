"""Places accepted in their order, none within reach of another."""

from __future__ import annotations

import numpy as np

from farpoint.tracks.kernels.spacing import cover, take_places

REACH = 3


def taken_slowly(places: np.ndarray, free: np.ndarray, limit: int) -> list[int]:
    """The same by comparing every place with those accepted before."""
    kept: list[int] = []
    for index, place in enumerate(places):
        apart = all(np.abs(place - places[k]).max() > REACH for k in kept)
        if len(kept) < limit and apart and free[place[1], place[0]]:
            kept.append(index)
    return kept


def test_places_are_those_that_comparing_all_would_take() -> None:
    rng = np.random.default_rng(0)
    places = rng.integers(0, [40, 30], (200, 2))
    free = rng.random((30, 40)) > 0.2
    for limit in (0, 7, 1000):
        taken, kept = ~free, np.empty(200, np.int64)
        count = take_places(places, taken, REACH, limit, kept)
        assert kept[:count].tolist() == taken_slowly(places, free, limit)


def test_what_is_taken_stays_taken_up_to_the_border() -> None:
    taken = np.zeros((6, 8), bool)
    kept = np.empty(1, np.int64)
    assert take_places(np.array([[7, 0]]), taken, 2, 5, kept) == 1
    expected = np.zeros((6, 8), bool)
    expected[:3, 5:] = True
    np.testing.assert_array_equal(taken, expected)
    assert take_places(np.array([[5, 2]]), taken, 2, 5, kept) == 0


def test_every_place_that_is_covered_takes_its_surroundings() -> None:
    rng = np.random.default_rng(1)
    places, taken = rng.integers(0, [40, 30], (12, 2)), np.zeros((30, 40), bool)
    taken[0, 0] = True
    cover(places, taken, REACH)
    rows, columns = np.indices(taken.shape)
    apart = np.abs(np.stack([columns, rows], axis=-1)[:, :, None] - places).max(axis=-1)
    expected = apart.min(axis=-1) <= REACH
    expected[0, 0] = True
    np.testing.assert_array_equal(taken, expected)
