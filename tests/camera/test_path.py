"""Paths on the sphere in the image: on the arc, whole, cut at the rim, split at the seam."""

from __future__ import annotations

import numpy as np
import pytest
from lens_checks import whole_rows_are_nan

from farpoint.camera import (
    Camera,
    CameraModel,
    DoubleSphere,
    Equirectangular,
    KannalaBrandt,
    Pinhole,
    Unified,
    project_path,
)
from farpoint.errors import InputError

CENTRE = {"cx": 318.7, "cy": 241.3}
FOCAL = {"fx": 191.5, "fy": 189.2, **CENTRE}
LENSES: dict[str, CameraModel] = {
    "pinhole": Pinhole(**FOCAL),
    "pinhole radtan": Pinhole(**FOCAL, distortion=(-0.2, 0.05, 1e-3, 0)),
    "kannala-brandt": KannalaBrandt(**FOCAL, k1=0.003, k2=7e-4, k3=-0.002, k4=2e-4),
    "double sphere": DoubleSphere(**FOCAL, xi=-0.17, alpha=0.59),
    "unified": Unified(**FOCAL, xi=1.0),
    "equirectangular": Equirectangular(width=640, height=480),
}


@pytest.fixture(params=LENSES)
def camera(request: pytest.FixtureRequest) -> Camera:
    return Camera(model=LENSES[request.param], size=(640, 480))


def great_circle(normal: np.ndarray, corners: int) -> np.ndarray:
    """Corners (K, 3) around the circle perpendicular to a vector; the last is the first."""
    first = np.cross(normal, [0.3, -0.5, 0.8])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first) / np.linalg.norm(normal)
    turn = np.linspace(0.0, 2.0 * np.pi, corners)[:, None]
    return np.cos(turn) * first + np.sin(turn) * second


def normals() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(8, 3))


