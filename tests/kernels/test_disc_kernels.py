"""Discs: position, size, anti-aliased rim, clipping at the border."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.sinks.kernels.discs import draw_discs

GREEN = (10, 200, 60)


@pytest.mark.parametrize("centre", [(20.0, 15.0), (20.37, 14.81)])
@pytest.mark.parametrize("radius", [1.3, 2.6, 6.0])
def test_a_disc_has_its_area_and_its_middle(centre: tuple[float, float], radius: float) -> None:
    picture = np.zeros((32, 40, 3), np.uint8)
    draw_discs(picture, np.array([centre]), radius, (255, 255, 255))
    cover = picture[..., 0] / 255.0
    assert cover.sum() == pytest.approx(np.pi * radius**2, abs=0.6)
    rows, columns = np.indices(cover.shape)
    middle = np.array([(columns * cover).sum(), (rows * cover).sum()]) / cover.sum()
    np.testing.assert_allclose(middle, centre, atol=0.03)


def test_a_disc_covers_what_was_there_and_leaves_the_rest() -> None:
    picture = np.full((20, 20, 3), 90, np.uint8)
    draw_discs(picture, np.array([[9.0, 9.0]]), 3.0, GREEN)
    assert tuple(picture[9, 9]) == GREEN
    assert tuple(picture[9, 12]) == (50, 145, 75)  # on the rim: half of each
    assert tuple(picture[9, 13]) == (90, 90, 90)


def test_discs_are_cut_at_the_border_of_a_pane() -> None:
    picture = np.zeros((20, 40, 3), np.uint8)
    pane = picture[5:15, 10:30]
    centres = np.array([[0.0, 0.0], [19.0, 9.0], [-50.0, 4.0], [1e4, -1e4]])
    draw_discs(pane, centres, 4.0, GREEN)
    assert tuple(pane[0, 0]) == tuple(pane[9, 19]) == GREEN
    picture[5:15, 10:30] = 0
    assert not picture.any()
