"""Loops of the window against the same sums in NumPy, with the compiler and without."""

from __future__ import annotations

import numpy as np

from farpoint.geometry import so3
from farpoint.path.constants import UNSEEN_PX
from farpoint.path.kernels.cholesky import eliminate_points, point_variances
from farpoint.path.kernels.information import gather_information, point_steps, robust_cost
from farpoint.path.kernels.resection import locate

NOISE = np.array([0.5, 0.5, 1e-3, 1.3])
DOF = 5.0


def observations(seed: int = 0) -> dict[str, np.ndarray]:
    """Three points in four keyframes, one of them unobserved once, one not used."""
    rng = np.random.default_rng(seed)
    frame = np.array([0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3])
    count = len(frame)
    travelled = np.zeros((count, 3))
    travelled[:, [0, 2]] = 0.02 * (1 + frame[:, None]) + rng.uniform(0.0, 0.01, (count, 2))
    residuals = rng.normal(0.0, 0.3, (count, 2))
    residuals[:3] = 0.0
    residuals[7] = UNSEEN_PX
    return {
        "frame": frame,
        "point": np.tile([0, 1, 2], 4),
        "last": np.tile([0.01, 0.002, 0.02], (count, 1)),
        "travelled": travelled,
        "anchor": np.array([0, 1, 2]),
        "used": np.array([True, True, False]),
        "residuals": residuals,
        "by_pose": rng.normal(size=(count, 2, 6)),
        "by_common": rng.normal(size=(count, 2, 2)),
        "by_s": rng.normal(size=(count, 2)),
    }


def rows_of(case: dict[str, np.ndarray]) -> list[tuple[int, int, int]]:
    """Point, observation and the previous one, of every residual that counts."""
    found, before = [], {}
    for o, j in enumerate(case["point"]):
        if not case["used"][j] or case["residuals"][o, 0] == UNSEEN_PX:
            continue
        if o != case["anchor"][j]:
            found.append((int(j), o, before[j]))
        before[j] = o
    return found


def expected(case: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, float]:
    """Information of poses, common unknowns and points together, gradient, and cost."""
    poses, points = 4, 3
    total = 6 * poses + 2 + points
    H, g, cost = np.zeros((total, total)), np.zeros(total), 0.0
    for j, o, b in rows_of(case):
        J, e = np.zeros((2, total)), case["residuals"][o] - case["residuals"][b]
        a = case["anchor"][j]
        for sign, k in ((1.0, o), (-1.0, b)):
            if k == a:
                continue
            for frame, side in ((case["frame"][k], sign), (case["frame"][a], -sign)):
                J[:, 6 * frame : 6 * frame + 6] += side * case["by_pose"][k]
            J[:, 6 * poses : 6 * poses + 2] += sign * case["by_common"][k]
            J[:, 6 * poses + 2 + j] += sign * case["by_s"][k]
        uu, uv, vv = 0.5 * case["last"][o] + 0.5 * (case["travelled"][o] - case["travelled"][b])
        C = 1.3 * np.array([[uu + 1e-3, uv], [uv, vv + 1e-3]])
        square = e @ np.linalg.solve(C, e)
        W = (DOF + 2.0) / (DOF + square) * np.linalg.inv(C)
        H, g = H + J.T @ W @ J, g + J.T @ W @ e
        cost += 0.5 * (DOF + 2.0) * np.log1p(square / DOF)
    return H, g, cost


