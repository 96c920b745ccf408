"""Cameras that are given wrong are wrong by what was asked for, whatever the lens."""

from __future__ import annotations

import numpy as np
import pytest
from lens_collection import LENSES

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.synthetic import Miscalibration

CALIBRATED = [name for name, model in LENSES.items() if model.roles.scale]


@pytest.mark.parametrize("name", CALIBRATED)
def test_the_image_is_larger_about_its_centre_by_the_error_of_the_focal_length(name: str):
    true = Camera(model=LENSES[name], size=(640, 480))
    given = Miscalibration(focal_share=0.02).of(true)
    axis = np.array([[0.0, 0.0, 1.0], [1e-3, 2e-3, 1.0], [-2e-3, 1e-3, 1.0]])
    for_true, for_given = true.project(axis), given.project(axis)
    growth = np.linalg.norm(for_given[1:] - for_given[0]) / np.linalg.norm(
        for_true[1:] - for_true[0]
    )
    assert growth == pytest.approx(1.02, abs=2e-3)
    assert given.size == true.size
    assert given.uncertainty is None


@pytest.mark.parametrize("name", CALIBRATED)
def test_the_centre_moves_and_the_corners_are_distorted(name: str):
    true = Camera(model=LENSES[name], size=(640, 480))
    axis = np.array([[0.0, 0.0, 1.0]])
    moved = Miscalibration(center_px=(3.0, -2.0)).of(true).project(axis) - true.project(axis)
    np.testing.assert_allclose(moved, [[3.0, -2.0]], atol=1e-6)
    if not true.refinable.roles.radial:
        return
    distorted = [Miscalibration(distortion_px=1.0, seed=seed).of(true) for seed in range(8)]
    rays = true.unproject(np.array([[80.0, 60.0], [560.0, 420.0], [560.0, 60.0], [320.0, 240.0]]))
    change = np.array([camera.project(rays) - true.project(rays) for camera in distorted])
    size = np.sqrt(np.nanmean(np.sum(change**2, axis=2), axis=0))
    assert 0.02 < size[:3].mean() < 3.0
    assert size[3] < size[:3].mean()


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("focal_share", {"focal_share": 0.7}),
        ("distortion_px", {"distortion_px": -1.0}),
        ("center_px", {"center_px": (1.0, float("nan"))}),
        ("center_px", {"center_px": 3.0}),
        ("seed", {"seed": -1}),
    ],
)
def test_what_makes_no_error_says_why(field: str, values: dict):
    with pytest.raises(InputError) as error:
        Miscalibration(**values)
    assert error.value.field == field
