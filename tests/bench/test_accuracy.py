from __future__ import annotations

import math

import numpy as np
import pytest
from bench_kit import estimator_of, silent, some_views

from farpoint.bench.accuracy import Errors, bound_ratios, errors_of, ratio_cells
from farpoint.bench.interleaved import EstimatorRun
from farpoint.bench.views import TwoViews
from farpoint.geometry import so3, sphere

TRUTH = some_views(1)[0]


def course_of(rotations: np.ndarray, directions: np.ndarray) -> EstimatorRun:
    return EstimatorRun(
        estimator=estimator_of("any", silent),
        rotations=rotations,
        directions=directions,
        seconds=np.zeros(len(rotations)),
        first_seconds=np.zeros(len(rotations)),
    )


def off_by(dtheta: np.ndarray, dbeta: np.ndarray) -> EstimatorRun:
    """Answers that differ from the truth by these errors (V, 3) and (V, 2)."""
    direction = sphere.normalize(TRUTH.translation_cam1_from_cam0)
    basis = sphere.tangent_basis(direction)
    return course_of(
        so3.exp(dtheta) @ TRUTH.rotation_cam1_from_cam0,
        np.array([sphere.retract(direction, basis, step) for step in dbeta]),
    )


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_errors_as_large_as_the_bound_have_ratio_one(factor: float):
    rng = np.random.default_rng(3)
    root = rng.normal(0.0, 1e-3, (5, 5))
    bound = root @ root.T
    n = 20000
    errors = factor * rng.multivariate_normal(np.zeros(5), bound, n)
    run = off_by(errors[:, :3], errors[:, 3:])
    ratios = bound_ratios(run, [TRUTH] * n, np.broadcast_to(bound, (n, 5, 5)))
    assert ratios == pytest.approx((factor, factor), rel=0.02)


def test_missing_answers_count_as_infinitely_wrong():
    run = off_by(np.full((5, 3), 1e-4), np.full((5, 2), 1e-4))
    run.rotations[:3] = np.nan
    run.directions[:2] = np.nan
    rotation, direction = bound_ratios(run, [TRUTH] * 5, np.array([np.eye(5) * 1e-8] * 5))
    assert math.isinf(rotation)
    assert direction < 2.0


def test_errors_are_angles_to_the_truth():
    run = off_by(np.array([[0.0, 0.02, 0.0]]), np.array([[math.tan(0.1), 0.0]]))
    errors = errors_of(run, [TRUTH])
    assert errors.rotation_deg[0] == pytest.approx(math.degrees(0.02))
    assert errors.direction_deg[0] == pytest.approx(math.degrees(0.1))
    # R_true = Exp(dtheta) @ R_est: what the truth is off the estimate.
    np.testing.assert_allclose(errors.dtheta_rad[0], [0.0, -0.02, 0.0], atol=1e-12)


def test_failures_silence_and_gross_errors_are_counted_apart():
    run = off_by(
        np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0.05], [0, 0, 0]], dtype=float),
        np.array([[0, 0], [0, 0], [0, 0], [1.0, 0]], dtype=float),
    )
    run.rotations[0] = run.directions[0] = np.nan
    run.directions[1] = np.nan
    errors = errors_of(run, [TRUTH] * 4)
    assert (errors.failed, errors.undecided, errors.gross) == (1, 1, 2)


def test_short_true_translations_have_no_direction():
    short = TwoViews(
        camera=TRUTH.camera,
        points0=TRUTH.points0,
        points1=TRUTH.points1,
        rotation_cam1_from_cam0=TRUTH.rotation_cam1_from_cam0,
        translation_cam1_from_cam0=np.array([0.004, 0.0, 0.0]),
    )
    run = off_by(np.zeros((1, 3)), np.zeros((1, 2)))
    errors = errors_of(run, [short], min_translation=0.005)
    assert np.isnan(errors.direction_deg[0])
    assert errors.undecided == 0
    assert not np.isnan(errors_of(run, [short], min_translation=0.003).direction_deg[0])


def turned_by(angles_deg: np.ndarray) -> Errors:
    """Errors of rotation of so many degrees; NaN for no answer."""
    dtheta = np.zeros((len(angles_deg), 3))
    dtheta[:, 1] = np.radians(angles_deg)
    return errors_of(off_by(dtheta, np.zeros((len(angles_deg), 2))), [TRUTH] * len(angles_deg))


def test_a_ratio_of_means_is_of_the_pairs_that_both_answered():
    one, other = (
        turned_by(np.array([1.0, 2.0, np.nan, 9.0])),
        turned_by(np.array([2.0, 4.0, 8.0, np.nan])),
    )
    assert ratio_cells(one, other) == pytest.approx((0.5, 0.5, 0.5))
    assert ratio_cells(one, one) == pytest.approx((1.0, 1.0, 1.0))
    assert all(math.isnan(cell) for cell in ratio_cells(turned_by(np.full(4, np.nan)), other))


@pytest.mark.parametrize("true_ratio", [1.0, 1.6])
def test_nineteen_of_twenty_intervals_hold_the_ratio_of_the_means(true_ratio: float):
    rng = np.random.default_rng(8)
    held, trials = 0, 400
    for _ in range(trials):
        # Most of an error is of the pair itself, whichever estimator it is.
        shared = rng.gamma(2.0, 0.1, 60)
        one = shared * rng.gamma(4.0, true_ratio / 4.0, 60)
        other = shared * rng.gamma(4.0, 0.25, 60)
        _, low, high = ratio_cells(turned_by(one), turned_by(other))
        held += low <= true_ratio <= high
    assert 0.91 <= held / trials <= 0.98
