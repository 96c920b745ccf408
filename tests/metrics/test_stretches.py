"""Of stretches of a path, 95 % lie within their 95 % where its covariances are right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from path_kit import drawn_path

from farpoint.geometry import so3
from farpoint.metrics import STRETCH_SHARES, PathSamples, StretchFigure, evaluate_stretches

PATHS = 30
SIGMAS = np.array([4e-3, 4e-3, 4e-3, 0.02, 0.02, 0.02, 0.0])
"""Of poses found by themselves: rad, and units."""


def located_between_keyframes(path: PathSamples, rng: np.random.Generator) -> PathSamples:
    """The path, all but one pose in five with an error of its own that none after it has."""
    errors = SIGMAS * rng.normal(size=(len(path.truth), 7))
    errors[::5] = 0.0
    found = path.world_from_cam.copy()
    found[:, :3, :3] = so3.exp(errors[:, :3]) @ found[:, :3, :3]
    found[:, :3, 3] += errors[:, 3:6]
    own = np.zeros_like(path.covariances)
    own[np.arange(len(own)) % 5 > 0] = np.diag(SIGMAS**2)
    # The lever to what turned before is that of the pose as found.
    lever = np.tile(np.eye(7), (len(own), 1, 1))
    lever[:, 3:6, :3] = [-so3.skew(error) for error in errors[:, 3:6]]
    lever[:, 3:6, 6] = errors[:, 3:6]
    carried = lever @ path.covariances @ np.swapaxes(lever, 1, 2)
    return replace(path, world_from_cam=found, covariances=carried + own, own_covariances=own)


def shares(paths: list[PathSamples]) -> np.ndarray:
    """Shares (2, 4) of lengths and rotations within their 95 %, for each length of stretches."""
    found = [evaluate_stretches(path) for path in paths]
    return np.array(
        [
            [
                np.sum([getattr(figures[k], kind).inside for figures in found])
                / np.sum([getattr(figures[k], kind).count for figures in found])
                for k in range(len(STRETCH_SHARES))
            ]
            for kind in ("lengths", "rotations")
        ]
    )


@pytest.fixture(scope="module")
def walks() -> list[PathSamples]:
    return [drawn_path(segments=1, count=150, seed=seed) for seed in range(PATHS)]


def test_honest_covariances_hold_95_of_a_hundred(walks: list[PathSamples]):
    assert np.abs(shares(walks) - 0.95).max() < 0.02


def test_errors_of_frames_between_keyframes_are_theirs_alone(walks: list[PathSamples]):
    rng = np.random.default_rng(5)
    paths = [located_between_keyframes(path, rng) for path in walks]
    assert np.abs(shares(paths) - 0.95).max() < 0.02
    # Where they are not told apart, short stretches are said to be surer than they are.
    untold = shares([replace(path, own_covariances=None) for path in paths])
    assert untold[1, 0] < 0.8
    assert abs(untold[1, -1] - 0.95) < 0.03


@pytest.mark.parametrize(("factor", "low", "high"), [(0.5, 0.0, 0.9), (2.0, 0.97, 1.0)])
def test_sigmas_that_are_off_by_the_root_of_two_show(
    walks: list[PathSamples], factor: float, low: float, high: float
):
    found = shares([replace(path, covariances=factor * path.covariances) for path in walks])
    assert found.min() >= low
    assert found.max() <= high


def only(path: PathSamples, share: float = 0.05) -> StretchFigure:
    (figure,) = evaluate_stretches(path, (share,))
    return figure


def test_a_scale_that_changes_unsaid_shows_in_lengths_alone():
    path = drawn_path(segments=1, count=150)
    truth = path.truth.copy()
    truth[75:, :3, 3] = truth[75, :3, 3] + 1.5 * (truth[75:, :3, 3] - truth[75, :3, 3])
    figure = only(replace(path, truth=truth), 0.1)
    assert figure.lengths.share < 0.2
    assert figure.rotations.share > 0.85


def test_neither_the_world_nor_the_unit_of_the_truth_matters():
    path = drawn_path(segments=2, count=60)
    moved = path.truth.copy()
    moved[:, :3, 3] *= 7.0
    turned = np.eye(4)
    turned[:3, :3], turned[:3, 3] = so3.exp([0.3, -0.4, 2.0]), [4.0, 5.0, 6.0]
    here, there = only(path), only(replace(path, truth=turned @ moved))
    assert there.length == pytest.approx(7.0 * here.length)
    assert (there.lengths, there.rotations) == (here.lengths, here.rotations)


def test_no_stretch_reaches_over_the_end_of_a_segment():
    path = drawn_path(segments=4, count=20)
    assert only(path, 0.2).rotations.count > 0
    assert only(path, 0.3).rotations.count == 0


def test_poses_without_truth_or_covariance_are_left_out():
    path = drawn_path(segments=1, count=40)
    truth, covariances = path.truth.copy(), path.covariances.copy()
    truth[10], covariances[20] = np.nan, np.nan
    holed = only(replace(path, truth=truth, covariances=covariances))
    assert 0 < holed.rotations.count <= only(path).rotations.count
    assert evaluate_stretches(replace(path, truth=np.full_like(path.truth, np.nan))) == ()


def test_truth_of_rotations_alone_parts_the_poses():
    path = drawn_path(segments=1, count=100)
    truth = path.truth.copy()
    truth[:, :3, 3] = 0.0
    figure = only(replace(path, truth=truth))
    assert np.isnan(figure.length)
    assert (figure.lengths.count, figure.rotations.count) == (0, 96)
    assert figure.rotations.share > 0.85


def test_repeated_poses_are_exact():
    path = drawn_path(segments=1, count=40)
    twice = np.repeat(np.arange(41), 2)
    both = PathSamples(
        **{name: column[twice] for name, column in vars(path).items() if column is not None}
    )
    figure = only(both)
    assert figure.rotations.share > 0.8
    assert figure.lengths.share > 0.8
