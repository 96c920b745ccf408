"""Hard pairs are what their names say, and their truth is true."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint.geometry import sphere
from farpoint.geometry.so3 import skew
from farpoint.synthetic import PointScene
from farpoint.synthetic.pairs import KINDS, HardPair, smooth_field, wall

# Sigma of the noise in px, and share of the outliers. The first words of a kind name it.
EXPECTED = {
    "traffic, 20 %": (0.2, 0.2),
    "traffic, 30 %": (0.2, 0.3),
    "traffic, 40 %": (0.2, 0.4),
    "object crossing, 10 %": (0.2, 0.1),
    "object crossing, 20 %": (0.2, 0.2),
    "object crossing, 40 %": (0.2, 0.4),
    "dirt on the lens, 20 %": (0.05**0.5, 0.24),  # and 5 % of the others
    "dirt on the lens, 40 %": (0.05**0.5, 0.43),
    "wall, ": (0.2, 0.0),
    "rough wall, 40 matches, 20 % wrong": (0.2, 0.2),
    "rough wall, 300": (0.2, 0.0),
    "wall ahead": (0.22, 0.0),
    "floor": (0.2, 0.0),
    "ground straight below": (0.3, 0.0),
    "rails": (0.2, 0.5),
    "road, half": (0.4, 0.5),
    "court, 40 % repeated": (0.3, 0.4),
    "court, windows repeated": (0.3, 0.5),
    "wide baseline, 60 % wrong": (0.3, 0.6),
    "wrong matches alone": (0.0, 1.0),
    "mostly far": (1.0, 0.2),
    "short step, 20 % wrong": (1.0, 0.2),
    "short step": (1.0, 0.0),
    "15 matches, 4 wrong": (0.05**0.5, 4 / 15),
    "turn, half": (0.05**0.5, 0.5),
    "smooth errors": (None, 0.05),
}
SEEDS = range(8)


def expected(kind: str) -> tuple[float | None, float]:
    return next(value for words, value in EXPECTED.items() if kind.startswith(words))


def residuals_px(pair: HardPair | PointScene, E: np.ndarray) -> np.ndarray:
    """First-order distances (N,) of matches from the epipolar constraint of E, in px.

    The sigma of a distance is that of the noise of a coordinate.
    """
    rays0, rays1 = (pair.camera.unproject(points) for points in (pair.points0, pair.points1))
    values = np.einsum("ni,ij,nj->n", rays1, E, rays0)
    step = 1e-3
    squared = np.zeros(len(values))
    for axis in (0, 1):
        shift = step * np.eye(2)[axis]
        moved0 = pair.camera.unproject(pair.points0 + shift)
        moved1 = pair.camera.unproject(pair.points1 + shift)
        squared += ((np.einsum("ni,ij,nj->n", rays1, E, moved0) - values) / step) ** 2
        squared += ((np.einsum("ni,ij,nj->n", moved1, E, rays0) - values) / step) ** 2
    return values / np.sqrt(squared)


def motion_residuals_px(pair: HardPair | PointScene) -> np.ndarray:
    """Residuals of the true motion (N, 1), or (N, 2) without a translation, per coordinate."""
    R, t = pair.rotation_cam1_from_cam0, pair.translation_cam1_from_cam0
    if t.any():
        return residuals_px(pair, skew(sphere.normalize(t)) @ R)[:, None]
    turned = pair.camera.project(pair.camera.unproject(pair.points0) @ R.T)
    return (pair.points1 - turned) / np.sqrt(2.0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_gives_the_same_pair_and_another_one_does_not(kind: str):
    first, again, other = (KINDS[kind](seed) for seed in (3, 3, 4))
    for name in ("points0", "points1", "is_outlier", "rotation_cam1_from_cam0"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    np.testing.assert_array_equal(
        first.translation_cam1_from_cam0, again.translation_cam1_from_cam0
    )
    assert len(first) != len(other) or not np.allclose(first.points0, other.points0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_pair_is_well_formed(kind: str):
    for seed in SEEDS:
        pair = KINDS[kind](seed)
        assert pair.points0.shape == pair.points1.shape == (len(pair), 2)
        assert pair.is_outlier.shape == (len(pair),)
        assert pair.is_outlier.dtype == bool
        R = pair.rotation_cam1_from_cam0
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) > 0.0
        assert pair.translation_cam1_from_cam0.shape == (3,)
        size = np.array(pair.camera.size)
        for points in (pair.points0, pair.points1):
            assert np.isfinite(points).all()
            # A step may carry some points over the border.
            inside = np.all((points > -0.02 * size) & (points < 1.02 * size), axis=1)
            assert inside.mean() > 0.6
            assert (np.abs(points - size / 2) < 1.5 * size).all()


@pytest.mark.parametrize("kind", KINDS)
def test_the_share_of_outliers_is_that_of_the_name(kind: str):
    shares = [KINDS[kind](seed).is_outlier.mean() for seed in SEEDS]
    assert np.mean(shares) == pytest.approx(expected(kind)[1], abs=0.03)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if expected(kind)[0]])
def test_inliers_follow_the_true_motion_but_for_the_noise(kind: str):
    noise_px, _ = expected(kind)
    assert noise_px is not None
    pairs = [KINDS[kind](seed) for seed in SEEDS]
    residuals = np.concatenate([motion_residuals_px(pair)[~pair.is_outlier] for pair in pairs])
    assert np.abs(residuals).max() < 5.5 * noise_px
    # Relative standard error of a sigma from 88 residuals, the fewest: 8 %.
    assert residuals.std() == pytest.approx(noise_px, rel=0.25 if len(residuals) < 200 else 0.1)


# Tracks slide along rails that point in the direction of travel: along their epipolar lines.
@pytest.mark.parametrize(
    "kind", [kind for kind in KINDS if expected(kind)[1] > 0.0 and kind != "rails"]
)
def test_most_outliers_do_not_follow_the_true_motion(kind: str):
    threshold_px = 2.0 * (expected(kind)[0] or 0.4)
    pairs = [KINDS[kind](seed) for seed in SEEDS]
    residuals = [motion_residuals_px(pair)[pair.is_outlier] for pair in pairs]
    wrong = np.any(np.abs(np.concatenate(residuals)) > threshold_px, axis=1)
    assert wrong.mean() > 0.5


def test_tracks_slide_along_their_rails_by_up_to_two_pixels():
    """They obey the epipolar constraint, but their flow is too long or too short."""
    pair = KINDS["rails"](0)
    residuals = motion_residuals_px(pair)[pair.is_outlier]
    assert np.abs(residuals).max() < 5.5 * 0.2
    aside = np.array([-2.5, -1.0, 1.0, 2.5])
    X = pair.camera.unproject(pair.points0[pair.is_outlier])
    X *= 2.0 / X[:, 1:2]  # on the ground
    rail = aside[np.argmin(np.abs(X[:, :1] - aside), axis=1)]
    assert np.abs(X[:, 0] - rail).max() < 0.2
    true = X @ pair.rotation_cam1_from_cam0.T + pair.translation_cam1_from_cam0
    slid = np.linalg.norm(pair.camera.project(true) - pair.points1[pair.is_outlier], axis=1)
    assert 0.5 < np.median(slid) < 2.5


def test_a_smooth_field_has_its_size_and_changes_over_its_reach():
    points = np.random.default_rng(0).uniform((0.0, 0.0), (640.0, 480.0), (500, 2))
    fields = [smooth_field(seed, points, 0.4, 80.0) for seed in range(40)]
    assert np.std(fields) == pytest.approx(0.4, rel=0.1)
    near, far = (np.add(points, (shift, 0.0)) for shift in (4.0, 320.0))
    steps = [
        np.std([smooth_field(k, moved, 0.4, 80.0) - fields[k] for k in range(40)])
        for moved in (near, far)
    ]
    assert steps[0] < 0.1 * steps[1]


def test_a_wall_is_a_plane_but_for_the_points_before_it():
    """A homography maps the points of the wall, and not those before it."""
    pair = wall(1, direction=(1.0, 0.0, 0.0), off_plane=5)
    normal = np.array([0.45, -0.25, 1.0]) / 4.0
    H = pair.rotation_cam1_from_cam0 + np.outer(pair.translation_cam1_from_cam0, normal)
    mapped = pair.camera.project(pair.camera.unproject(pair.points0) @ H.T)
    errors = np.linalg.norm(mapped - pair.points1, axis=1)
    assert errors[5:].max() < 1.5
    assert errors[:5].min() > 1.5