def test_information_is_that_of_changes_of_residuals():
    case = observations()
    H, g, cost = expected(case)
    D = 26
    found_H, found_g, coupling = np.zeros((D, D)), np.zeros(D), np.zeros((3, D))
    point_h, point_g = np.zeros(3), np.zeros(3)
    patch_sums, point_sums = np.zeros((4, 2)), np.zeros((3, 2))
    squares, influence, count = gather_information(
        case["frame"], case["point"], case["last"], case["travelled"], case["anchor"],
        case["used"], NOISE, case["residuals"], case["by_pose"], case["by_common"], case["by_s"],
        case["frame"], np.empty(3, np.int64), found_H, found_g, coupling, point_h, point_g,
        patch_sums, point_sums,
    )  # fmt: skip
    assert count == len(rows_of(case)) == 5
    np.testing.assert_allclose(found_H, H[:D, :D], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found_g, g[:D], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(coupling, H[D:, :D], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(point_h, np.diag(H)[D:], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(point_g, g[D:], rtol=1e-9, atol=1e-9)
    assert influence > 0.0
    assert squares > 0.0
    # All residuals are in one patch or another, and of one point or another.
    np.testing.assert_allclose(patch_sums.sum(axis=0), point_sums.sum(axis=0), rtol=1e-9)
    found = robust_cost(
        case["point"], case["last"], case["travelled"], case["anchor"], case["used"], NOISE,
        case["residuals"], np.empty(3, np.int64),
    )  # fmt: skip
    np.testing.assert_allclose(found, cost + 50.0, rtol=1e-9)  # and what an unseen point costs


def test_steps_of_points_solve_their_rows():
    rng = np.random.default_rng(1)
    coupling, h, g, step = rng.normal(size=(5, 8)), rng.uniform(1, 2, 5), rng.normal(size=5), None
    step = rng.normal(size=8)
    found = np.empty(5)
    point_steps(coupling, h, g, step, 0.1, found)
    np.testing.assert_allclose((h + 0.1) * found + coupling @ step, -g, rtol=1e-12)


def test_a_pose_is_found_by_known_points():
    rng = np.random.default_rng(2)
    R_true, p_true = so3.exp(np.array([0.05, -0.1, 0.02])), np.array([0.3, -0.2, 0.1])
    points = rng.uniform([-3.0, -2.0, 3.0], [3.0, 2.0, 8.0], (40, 3))
    s = 1.0 / np.linalg.norm(points, axis=1)
    X = s[:, None] * points  # seen from the origin
    focal = 400.0

    def pixels(R: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rays = (points - p) @ R
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return rays, focal * rays[:, :2] / rays[:, 2:]

    R, p = np.eye(3), np.zeros(3)
    for _ in range(3):
        rays, expected_px = pixels(R, p)
        by_ray = np.zeros((40, 2, 3))
        by_ray[:, 0, 0] = by_ray[:, 1, 1] = focal / rays[:, 2]
        by_ray[:, :, 2] = -focal * rays[:, :2] / rays[:, 2:] ** 2
        H, squares = np.empty((6, 6)), np.empty(40)
        _, count = locate(
            R, p, np.eye(3), np.zeros(3), 0.1, 0.0, expected_px - pixels(R_true, p_true)[1],
            np.zeros(40), rays, by_ray, np.tile([0.01, 0.0, 0.01], (40, 1)), np.ones(4), X, s,
            np.zeros(40), np.zeros((40, 3)), np.zeros((40, 2)), H, squares,
        )  # fmt: skip
    assert count == 40
    np.testing.assert_allclose(R, R_true, atol=1e-7)
    np.testing.assert_allclose(p, p_true, atol=1e-6)
    assert squares.max() < 1e-6


def test_elimination_is_the_complement_of_schur():
    rng = np.random.default_rng(6)
    coupling = rng.normal(size=(9, 14)) * (rng.uniform(size=(9, 14)) < 0.4)
    point_h, point_g = rng.uniform(1.0, 2.0, 9), rng.normal(size=9)
    point_h[4], coupling[4] = 0.0, 0.0  # of a point that nobody sees
    J = rng.normal(size=(30, 14))
    H, g = J.T @ J, rng.normal(size=14)
    expected_h = H - coupling.T @ (coupling / (point_h + 0.1)[:, None])
    expected_g = g - coupling.T @ (point_g / (point_h + 0.1))
    eliminate_points(coupling, point_h, point_g, 0.1, H, g)
    np.testing.assert_allclose(H, expected_h, atol=1e-12)
    np.testing.assert_allclose(g, expected_g, atol=1e-12)


def test_variances_of_points_are_those_of_the_whole_inverse():
    rng = np.random.default_rng(7)
    coupling = 0.3 * rng.normal(size=(5, 6)) * (rng.uniform(size=(5, 6)) < 0.7)
    point_h, J = rng.uniform(2.0, 3.0, 5), rng.normal(size=(30, 6))
    whole = np.block([[J.T @ J, coupling.T], [coupling, np.diag(point_h)]])
    H, g = J.T @ J, np.zeros(6)
    eliminate_points(coupling, point_h, np.zeros(5), 0.0, H, g)
    rows, found = np.array([0, 2, 3]), np.empty(3)
    point_variances(rows, coupling, point_h, np.linalg.inv(H), found)
    np.testing.assert_allclose(found, np.diag(np.linalg.inv(whole))[6 + rows], rtol=1e-9)
