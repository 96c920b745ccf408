"""Every wrong argument raises InputError with its name; none becomes a status."""

from __future__ import annotations

import numpy as np
import pytest

from farpoint import (
    RelativePoseOptions,
    estimate_relative_pose,
    estimate_relative_pose_from_rays,
)
from farpoint.errors import InputError
from farpoint.synthetic import paper_camera

N = 12
GOOD = np.random.default_rng(0).uniform(0.0, 400.0, (N, 2))
RAYS = np.random.default_rng(1).normal(size=(N, 3))
ROUND = np.tile(np.eye(2), (N, 1, 1))


def with_entry(array: np.ndarray, value: float) -> np.ndarray:
    array = array.copy()
    array[(3,) + (0,) * (array.ndim - 1)] = value
    return array


BAD_POINTS = {
    "scalar": 3.0,
    "None": None,
    "flat": GOOD.ravel(),
    "one more axis": GOOD[None],
    "one column": GOOD[:, :1],
    "homogeneous": np.c_[GOOD, np.ones(N)],
    "transposed": GOOD.T,
    "ragged": [[1.0, 2.0], [3.0]],
    "text": [["a", "b"]] * N,
    "objects": np.full((N, 2), {}),
    "complex": GOOD + 1j,
    "nan": with_entry(GOOD, np.nan),
    "inf": with_entry(GOOD, np.inf),
    "minus inf": with_entry(GOOD, -np.inf),
}


def assert_named(error: pytest.ExceptionInfo[InputError], field: str) -> None:
    assert isinstance(error.value, ValueError)
    assert error.value.field == field
    message = str(error.value)
    assert message.startswith(f"{field}: ")
    assert "expected" in message
    assert "\n" not in message


@pytest.mark.parametrize("bad", BAD_POINTS.values(), ids=BAD_POINTS.keys())
@pytest.mark.parametrize("field", ["points0", "points1"])
def test_points(field, bad):
    points = {"points0": GOOD, "points1": GOOD, field: bad}
    with pytest.raises(InputError) as error:
        estimate_relative_pose(**points, camera0=paper_camera())
    assert_named(error, field)


def test_the_error_names_the_expected_and_the_given_shape():
    with pytest.raises(InputError, match=r"points0: expected shape \(N, 2\), got \(12, 3\)"):
        estimate_relative_pose(RAYS, GOOD, paper_camera())
    with pytest.raises(InputError, match=r"points1: expected shape \(12, 2\), got \(11, 2\)"):
        estimate_relative_pose(GOOD, GOOD[1:], paper_camera())


@pytest.mark.parametrize("count", [0, 7])
def test_too_few_points_do_not_excuse_a_wrong_count(count):
    with pytest.raises(InputError, match="points1"):
        estimate_relative_pose(GOOD[:count], GOOD, paper_camera())


BAD_RAYS = {
    "pixels": GOOD,
    "nan": with_entry(RAYS, np.nan),
    "inf": with_entry(RAYS, np.inf),
    "zero": RAYS * (np.arange(N) != 4)[:, None],
    "text": "rays",
    "complex": RAYS * 1j,
    "count": RAYS[1:],
}


@pytest.mark.parametrize("bad", BAD_RAYS.values(), ids=BAD_RAYS.keys())
@pytest.mark.parametrize("field", ["rays0", "rays1"])
def test_rays(field, bad):
    rays = {"rays0": RAYS, "rays1": RAYS, field: bad}
    # Of two counts the second one is the odd one out.
    named = "rays1" if len(bad) == N - 1 else field
    with pytest.raises(InputError) as error:
        estimate_relative_pose_from_rays(**rays, noise_rad=1e-3)
    assert_named(error, named)


@pytest.mark.parametrize("bad", [0.0, -1e-3, np.nan, np.inf, None, "small", np.ones(N)], ids=str)
def test_noise_of_rays(bad):
    with pytest.raises(InputError) as error:
        estimate_relative_pose_from_rays(RAYS, RAYS, noise_rad=bad)
    assert_named(error, "noise_rad")


