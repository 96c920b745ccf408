"""Rays with errors, their effect on a motion and on the flow, against differences and NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from farpoint._kernels.constants import (
    COARSE_STEPS,
    LENS_LINEAR_SIGMA,
    STUDENT_FREEDOM,
)
from farpoint._kernels.explained_flow import explain_by_rotation
from farpoint._kernels.lens_errors import (
    RaysWithErrors,
    lens_sensitivity,
    rays_with_errors,
)
from farpoint._kernels.row_rotation import RowMotion
from farpoint._kernels.vectors import tangent_columns
from farpoint.camera import Camera
from farpoint.geometry import so3
from farpoint.geometry.sphere import normalize

CAMERA = Camera.pinhole(640, 480, 500.0, 510.0, 320.0, 235.0).with_uncertainty(
    focal=0.01, center_px=2.0, distortion_px=1.0
)
GLOBAL_SHUTTER = RowMotion()
RATE = np.array([0.02, -0.03, 0.01])
TURN = np.array([0.05, 0.02, -0.1])
ROWS = RowMotion(RATE, TURN, 0.1 * RATE, 0.1 * TURN, 1 / 479)
NOT_TURNING = RowMotion(RATE, np.zeros(3), 0.1 * RATE, np.zeros(3), 1 / 479)
COUNT = 40
MEANS = np.random.default_rng(6).uniform(-0.5, 0.5, COUNT)
NOISE_PX = 0.5


def through(pixels: np.ndarray, rows: RowMotion, z: np.ndarray) -> np.ndarray:
    """Rays of pixels through the lens with errors ``z``, in the axes of the middle row."""
    lens, factor = CAMERA.refinable, CAMERA.parameter_factor
    given = np.array(list(lens.parameters.values()))
    rays = lens.with_parameters(given + factor @ z[:-1]).unproject(pixels)
    rate, turn = (
        rows.rate + z[-1] * rows.rate_by_readout,
        rows.turn + z[-1] * rows.turn_by_readout,
    )
    for vectors in (phases(pixels)[:, None] * rate, MEANS[:, None] * turn):
        rays = np.einsum("nij,nj->ni", so3.exp(-vectors), rays)
    return rays


def phases(pixels: np.ndarray) -> np.ndarray:
    return pixels[:, 1] / 479 - 0.5


def with_errors(
    pixels: np.ndarray, rows: RowMotion, factor: np.ndarray | None = None
) -> RaysWithErrors:
    factor = np.ascontiguousarray(CAMERA.parameter_factor if factor is None else factor)
    rays, count = CAMERA.unproject(pixels), len(pixels)
    found = RaysWithErrors(
        np.empty((count, 3)),
        np.empty((count, 3, 2)),
        np.empty((count, 3, factor.shape[1] + 1)),
    )
    rays_with_errors(
        rays,
        CAMERA.unproject_jacobian(rays),
        CAMERA.refinable.project_parameter_jacobian(rays),
        factor,
        phases(pixels),
        MEANS,
        rows,
        found,
    )
    return found


@pytest.fixture
def pixels() -> np.ndarray:
    return np.random.default_rng(4).uniform(0.0, (639, 479), (COUNT, 2))


@pytest.mark.parametrize("rows", [ROWS, GLOBAL_SHUTTER], ids=["rolling", "global"])
def test_rays_move_with_the_errors(pixels: np.ndarray, rows: RowMotion):
    found = with_errors(pixels, rows)
    r = found.by_error.shape[2]
    np.testing.assert_allclose(found.rays, through(pixels, rows, np.zeros(r)), atol=1e-12)
    step = 1e-3
    for k in range(r):
        ahead, back = (through(pixels, rows, sign * step * np.eye(r)[k]) for sign in (1.0, -1.0))
        expected = (ahead - back) / (2.0 * step)
        assert np.abs(expected).max() > 1e-4 or (rows is GLOBAL_SHUTTER and k == r - 1)
        # The derivative by the read-out time is of first order in the turn within an image.
        is_first_order = k == r - 1
        atol = 0.5 * np.linalg.norm(rows.turn) * np.abs(expected).max() if is_first_order else 1e-8
        np.testing.assert_allclose(found.by_error[:, :, k], expected, atol=atol)


def test_rays_move_with_the_pixel(pixels: np.ndarray):
    found, step, nothing = with_errors(pixels, ROWS), 1e-3, np.zeros(20)
    for k in range(2):
        ahead, back = (
            through(pixels + sign * step * np.eye(2)[k], ROWS, nothing[: found.by_error.shape[2]])
            for sign in (1.0, -1.0)
        )
        expected = (ahead - back) / (2.0 * step)
        np.testing.assert_allclose(found.by_pixel[:, :, k], expected, atol=1e-9)


def two_views(baseline: float, seed: int = 5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotation cam1_from_cam0, and pixels in both images, with exact rays and no noise."""
    rng = np.random.default_rng(seed)
    pixels0 = rng.uniform((80, 80), (560, 400), (COUNT, 2))
    points = CAMERA.unproject(pixels0) * rng.uniform(2.0, 8.0, (COUNT, 1))
    R = so3.exp(np.array([0.01, -0.03, 0.02]))
    return R, pixels0, CAMERA.project(points @ R.T + baseline * np.array([0.6, 0.0, 0.8]))


