"""The fold of a distortion: where its derivative is bounded, no circle has to be looked at."""

from __future__ import annotations

import numpy as np

from farpoint.camera.radtan import RadialTangential


def made(seed: int) -> RadialTangential:
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=rng.choice([4, 5, 8, 12])) * 10.0 ** rng.uniform(-4.0, 0.0)
    coefficients[2:4] *= 10.0 ** rng.uniform(-3.0, 0.0)
    return RadialTangential(tuple(coefficients))


def test_where_the_bound_holds_the_determinant_is_positive():
    radii, azimuths, sure = np.geomspace(0.01, 20.0, 60), np.linspace(0.0, 2.0 * np.pi, 91), 0
    for seed in range(300):
        lens = made(seed)
        within = radii[radii < lens._radial_fold]
        surely = within[lens._surely_keeps_orientation(within)]
        x, y = (np.multiply.outer(surely, f(azimuths)) for f in (np.cos, np.sin))
        assert (lens.derivatives(x, y).determinant > 0.0).all()
        sure += len(surely)
    assert sure > 5000  # the bound is worth something


def test_the_fold_is_the_first_circle_that_turns_over_somewhere():
    folding = [lens for lens in map(made, range(20)) if lens.fold < 1e3]
    assert len(folding) > 12
    azimuths = np.linspace(0.0, 2.0 * np.pi, 361)
    for lens in folding:
        radii = lens.fold * np.array([0.5, 0.9, 0.99, 0.998, 1.02])
        x, y = (np.multiply.outer(radii, f(azimuths)) for f in (np.cos, np.sin))
        keeps = (lens.derivatives(x, y).determinant > 0.0).all(axis=1)
        np.testing.assert_array_equal(keeps, [True] * 4 + [False])
