"""The covariance of a path is judged in its own gauge, and by as much as chance allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from path_kit import drawn_path

from farpoint.geometry import so3
from farpoint.metrics import PathConsistency, PathSamples, evaluate_path

FIGURES = ("orientation", "position", "pose", "position_any_scale", "scale")


def found_of(samples: PathSamples) -> PathConsistency:
    found = evaluate_path(samples)
    assert found is not None
    return found


@pytest.mark.parametrize("starts_at_row", [True, False])
def test_honest_covariances_are_kept(starts_at_row: bool):
    found = found_of(drawn_path(starts_at_row=starts_at_row))
    for name in FIGURES:
        figure = getattr(found, name)
        assert figure.kept, name
        assert figure.nees_low < figure.end_nees < figure.nees_high, name
        assert figure.segments == 12
        assert figure.poses >= 12 * 37
    assert not found.unit_is_given
    assert 0.85 < found.lengths.coverage95.share < 1.0


@pytest.mark.parametrize("factor", [0.25, 4.0])
def test_covariances_that_are_off_by_four_are_flagged(factor: float):
    path = drawn_path()
    wrong = replace(
        path, covariances=factor * path.covariances, length_sigmas=factor**0.5 * path.length_sigmas
    )
    found = found_of(wrong)
    for name in FIGURES:
        figure = getattr(found, name)
        assert not figure.kept, name
        assert (figure.mean_nees > figure.nees_high) == (factor < 1.0), name
    assert found.lengths.sigma_over_error == pytest.approx(factor**0.5, rel=0.25)


def test_one_drive_alone_has_the_bounds_of_one_sample():
    figure = found_of(drawn_path(segments=1)).pose
    assert (figure.nees_low, figure.nees_high) == (
        pytest.approx(1.237, 1e-3),
        pytest.approx(14.45, 1e-3),
    )
    assert figure.kept


def test_neither_the_world_nor_the_unit_of_the_truth_matters():
    path = drawn_path(segments=3)
    world = np.eye(4)
    world[:3, :3], world[:3, 3] = so3.exp([1.0, 2.0, -0.5]), [-30.0, 4.0, 9.0]
    elsewhere = world @ path.truth
    elsewhere[:, :3, 3] *= 7.0
    one, other = found_of(path), found_of(replace(path, truth=elsewhere))
    for name in FIGURES:
        assert getattr(one, name).mean_nees == pytest.approx(getattr(other, name).mean_nees)
    assert one.lengths.mean_nees == pytest.approx(other.lengths.mean_nees)


def test_a_path_in_metres_answers_for_its_metres():
    path = drawn_path(segments=4, starts_at_row=True)
    # Metres told with an error of 2 %, along the whole way.
    begin = np.searchsorted(path.segments, path.segments)
    way = path.world_from_cam[:, :3, 3] - path.world_from_cam[begin, :3, 3]
    along = np.hstack([np.zeros((len(way), 3)), way, np.ones((len(way), 1))])
    metric = path.covariances + 0.02**2 * along[:, :, None] * along[:, None, :]
    units = np.array([_unit(path, number) for number in path.segments])
    truth = path.truth.copy()
    for number in np.unique(path.segments):
        rows = path.segments == number
        start = path.truth[rows][0, :3, 3]
        truth[rows, :3, 3] = start + (path.truth[rows, :3, 3] - start) / units[rows][:, None]
    given = replace(path, covariances=metric, truth=truth)
    found = found_of(given)
    assert found.unit_is_given
    assert found.position.mean_nees < found.position.nees_high
    twice = truth.copy()
    twice[:, :3, 3] *= 2.0
    wrong = found_of(replace(given, truth=twice))
    assert wrong.position.mean_nees > 10.0 * wrong.position.nees_high
    assert wrong.position_any_scale.mean_nees == pytest.approx(
        found.position_any_scale.mean_nees, rel=1e-6
    )


def _unit(path: PathSamples, number: int) -> float:
    first = int(np.searchsorted(path.segments, number))
    return float(np.linalg.norm(path.truth[first + 1, :3, 3] - path.truth[first, :3, 3]))


def test_poses_without_truth_or_covariance_are_left_out():
    path = drawn_path(segments=2)
    truth, covariances = path.truth.copy(), path.covariances.copy()
    truth[10:20] = np.nan
    covariances[30:35] = np.nan
    whole = found_of(path)
    found = found_of(replace(path, truth=truth, covariances=covariances))
    assert found.pose.poses == whole.pose.poses - 15
    # Lengths need truth at both ends.
    assert found.lengths.count == whole.lengths.count - 11 - 5
    truth[0] = np.nan  # a segment without its first pose has no gauge
    assert found_of(replace(path, truth=truth)).pose.segments == 1
    assert evaluate_path(replace(path, truth=np.full_like(truth, np.nan))) is None


def test_a_camera_that_never_moved_has_nothing_to_compare():
    still = drawn_path(segments=1)
    nowhere = np.tile(np.eye(4), (len(still.truth), 1, 1))
    assert evaluate_path(replace(still, world_from_cam=nowhere)) is None


def test_what_moves_before_the_first_length_is_not_the_unit():
    path = drawn_path(segments=3)
    starts = np.flatnonzero(np.isnan(path.lengths))
    # A frame more after the first of each segment, which is told no length and off by noise.
    rows = np.sort(np.concatenate([np.arange(len(path.lengths)), starts]))
    later = PathSamples(**{k: v[rows] for k, v in vars(path).items() if v is not None})
    noisy, also = later.world_from_cam.copy(), later.truth.copy()
    for row in starts + np.arange(len(starts)) + 1:
        noisy[row, :3, 3] += [1e-6, 0.0, 0.0]
        also[row, :3, 3] += [0.0, 1e-3, 0.0]
    before = np.searchsorted(rows, path.length_from[rows], side="right") - 1
    found = found_of(replace(later, world_from_cam=noisy, truth=also, length_from=before))
    assert not found.unit_is_given
    assert found.position == found_of(path).position
    assert found.scale == found_of(path).scale
