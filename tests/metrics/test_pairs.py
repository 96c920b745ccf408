"""Errors of motions, held against the definitions they solve."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from farpoint.errors import InputError
from farpoint.geometry import so3, sphere
from farpoint.metrics import (
    binomial_interval,
    direction_error,
    evaluate_motions,
    pair_errors,
    relative_motions,
    rotation_error,
)
from farpoint.pose import PoseStatus


def unit(rng: np.random.Generator, count: int) -> np.ndarray:
    return sphere.normalize(rng.normal(size=(count, 3)))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), size=st.floats(1e-9, 3.0))
def test_rotation_error_is_the_left_perturbation(seed: int, size: float):
    rng = np.random.default_rng(seed)
    R_est = so3.exp(rng.normal(size=(4, 3)))
    dtheta = size * unit(rng, 4)
    measured = rotation_error(R_est, so3.exp(dtheta) @ R_est)
    np.testing.assert_allclose(measured, dtheta, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), size=st.floats(0.0, 20.0))
def test_direction_error_inverts_the_retraction(seed: int, size: float):
    rng = np.random.default_rng(seed)
    direction = unit(rng, 1)
    basis = sphere.tangent_basis(direction)
    dbeta = size * sphere.normalize(rng.normal(size=2))
    true = sphere.retract(direction[0], basis[0], dbeta)
    measured = direction_error(direction, basis, true[None])[0]
    np.testing.assert_allclose(measured, dbeta, rtol=1e-9, atol=1e-12)


def test_an_opposed_direction_is_infinitely_wrong():
    direction = np.array([[0.0, 0.0, 1.0]] * 3)
    true = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [np.nan] * 3])
    measured = direction_error(direction, sphere.tangent_basis(direction), true)
    assert np.isinf(measured[:2]).all()
    assert np.isnan(measured[2]).all()


def test_relative_motions_satisfy_the_two_view_model():
    rng = np.random.default_rng(5)
    poses = np.tile(np.eye(4), (2, 6, 1, 1))
    poses[..., :3, :3] = so3.exp(rng.normal(size=(2, 6, 3)))
    poses[..., :3, 3] = rng.normal(size=(2, 6, 3))
    rotations, translations = relative_motions(poses[0], poses[1])
    X_world = rng.normal(size=3)
    for k in range(6):
        X_cam0, X_cam1 = (np.linalg.solve(view[k], [*X_world, 1.0])[:3] for view in poses)
        np.testing.assert_allclose(X_cam1, rotations[k] @ X_cam0 + translations[k], atol=1e-12)


def simulated(count: int, sigma_factor: float = 1.0, seed: int = 0) -> dict[str, Any]:
    """Estimates whose true errors follow their covariances times ``sigma_factor`` squared."""
    rng = np.random.default_rng(seed)
    root = np.diag([1e-3, 2e-3, 1e-3, 2e-2, 1e-2]) @ (np.eye(5) + 0.3 * rng.normal(size=(5, 5)))
    drawn = rng.normal(size=(count, 5)) @ root.T
    rotations = so3.exp(rng.normal(size=(count, 3)))
    directions = unit(rng, count)
    bases = sphere.tangent_basis(directions)
    true = [sphere.retract(d, b, e[3:]) for d, b, e in zip(directions, bases, drawn, strict=True)]
    return {
        "statuses": [PoseStatus.OK] * count,
        "rotations": rotations,
        "directions": directions,
        "covariances": np.tile(sigma_factor**2 * root @ root.T, (count, 1, 1)),
        "true_rotations": so3.exp(drawn[:, :3]) @ rotations,
        "true_translations": rng.uniform(0.5, 2.0, (count, 1)) * np.array(true),
    }


def test_honest_motions_pass_and_boastful_ones_do_not():
    honest = evaluate_motions(pair_errors(**simulated(3000)))
    for kind in (honest.rotation, honest.direction, honest.pose):
        for covered in (kind.coverage68, kind.coverage95):
            low, high = binomial_interval(covered.inside, covered.count, confidence=0.999)
            assert low <= covered.level <= high
        assert kind.mean_nees == pytest.approx(kind.dof, abs=3.3 * np.sqrt(2.0 * kind.dof / 3000))
    boastful = evaluate_motions(pair_errors(**simulated(3000, sigma_factor=0.9)))
    for kind in (boastful.rotation, boastful.direction, boastful.pose):
        assert kind.coverage95.high < 0.95
        assert kind.mean_nees > kind.nees_high


def test_covariances_refer_to_the_basis_they_came_with():
    given = simulated(500)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    block = np.eye(5)
    block[3:, 3:] = turn.T
    turned = given | {
        "covariances": block @ given["covariances"] @ block.T,
        "direction_bases": sphere.tangent_basis(given["directions"]) @ turn,
    }
    np.testing.assert_allclose(
        pair_errors(**turned).pose_nees, pair_errors(**given).pose_nees, rtol=1e-6
    )


def test_what_is_not_given_or_not_true_is_not_counted():
    given = simulated(6)
    given["statuses"] = [
        PoseStatus.OK,
        PoseStatus.ROTATION_ONLY,
        PoseStatus.STATIC,
        PoseStatus.FAILED,
        PoseStatus.OK,  # has no truth
        PoseStatus.OK,  # moved too little
    ]
    given["directions"][1:4] = np.nan
    given["covariances"][1:3, :, 3:] = np.nan
    given["covariances"][1:3, 3:, :] = np.nan
    given["covariances"][3] = np.nan
    given["rotations"][3] = np.nan
    given["true_rotations"][4] = np.nan
    given["true_translations"][4] = np.nan
    given["true_translations"][5] *= 1e-3
    errors = pair_errors(**given, min_translation=0.01)
    figures = evaluate_motions(errors)
    assert figures.statuses == {"OK": 3, "ROTATION_ONLY": 1, "STATIC": 1, "FAILED": 1}
    assert (figures.pairs, figures.pairs_with_truth) == (6, 5)
    assert figures.directions_not_counted == 1
    assert (figures.rotation.count, figures.direction.count, figures.pose.count) == (4, 1, 1)
    assert (figures.rotation_rad.count, figures.direction_rad.count) == (4, 1)
    assert np.flatnonzero(~np.isnan(errors.rotation_nees)).tolist() == [0, 1, 2, 5]


def test_a_true_standstill_has_no_direction_to_be_wrong_about():
    given = simulated(2)
    given["true_translations"][0] = 0.0
    errors = pair_errors(**given)
    assert np.isnan(errors.direction_angle_rad[0])
    assert errors.direction_angle_rad[1] < 0.1


def test_flipped_directions_are_counted():
    given = simulated(5)
    given["true_translations"][2] *= -1.0
    errors = pair_errors(**given)
    assert errors.directions_opposed == 1
    assert errors.pose_nees[2] == np.inf
    assert errors.direction_angle_rad[2] > 3.0


@pytest.mark.parametrize(
    "name", ["rotations", "directions", "covariances", "true_rotations", "true_translations"]
)
def test_shapes_are_checked(name: str):
    given = simulated(3)
    given[name] = given[name][:2]
    with pytest.raises(InputError, match=rf"^{name}: expected shape \(3, "):
        pair_errors(**given)
