"""Likelihood of residuals for each floor of their variance."""

from __future__ import annotations

import numpy as np
import scipy

from farpoint._kernels.noise_floor import floor_likelihoods


def test_it_is_the_maximum_over_the_common_factor_of_students_distribution():
    rng = np.random.default_rng(0)
    variances = rng.uniform(0.2, 3.0, 60)
    residuals = np.sqrt(0.7 * (variances + 0.5)) * rng.standard_t(5.0, 60)
    floors = np.array([0.0, 0.5, 4.0])
    found = floor_likelihoods(residuals**2, variances, floors, 5.0, 60)

    def kth_largest(floor: float) -> float:
        def cost(log_factor: float) -> float:
            scale = np.sqrt(np.exp(log_factor) * (variances + floor))
            return -float(np.sum(scipy.stats.t.logpdf(residuals, 5.0, scale=scale)))

        return -float(scipy.optimize.minimize_scalar(cost).fun)

    expected = np.array([kth_largest(floor) for floor in floors])
    # Up to the constant of the density, which does not depend on the floor.
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-3)
