"""Refined matches: right to a hundredth of a pixel, and with a covariance that predicts errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import correlate, map_coordinates
from scipy.optimize import root
from scipy.stats import chi2
from tracks_textures import Waves, photo, refine

from farpoint.tracks import CornerOptions, RefinementOptions
from farpoint.tracks.corners import find_corners

OPTIONS = RefinementOptions()


def starts(scene: Waves, image: np.ndarray, rng: np.random.Generator, **motion):
    """Points at arbitrary fractions of a pixel, their true matches, and starts half a pixel off."""
    corners = find_corners(image, np.empty((0, 2)), 300, 24, CornerOptions())
    points0 = corners + rng.uniform(-0.5, 0.5, corners.shape)
    truth = scene.moved(points0, **motion)
    return points0, truth, truth + rng.uniform(-0.5, 0.5, truth.shape)


def normalised_errors(noise: float, scale: float, seeds: range) -> np.ndarray:
    squares = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        scene = Waves(seed)
        motion = {"shift": tuple(rng.uniform(-5, 5, 2)), "scale": scale}
        image0 = photo(scene.grey(), noise, rng)
        image1 = photo(scene.grey(**motion), noise, rng)
        points0, truth, start = starts(scene, image0, rng, **motion)
        points1, covariance_px2, found, _ = refine(image0, image1, points0, start, OPTIONS)
        assert found.mean() > 0.97
        error = (points1 - truth)[found]
        inverse = np.linalg.inv(covariance_px2[found])
        squares.append(np.einsum("ni,nij,nj->n", error, inverse, error))
    return np.concatenate(squares)


@pytest.mark.parametrize("noise", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("scale", [1.0, 1.03])
def test_covariance_predicts_the_errors(noise, scale):
    squares = normalised_errors(noise, scale, range(8))
    assert len(squares) > 800
    for share in (0.5, 0.68, 0.95):
        assert np.quantile(squares, share) == pytest.approx(chi2.ppf(share, 2), rel=0.3)


def test_covariance_of_one_track_is_the_spread_over_many_noises():
    scene = Waves(5)
    rng = np.random.default_rng(0)
    grey0, grey1 = scene.grey(), scene.grey(shift=(1.3, -0.6))
    points0, truth, start = starts(scene, photo(grey0), rng, shift=(1.3, -0.6))
    points0, truth, start = points0[:20], truth[:20], start[:20]
    found, claimed = [], []
    for _ in range(200):
        image0, image1 = photo(grey0, 3, rng), photo(grey1, 3, rng)
        points1, covariance_px2, _, _ = refine(image0, image1, points0, start, OPTIONS)
        found.append(points1 - truth)
        claimed.append(covariance_px2)
    error = np.array(found)
    spread = np.einsum("kni,knj->nij", error, error) / len(error)
    claim = np.mean(claimed, axis=0)
    # The long axis points the same way, and the area and the longest sigma agree.
    ratio = np.linalg.eigvals(np.linalg.solve(claim, spread)).real
    assert np.median(ratio) == pytest.approx(1.0, abs=0.2)
    assert ratio.min() > 0.5
    assert ratio.max() < 2.0


@pytest.mark.parametrize("scale", [1.0, 1.05, 0.95])
def test_matches_are_right_to_a_fiftieth_of_a_pixel(scale):
    scene = Waves(3)
    rng = np.random.default_rng(1)
    motion = {"shift": (2.37, -1.81), "scale": scale}
    image0 = photo(scene.grey())
    points0, truth, start = starts(scene, image0, rng, **motion)
    points1, _, found, _ = refine(image0, photo(scene.grey(**motion)), points0, start, OPTIONS)
    assert found.all()
    assert np.sqrt(np.mean((points1 - truth) ** 2)) < 0.02
    assert np.abs(np.mean(points1 - truth, axis=0)).max() < 0.005


def test_three_steps_lead_to_the_end():
    """Though gradients of sharp images are too flat, and steps by these too long."""
    scene = Waves(9)
    rng = np.random.default_rng(9)
    image0, image1 = (photo(scene.grey(shift=shift), 1, rng) for shift in ((0, 0), (1.2, 0.3)))
    points0, _, start = starts(scene, image0, rng, shift=(1.2, 0.3))
    few, many = (
        refine(image0, image1, points0, start, RefinementOptions(max_iterations=n, tolerance_px=t))
        for n, t in ((3, 0.05), (40, 1e-5))
    )
    left_px = np.linalg.norm(few[0] - many[0], axis=1)
    assert np.quantile(left_px, 0.9) < 0.004
    assert np.median(few[1][:, 0, 0] / many[1][:, 0, 0]) == pytest.approx(1.0, abs=0.02)


def test_a_change_of_exposure_does_not_move_the_matches():
    scene = Waves(3)
    image0 = photo(scene.grey())
    points0, truth, start = starts(scene, image0, np.random.default_rng(1), shift=(0.4, 0.7))
    darker = photo(scene.grey(shift=(0.4, 0.7), gain=0.85))
    points1, _, found, _ = refine(image0, darker - np.uint8(12), points0, start, OPTIONS)
    assert found.all()
    assert np.sqrt(np.mean((points1 - truth) ** 2)) < 0.02


@pytest.mark.parametrize("scale", [0.6, 1.6])
def test_windows_whose_shape_is_known_beforehand_are_matched_as_well_as_still_ones(scale):
    scene = Waves(3)
    rng = np.random.default_rng(1)
    motion = {"shift": (2.37, -1.81), "scale": scale}
    image0, image1 = photo(scene.grey()), photo(scene.grey(**motion))
    points0, truth, start = starts(scene, image0, rng, **motion)
    start, inside = (
        truth + 0.5 * (start - truth),
        np.all(np.abs(truth - 140 + [0, 40]) < 60, axis=1),
    )
    points0, truth, start = points0[inside], truth[inside], start[inside]
    warps = np.tile(scale * np.eye(2), (len(points0), 1, 1))
    points1, _, found, _ = refine(image0, image1, points0, start, OPTIONS, warps)
    assert len(points0) > 25
    assert found.all()
    told_px = np.sqrt(np.mean((points1 - truth) ** 2))
    assert told_px < 0.03
    plain, _, plainly, _ = refine(image0, image1, points0, start, OPTIONS)
    assert np.sqrt(np.mean((plain - truth)[plainly] ** 2)) > 1.8 * told_px


def oracle(image0, image1, point0, start, options, warp):
    """Match, covariance, warp and bending of one window in plain NumPy, from the docstrings."""
    half = options.window_px // 2
    offset = np.stack(np.meshgrid(np.arange(-half, half + 1), np.arange(-half, half + 1)))
    x, y = offset + point0[:, None, None]
    across = np.outer([3, 10, 3], [-1, 0, 1]) / 32
    template, dx, dy = (
        map_coordinates(values, [y, x], order=1)
        for values in (image0, correlate(image0, across), correlate(image0, across.T))
    )
    dx, dy = np.tensordot(np.linalg.inv(warp).T, np.stack([dx, dy]), 1)
    expected = np.concatenate([np.zeros(2), (warp - np.eye(2)).ravel(), np.zeros(2)])
    u, v = offset
    contrast = template - template.mean()
    parts = [dx, dy, dx * u, dx * v, dy * u, dy * v, -contrast, -np.ones_like(dx)]
    J = np.stack([part.ravel() for part in parts])
    sigma = [np.inf] * 2 + [options.affine_sigma] * 4 + [options.gain_sigma, options.offset_sigma]
    precision = np.diag(1 / np.square(sigma))

    def residual(theta):
        warp = np.eye(2) + theta[2:6].reshape(2, 2)
        x, y = np.tensordot(warp, offset, 1) + (start + theta[:2])[:, None, None]
        window = map_coordinates(image1, [y, x], order=1)
        return (window - template - theta[6] * contrast - theta[7]).ravel()

    def normal_equations(theta):
        r = residual(theta)
        return J @ r + np.mean(r**2) * precision @ (theta - expected)

    theta = root(normal_equations, expected, tol=1e-9).x
    r = residual(theta)
    noise = np.mean(r**2)
    P = np.linalg.inv(J @ J.T + noise * precision)[:2]
    psi = ((P @ J) * r).reshape(2, *template.shape)
    lag = np.maximum(1 - np.abs(np.arange(-2, 3)) / 3, 0)
    smooth = np.stack([correlate(row, np.outer(lag, lag), mode="constant") for row in psi])
    moments = np.einsum("ivu,jvu->ij", psi, smooth)
    blocks = template.size / 9
    covariance = moments * blocks / (blocks - 4) + noise * P @ precision @ P.T
    D = np.linalg.inv(P[:, :2])
    nu = min(0.15 * template.size * noise, np.linalg.eigvalsh(D)[0] / 3)
    S = np.linalg.solve(D - nu * np.eye(2), D)
    pull = (P @ J)[:, None, None] * J[None, :2, None]
    quadratic_bias = np.sum(pull * np.stack([u * u, u * v, v * v]).reshape(1, 1, 3, -1), axis=3)
    shape = np.eye(2) + theta[2:6].reshape(2, 2)
    down, across = np.gradient(r.reshape(template.shape))
    gradients = np.linalg.solve(shape.T, np.stack([across.ravel(), down.ravel()]))
    response = (1 + theta[6]) * np.eye(2) + P @ J @ gradients.T
    return start + theta[:2], S @ covariance @ S.T, shape, quadratic_bias, response


@pytest.mark.parametrize("warp", [np.eye(2), np.array([[1.06, 0.03], [-0.02, 1.01]])])
def test_the_kernel_computes_what_plain_numpy_computes(warp):
    scene = Waves(7)
    rng = np.random.default_rng(2)
    image0 = photo(scene.grey(), 1, rng)
    image1 = photo(scene.grey(shift=(1.2, 0.3), scale=1.04, gain=1.1), 1, rng)
    points0, _, start = starts(scene, image0, rng, shift=(1.2, 0.3), scale=1.04)
    points0, start = points0[:12], start[:12]  # few enough to be refined without the compiler
    options = RefinementOptions(max_iterations=60, tolerance_px=1e-6, noise_floor=1e-3)
    warps = np.tile(warp, (len(points0), 1, 1))
    points1, covariance_px2, _, windows = refine(image0, image1, points0, start, options, warps)
    by_oracle = [
        oracle(image0 / 1.0, image1 / 1.0, points0[k], start[k], options, warp)
        for k in range(len(points0))
    ]
    inverse = np.linalg.inv(np.median([response for *_, response in by_oracle], axis=0))
    for k, (point, own, shape, quadratic_bias, _) in enumerate(by_oracle):
        covariance = inverse @ own @ inverse.T + 0.01**2 * np.eye(2)
        np.testing.assert_allclose(windows.warps[k], shape, atol=1e-3)
        np.testing.assert_allclose(windows.quadratic_bias[k], quadratic_bias, rtol=2e-3, atol=0.02)
        np.testing.assert_allclose(points1[k], point, atol=1e-3)
        np.testing.assert_allclose(
            covariance_px2[k], covariance, rtol=0.01, atol=0.01 * np.trace(covariance)
        )


def test_windows_that_do_not_match_are_refused():
    rng = np.random.default_rng(0)
    scene, other = Waves(1), Waves(2)
    image0 = photo(scene.grey())
    points0, truth, _ = starts(scene, image0, rng)
    _, _, found, _ = refine(image0, photo(other.grey()), points0, truth, OPTIONS)
    assert found.mean() < 0.05


def test_windows_beyond_the_border_and_without_texture_are_refused():
    image = photo(Waves(1).grey())
    flat = np.full_like(image, 90)
    points = np.array([[5.0, 100.0], [100.0, 3.0], [278.0, 100.0], [100.0, 198.5], [-30.0, 50.0]])
    assert not refine(image, image, points, points, OPTIONS)[2].any()
    inside = np.array([[100.0, 100.0]])
    assert refine(image, image, inside, inside, OPTIONS)[2].all()
    assert not refine(flat, flat, inside, inside, OPTIONS)[2].any()
    assert not refine(image, image, inside, np.array([[np.nan, 50.0]]), OPTIONS)[2].any()
