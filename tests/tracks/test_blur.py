"""Covariances of matches in blurred images are larger along the blur, as errors are."""

from __future__ import annotations

import numpy as np
import pytest
from tracks_textures import Waves, photo, refine

from farpoint.tracks import CornerOptions, RefinementOptions, refinement
from farpoint.tracks.corners import find_corners

ANGLE = np.radians(30.0)
ALONG, ACROSS = np.array([np.cos(ANGLE), np.sin(ANGLE)]), np.array([-np.sin(ANGLE), np.cos(ANGLE)])


class BlurredWaves(Waves):
    """The texture, blurred by a motion of constant velocity during the exposure."""

    def blurred(self, length_px: float, shift: tuple[float, float] = (0, 0)) -> np.ndarray:
        sharp = self._amplitude
        # The mean of a wave over a straight motion: exact.
        self._amplitude = sharp * np.sinc(self._wave @ (length_px * ALONG) / (2 * np.pi))
        try:
            return self.grey(shift=shift)
        finally:
            self._amplitude = sharp


def errors_and_covariances(
    blur0_px: float, blur1_px: float, noise: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    errors, covariances = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = BlurredWaves(seed)
        shift = tuple(rng.uniform(-5, 5, 2))
        image0 = photo(scene.blurred(blur0_px), noise, rng)
        image1 = photo(scene.blurred(blur1_px, shift), noise, rng)
        corners = find_corners(image0, np.empty((0, 2)), 300, 24, CornerOptions())
        points0 = corners + rng.uniform(-0.5, 0.5, corners.shape)
        truth = scene.moved(points0, shift)
        start = truth + rng.uniform(-0.5, 0.5, truth.shape)
        points1, covariance_px2, found, _ = refine(
            image0, image1, points0, start, RefinementOptions()
        )
        assert found.mean() > 0.95
        errors.append((points1 - truth)[found])
        covariances.append(covariance_px2[found])
    return np.concatenate(errors), np.concatenate(covariances)


def within_95(errors: np.ndarray, covariances: np.ndarray) -> float:
    squares = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    return float(np.mean(squares < 5.99))


def sigma_ratio(covariances: np.ndarray) -> float:
    """Sigma along the blur over sigma across it, of the median track."""
    along, across = (np.einsum("i,nij,j->n", axis, covariances, axis) for axis in (ALONG, ACROSS))
    return float(np.median(np.sqrt(along / across)))


def error_ratio(errors: np.ndarray) -> float:
    return float(np.median(np.abs(errors @ ALONG)) / np.median(np.abs(errors @ ACROSS)))


@pytest.mark.parametrize("noise", [1.0, 6.0])
@pytest.mark.parametrize("blur_px", [0.0, 5.0, 8.0])
def test_blur_of_both_images(blur_px: float, noise: float):
    errors, covariances = errors_and_covariances(blur_px, blur_px, noise)
    assert 0.92 < within_95(errors, covariances) < 0.99
    assert sigma_ratio(covariances) == pytest.approx(error_ratio(errors), rel=0.2)


@pytest.mark.parametrize("noise", [1.0, 6.0])
@pytest.mark.parametrize(("blur0_px", "blur1_px"), [(0.0, 5.0), (5.0, 0.0), (5.0, 8.0), (8.0, 5.0)])
def test_blur_that_changes(blur0_px: float, blur1_px: float, noise: float):
    errors, covariances = errors_and_covariances(blur0_px, blur1_px, noise)
    assert 0.91 < within_95(errors, covariances) < 0.995
    assert sigma_ratio(covariances) > 1.1  # as for errors: 1.3 to 2.2


def test_without_the_response_a_change_of_blur_is_missed(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(refinement, "_with_response", lambda covariances, _: covariances)
    assert within_95(*errors_and_covariances(0.0, 5.0)) < 0.9
    assert within_95(*errors_and_covariances(5.0, 8.0)) < 0.8


def test_no_response_makes_a_covariance_invalid():
    covariance = np.tile(np.eye(2), (20, 1, 1))
    for response in (np.zeros((2, 2)), np.full((2, 2), np.nan), np.full((2, 2), np.inf)):
        found = refinement._with_response(covariance, np.tile(response, (20, 1, 1)))
        assert (np.linalg.eigvalsh(found) > 0.0).all()
        assert (np.linalg.eigvalsh(found) <= 16.0 + 1e-9).all()