def distance_to_line(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distances (N,) of points (N, 2) to the nearest of the segments of a broken line (M, 2)."""
    start, step = line[:-1], np.diff(line, axis=0)
    whole = np.isfinite(step[:, 0])
    start, step = start[whole], step[whole]
    length2 = np.maximum(np.sum(step**2, axis=1), 1e-30)
    along = np.clip(np.sum((points[:, None] - start) * step, axis=2) / length2, 0.0, 1.0)
    nearest = start + along[..., None] * step
    return np.linalg.norm(points[:, None] - nearest, axis=2).min(axis=1)


@pytest.mark.parametrize("corners", [4, 5, 361])
def test_line_is_the_great_circle_where_it_is_seen(camera: Camera, corners: int) -> None:
    """Against the same circle, projected at 2,000 points without any cleverness."""
    for normal in normals():
        fine = camera.project(great_circle(normal, 2001))
        inside = fine[np.all((fine > -0.5) & (fine < [639.5, 479.5]), axis=1)]
        line = project_path(camera, great_circle(normal, corners))
        if len(inside):
            assert distance_to_line(inside, line).max() < 0.4


def test_line_of_a_large_picture_follows_the_circle() -> None:
    camera = Camera(model=Equirectangular(width=7680, height=3840), size=(7680, 3840))
    for normal in normals()[:3]:
        fine = camera.project(great_circle(normal, 5001))
        line = project_path(camera, great_circle(normal, 4))
        assert distance_to_line(fine, line).max() < 0.4


def test_nothing_is_drawn_that_is_not_on_the_circle(camera: Camera) -> None:
    for normal in normals():
        line = project_path(camera, great_circle(normal, 4))
        middles = (line[:-1] + line[1:]) / 2.0
        middles = middles[np.isfinite(middles[:, 0])]
        rays = camera.unproject(middles)
        off = np.abs(rays @ normal) / np.linalg.norm(normal)
        assert len(line) == 0 or whole_rows_are_nan(line)
        # A pixel of these lenses is a hundredth of a radian at most.
        assert np.nanmax(off, initial=0.0) < 0.01


def test_line_is_coarse_where_it_may_be(camera: Camera) -> None:
    for normal in normals():
        assert len(project_path(camera, great_circle(normal, 4))) < 600


def test_straight_line_of_a_pinhole_is_cut_beyond_the_image() -> None:
    camera = Camera(model=LENSES["pinhole"], size=(640, 480))
    line = project_path(camera, np.array([[-1.0, 0.0, 1e-9], [0.0, 0.0, 1.0], [1.0, 0.0, 1e-9]]))
    assert np.abs(line[:, 1] - CENTRE["cy"]).max() < 1e-9
    assert line[[0, -1], 0] == pytest.approx([-640.0, 1280.0], abs=1.0)
    endless = project_path(Camera(model=camera.model), np.array([[-1.0, 0.0, 1e-9], [0, 0, 1.0]]))
    assert endless[0, 0] < -1e10


def test_line_goes_up_to_the_rim_of_the_field() -> None:
    lens = Unified(**FOCAL, xi=1.5)  # sees to acos(-1 / 1.5), 131.8 degrees
    camera = Camera(model=lens, size=(1200, 1200))
    end = np.arccos(-1.0 / 1.5)
    line = project_path(camera, np.array([[0, 0, 1.0], [1.0, 0, -0.2], [0.2, 0, -1.0]]))
    assert not np.isnan(line).any()
    rim_px = camera.project(np.array([[np.sin(end - 1e-9), 0.0, np.cos(end - 1e-9)]]))[0]
    assert np.abs(line[-1] - rim_px).max() < 0.5


def test_circle_around_the_backward_direction_is_split_at_the_seam() -> None:
    camera = Camera(model=LENSES["equirectangular"], size=(640, 480))
    turn = np.linspace(0.0, 2.0 * np.pi, 9)
    ring = np.column_stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), np.full(9, -1.0)])
    line = project_path(camera, ring)
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert np.nanmax(steps) < 30.0
    assert np.isnan(line[:, 0]).sum() == 2
    edges = np.flatnonzero(np.isnan(line[:, 0]))
    beside = np.sort(line[[edges[0] - 1, edges[0] + 1, edges[1] - 1, edges[1] + 1], 0])
    np.testing.assert_allclose(beside, [-0.5, -0.5, 639.5, 639.5], atol=0.05)


def test_many_paths_in_one_call(camera: Camera) -> None:
    """Rows of NaN part them: the lines are those of the single calls, one after the other."""
    rng = np.random.default_rng(1)
    starts = rng.normal(size=(50, 3))
    paths = np.stack([starts, starts + 0.2 * rng.normal(size=(50, 3))], axis=1)
    gap = np.full((50, 1, 3), np.nan)
    together = project_path(camera, np.concatenate([paths, gap], axis=1).reshape(-1, 3))
    single = [project_path(camera, path) for path in paths]
    parted = [np.vstack([line, np.full((1, 2), np.nan)]) for line in single if len(line)]
    np.testing.assert_array_equal(together, np.concatenate(parted)[:-1])


def test_length_of_rays_does_not_matter(camera: Camera) -> None:
    corners = great_circle(np.array([0.1, 1.0, 0.2]), 7)
    lengths = np.array([1e-3, 1.0, 5.0, 0.2, 1e6, 3.0, 1.0])[:, None]
    np.testing.assert_allclose(
        project_path(camera, lengths * corners), project_path(camera, corners), atol=1e-6
    )


def test_empty_and_wrong_paths(camera: Camera) -> None:
    assert project_path(camera, np.empty((0, 3))).shape == (0, 2)
    assert project_path(camera, np.full((4, 3), np.nan)).shape == (0, 2)
    assert project_path(camera, np.array([[0, 0, 1.0]])).shape == (1, 2)
    with pytest.raises(InputError) as caught:
        project_path(camera, np.zeros((3, 2)))
    assert caught.value.field == "rays"