BAD_COVARIANCES = {
    "variances": np.ones((N, 2)),
    "one for all": np.eye(2),
    "count": ROUND[1:],
    "3x3": np.tile(np.eye(3), (N, 1, 1)),
    "nan": with_entry(ROUND, np.nan),
    "inf": with_entry(ROUND, np.inf),
    "one zero": ROUND * (np.arange(N) != 4)[:, None, None],
    "all zero": 0.0 * ROUND,
    "one negative": ROUND * np.where(np.arange(N) == 4, -1.0, 1.0)[:, None, None],
    "all negative": -ROUND,
    "singular": np.ones((N, 2, 2)),
    "not symmetric": np.tile([[1.0, 0.9], [0.0, 1.0]], (N, 1, 1)),
    "text": "round",
}


@pytest.mark.parametrize("bad", BAD_COVARIANCES.values(), ids=BAD_COVARIANCES.keys())
@pytest.mark.parametrize("field", ["covariance0_px2", "covariance1_px2"])
def test_covariances(field, bad):
    with pytest.raises(InputError) as error:
        estimate_relative_pose(GOOD, GOOD, paper_camera(), **{field: bad})
    assert_named(error, field)


@pytest.mark.parametrize("bad", [1.5, None, "0", np.nan, [1], np.array([1])], ids=str)
def test_seed(bad):
    with pytest.raises(InputError) as error:
        estimate_relative_pose(GOOD, GOOD, paper_camera(), seed=bad)
    assert_named(error, "seed")


BAD_OPTIONS = [
    ("matching_tolerance_px", 0.0),
    ("matching_tolerance_px", -1.0),
    ("matching_tolerance_px", np.nan),
    ("matching_tolerance_px", np.inf),
    ("matching_tolerance_px", None),
    ("matching_tolerance_px", "1.5"),
    ("flow_saturation_px", 0.0),
    ("flow_saturation_px", np.nan),
    ("confidence", 0.0),
    ("confidence", 1.0),
    ("confidence", np.nan),
    ("confidence", "high"),
    ("false_alarm_rate", 0.0),
    ("false_alarm_rate", 1.5),
    ("min_iterations", -1),
    ("min_iterations", 2.5),
    ("min_iterations", None),
    ("refine", "no"),
    ("count_sharing", 1),
]


@pytest.mark.parametrize(("field", "value"), BAD_OPTIONS, ids=str)
def test_options_out_of_range(field, value):
    with pytest.raises(InputError) as error:
        RelativePoseOptions(**{field: value})
    assert_named(error, field)


def test_a_maximum_below_the_minimum_names_both():
    with pytest.raises(InputError, match="min_iterations <= max_iterations"):
        RelativePoseOptions(min_iterations=100, max_iterations=99)


def test_an_unknown_option_is_not_ignored():
    with pytest.raises(TypeError, match="matching_tolerence_px"):
        RelativePoseOptions(matching_tolerence_px=2.0)  # pyright: ignore[reportCallIssue]


def test_options_and_extras_are_named_not_counted():
    with pytest.raises(TypeError):
        RelativePoseOptions(1.5)  # pyright: ignore[reportCallIssue]
    with pytest.raises(TypeError):
        estimate_relative_pose_from_rays(RAYS, RAYS, 1e-3)  # pyright: ignore[reportCallIssue]


def test_options_cannot_be_changed_afterwards():
    with pytest.raises(AttributeError):
        RelativePoseOptions().refine = False  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("bad", [None, "camera.yaml", np.eye(3)], ids=["None", "path", "matrix"])
def test_a_camera_that_is_none(bad):
    with pytest.raises(InputError) as error:
        estimate_relative_pose(GOOD, GOOD, bad)
    assert_named(error, "camera0")