def solution(
    R: np.ndarray,
    t: np.ndarray | None,
    first: np.ndarray,
    second: np.ndarray,
    weight: np.ndarray,
) -> np.ndarray:
    """Parameters of the motion near (R, t) that minimise its weighted squared residuals."""
    basis = np.column_stack(tangent_columns(tuple(t))) if t is not None else np.empty((3, 0))
    x = np.zeros(3 + basis.shape[1])
    for _ in range(10):

        def residuals(x: np.ndarray) -> np.ndarray:
            rotated = first @ (so3.exp(x[:3]) @ R).T
            if t is None:
                return (second - rotated).ravel()
            return np.einsum("ni,ni->n", second, np.cross(normalize(t + basis @ x[3:]), rotated))

        step, J = 1e-6, []
        for k in range(len(x)):
            e = step * np.eye(len(x))[k]
            J.append((residuals(x + e) - residuals(x - e)) / (2.0 * step))
        J = np.array(J).T
        H = J.T @ (weight[:, None] * J)
        x = x - np.linalg.solve(H, J.T @ (weight * residuals(x)))
    return x


@pytest.mark.parametrize("has_direction", [True, False], ids=["motion", "rotation"])
def test_a_motion_moves_with_the_errors(has_direction: bool):
    """``dx/dz`` against the weighted solution through a lens that is a little off."""
    R, pixels0, pixels1 = two_views(0.5 if has_direction else 0.0)
    t = np.array([0.6, 0.0, 0.8]) if has_direction else None
    basis = np.column_stack(tangent_columns(tuple(t))) if has_direction else np.empty((3, 0))
    first, second = with_errors(pixels0, GLOBAL_SHUTTER), with_errors(pixels1, GLOBAL_SHUTTER)
    r = first.by_error.shape[2]
    found = np.empty((3 + basis.shape[1], r))
    lens_sensitivity(R, np.zeros(3) if t is None else t, basis, first, second, found)
    if t is None:
        squares = np.sum(first.by_pixel**2, axis=(1, 2)) + np.sum(second.by_pixel**2, axis=(1, 2))
        weight = np.repeat(2.0 / squares, 3)
    else:
        q = np.cross(second.rays, t) @ R
        n = np.cross(t, first.rays @ R.T)
        sides = (q, first), (n, second)
        weight = 1.0 / sum(
            np.sum(np.einsum("ni,nik->nk", side, rays.by_pixel) ** 2, axis=1)
            for side, rays in sides
        )
    step = 1e-3
    for k in range(r - 1):
        ahead, back = (
            solution(
                R,
                t,
                *(
                    through(p, GLOBAL_SHUTTER, sign * step * np.eye(r)[k])
                    for p in (pixels0, pixels1)
                ),
                weight,
            )
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(found[:, k], (ahead - back) / (2.0 * step), atol=2e-6)
    assert np.abs(found[:, : r - 1]).max() > 1e-4
    np.testing.assert_array_equal(found[:, r - 1 :], 0.0)


def test_matches_without_rays_move_nothing():
    R, pixels0, pixels1 = two_views(0.5)
    t, basis = np.array([0.6, 0.0, 0.8]), np.eye(3)[:, :2].copy()
    found = []
    for count in (COUNT, COUNT - 3):
        first = with_errors(pixels0[:count], GLOBAL_SHUTTER)
        second = with_errors(pixels1[:count], GLOBAL_SHUTTER)
        if count == COUNT:
            second.rays[-3] = np.nan
            second.by_error[-2] = np.nan
            first.by_pixel[-1] = np.nan
        found.append(np.empty((5, first.by_error.shape[2])))
        lens_sensitivity(R, t, basis, first, second, found[-1])
    np.testing.assert_allclose(*found, rtol=1e-9)


def explained(
    R: np.ndarray, first: RaysWithErrors, second: RaysWithErrors, farthest2: float = 100.0
) -> tuple[int | None, np.ndarray, np.ndarray]:
    """Number of steps that remain, or None; rotation; errors."""
    R, z = R.copy(), np.zeros(first.by_error.shape[2])
    is_explained, remaining = explain_by_rotation(
        R, first, second, NOISE_PX, farthest2, 13.8, int(COARSE_STEPS), z
    )
    return remaining if is_explained else None, R, z


def optimum(
    R: np.ndarray, first: RaysWithErrors, second: RaysWithErrors
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vector and errors at the mode, by iteratively reweighted least squares in NumPy."""
    a = first.rays @ R.T
    squares = np.sum(first.by_pixel**2, axis=(1, 2)) + np.sum(second.by_pixel**2, axis=(1, 2))
    scale = 1.0 / (NOISE_PX * np.sqrt(0.5 * squares))
    by_theta = -np.stack([np.cross(axis, a) for axis in np.eye(3)], axis=2)
    J = np.concatenate([by_theta, second.by_error - R @ first.by_error], axis=2)
    J, flow0 = J * scale[:, None, None], (second.rays - a) * scale[:, None]
    x, prior = np.zeros(J.shape[2]), np.diag([0.0] * 3 + [1.0] * (J.shape[2] - 3))
    for _ in range(100):
        flow = flow0 + J @ x
        weight = (STUDENT_FREEDOM + 2.0) / (STUDENT_FREEDOM + np.sum(flow**2, axis=1))
        H = np.einsum("n,nki,nkj->ij", weight, J, J) + prior
        x = -np.linalg.solve(H, np.einsum("n,nki,nk->i", weight, J, flow0))
    return x[:3], x[3:]


def test_the_errors_that_explain_the_flow_are_the_mode():
    R, pixels0, pixels1 = two_views(0.0)
    pixels1 += np.random.default_rng(0).normal(0.0, NOISE_PX, pixels1.shape)
    first, second = with_errors(pixels0, NOT_TURNING), with_errors(pixels1, NOT_TURNING)
    remaining, rotated, z = explained(R, first, second)
    theta, expected = optimum(R, first, second)
    assert remaining == 0
    np.testing.assert_allclose(z, expected, atol=0.02)  # `LENS_CONVERGED_SIGMA` and the last step
    np.testing.assert_allclose(so3.log(rotated @ R.T), theta, atol=1e-5)
    assert np.abs(z).max() > 0.05


@pytest.mark.parametrize(("moved", "is_explained"), [(16, True), (24, False)])
def test_the_flow_of_more_than_half_excludes_every_lens(moved: int, is_explained: bool):
    R, pixels0, pixels1 = two_views(0.0)
    # In alternating directions, so that no rotation and no lens follows.
    pixels1[:moved] += 30.0 * (-1.0) ** np.arange(2 * moved).reshape(moved, 2)
    pixels1[:moved:2] += 30.0
    first, second = with_errors(pixels0, GLOBAL_SHUTTER), with_errors(pixels1, GLOBAL_SHUTTER)
    assert (explained(R, first, second)[0] is not None) == is_explained


def test_matches_without_rays_explain_nothing():
    R, pixels0, pixels1 = two_views(0.0)
    pixels1 += np.random.default_rng(0).normal(0.0, NOISE_PX, pixels1.shape)
    found = []
    for count in (COUNT, COUNT - 2):
        first = with_errors(pixels0[:count], GLOBAL_SHUTTER)
        second = with_errors(pixels1[:count], GLOBAL_SHUTTER)
        if count == COUNT:
            second.rays[-2] = np.nan
            first.by_error[-1] = np.nan
        found.append(explained(R, first, second)[2])
    assert np.abs(found[0]).max() > 0.05
    np.testing.assert_array_equal(*found)


def test_a_rotation_far_from_the_initial_one_asks_for_new_rays():
    R, pixels0, pixels1 = two_views(0.0)
    first, second = with_errors(pixels0, GLOBAL_SHUTTER), with_errors(pixels1, GLOBAL_SHUTTER)
    remaining, rotated, _ = explained(so3.exp(np.array([0.0, 0.0, 0.02])) @ R, first, second)
    assert remaining
    np.testing.assert_allclose(rotated, R, atol=1e-3)


def test_a_long_step_asks_for_new_rays():
    """A focal length that is off by 2 %, two sigma, at a turn of 6 degrees about the view axis."""
    _, pixels0, _ = two_views(0.0)
    R = so3.exp(np.array([0.0, 0.1, 0.0]))
    true = Camera.pinhole(640, 480, 510.0, 520.2, 320.0, 235.0)
    pixels1 = true.project(true.unproject(pixels0) @ R.T)
    rays = with_errors(pixels0, GLOBAL_SHUTTER), with_errors(pixels1, GLOBAL_SHUTTER)
    remaining, _, z = explained(R, *rays)
    assert 0 < remaining < COARSE_STEPS
    assert np.abs(z).max() > LENS_LINEAR_SIGMA
    limited = explained(R, *rays, farthest2=0.3**2)
    assert np.linalg.norm(limited[2]) <= 0.3 * (1.0 + 1e-12)
    assert math.isfinite(limited[2].sum())
