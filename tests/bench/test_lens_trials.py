"""Lenses that were calibrated wrong are found as surely as stated; the table of them."""

from __future__ import annotations

import numpy as np
import pytest
from bench_kit import silent

from farpoint.bench.lens_trials import LensTrial, calibrated_wrong, try_lens
from farpoint.bench.options import BenchOptions
from farpoint.bench.path_samples import joined
from farpoint.bench.tables import lens as table_of_lenses
from farpoint.camera import Camera, DoubleSphere, KannalaBrandt
from farpoint.metrics import evaluate_path
from farpoint.path.options import LensRefinementOptions

CENTRE = {"cx": 319.5, "cy": 239.5}
FISHEYE = Camera(
    model=KannalaBrandt(fx=300.0, fy=300.0, **CENTRE, k1=0.01, k2=-0.005), size=(640, 480)
)
DOUBLE_SPHERE = Camera(
    model=DoubleSphere(fx=250.0, fy=250.0, **CENTRE, xi=-0.2, alpha=0.6), size=(640, 480)
)
PRIOR = LensRefinementOptions()


def parameters(camera: Camera) -> np.ndarray:
    return np.array(list(camera.refinable.parameters.values()))


def test_calibrations_are_off_by_as_much_as_they_say():
    rng = np.random.default_rng(3)
    given = [calibrated_wrong(FISHEYE, "drawn", rng, PRIOR) for _ in range(300)]
    off = np.array([parameters(camera) - parameters(FISHEYE) for camera in given])
    inverse = np.linalg.pinv(given[0].parameter_factor)
    nees = np.sum((off @ inverse.T) ** 2, axis=1)
    assert np.mean(nees) == pytest.approx(given[0].parameter_factor.shape[1], rel=0.15)


def test_two_sigmas_are_those_of_the_focal_length_alone():
    given = calibrated_wrong(FISHEYE, "two sigmas", np.random.default_rng(0), PRIOR)
    off = parameters(given) - parameters(FISHEYE)
    assert np.abs(off[:2]) == pytest.approx(2.0 * PRIOR.focal_sigma * 300.0)
    assert off[2:] == pytest.approx(0.0)
    assert given.parameter_sigmas()["fx"] == pytest.approx(PRIOR.focal_sigma * 300.0)


@pytest.fixture(scope="module")
def trials() -> list[LensTrial]:
    return [
        try_lens(camera, error, seed=seed)
        for seed, (camera, error) in enumerate(
            [
                (FISHEYE, "drawn"),
                (FISHEYE, "two sigmas"),
                (DOUBLE_SPHERE, "drawn"),
                (DOUBLE_SPHERE, "two sigmas"),
            ]
        )
    ]


def test_lens_and_shutter_are_found_within_their_sigmas(trials: list[LensTrial]):
    z = np.abs([value for trial in trials for value in trial.parameters.values()])
    assert np.mean(z < 1.96) >= 0.9
    # Sigmas of a third would not hold them.
    assert np.mean(3.0 * z < 1.96) < 0.9
    assert np.mean([trial.nees for trial in trials]) < 2.0
    assert np.sqrt(np.mean([trial.readout**2 for trial in trials])) < 1.8


def test_orientation_and_scale_of_the_path_are_as_sure_as_they_say(trials: list[LensTrial]):
    path = evaluate_path(joined([trial.path for trial in trials]))
    assert path is not None
    assert path.pose.segments == len(trials)
    assert path.orientation.mean_nees < path.orientation.nees_high
    assert path.scale.mean_nees < path.scale.nees_high


def test_the_table_has_a_row_for_each_lens_and_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(table_of_lenses, "_LENSES", (("fisheye", FISHEYE.model),))
    monkeypatch.setattr("farpoint.bench.lens_trials._FRAMES", 12)
    options = BenchOptions(tables=("lens",), pairs=1)
    *_, table = table_of_lenses.lens_table(options, silent)
    names = [column.name for column in table.columns]
    rows = [dict(zip(names, row, strict=True)) for row in table.rows]
    assert [(row["lens"], row["error"]) for row in rows] == [
        ("fisheye", "drawn"),
        ("fisheye", "two sigmas"),
        ("all together", "drawn"),
        ("all together", "two sigmas"),
    ]
    assert all(0.0 <= row["parameters_95"] <= 1.0 for row in rows)
    assert all(row["lens_nees"] > 0.0 for row in rows)
