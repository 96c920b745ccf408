"""Lenses as functions of their parameters: derivatives, other values, and what is no lens."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from lens_checks import pixel_grid, whole_rows_are_nan
from lens_collection import CENTRE, FAR_FOCAL, FOCAL, LENSES

from farpoint.camera import (
    Arctangent,
    CameraModel,
    Division,
    DoubleSphere,
    Equirectangular,
    ExtendedUnified,
    KannalaBrandt,
    Pinhole,
    Scaramuzza,
    Unified,
)
from farpoint.errors import InputError

ALL_14 = (-0.21, 0.06, 8e-4, -5e-4, 0.01, 0.02, -0.03, 0.004, 1e-3, -2e-3, 5e-4, 1e-3, 0.03, -0.02)
LENSES = LENSES | {
    "pinhole, no tilt": Pinhole(**FOCAL, distortion=(*ALL_14[:12], 0.0, 0.0)),
    "pinhole, tilted": Pinhole(**FOCAL, distortion=ALL_14),
    "pinhole, prism": Pinhole(**FOCAL, distortion=ALL_14[:12]),
    "pinhole, rational": Pinhole(**FOCAL, distortion=ALL_14[:8]),
    "pinhole, five": Pinhole(**FOCAL, distortion=ALL_14[:5]),
    "pinhole, zeros": Pinhole(**FOCAL, distortion=(0.0,) * 14),
    "mei, tilted": Unified(**FAR_FOCAL, xi=1.7, distortion=ALL_14, skew=-0.4),
    "arctangent, nearly a pinhole": Arctangent(**FOCAL, omega=0.01),
}


@pytest.fixture(params=LENSES)
def lens(request: pytest.FixtureRequest) -> CameraModel:
    return LENSES[request.param]


def steps_of(lens: CameraModel) -> np.ndarray:
    """Changes of the parameters that each move the pixels of the image by up to 1e-3 px."""
    rays = lens.unproject(pixel_grid((640, 480), 33))
    rays = rays[np.isfinite(rays[:, 0])]
    before, steps = lens.project(rays), []
    for name, value in lens.parameters.items():
        is_power = name[0] == "a" and name[1:].isdigit()
        tiny = 1e-6 * 200.0 ** (1 - int(name[1:])) if is_power else 1e-8
        moved = lens.with_parameters({name: value + tiny}).project(rays) - before
        steps.append(tiny * 1e-3 / np.nanmax(np.abs(moved)))
    return np.array(steps)


def by_differences(lens: CameraModel, method: str, rows: np.ndarray) -> np.ndarray:
    """Central differences (N, 2 or 3, P) of a method of the lens by its parameters."""
    values, steps = np.array(list(lens.parameters.values())), steps_of(lens)
    columns = []
    for step in np.diag(steps):
        ahead, behind = (
            getattr(lens.with_parameters(values + sign * step), method)(rows) for sign in (1, -1)
        )
        columns.append((ahead - behind) / (2 * step.sum()))
    return np.stack(columns, axis=-1)


def assert_parameter_jacobians_hold(
    lens: CameraModel, pixels: np.ndarray, tolerance: float = 1e-6
) -> int:
    """Both Jacobians against central differences; the number of pixels that could be compared."""
    rays = lens.unproject(pixels)
    depths = np.linspace(0.5, 3.0, len(rays))[:, None]
    pairs = (
        (lens.project_parameter_jacobian(rays * depths), by_differences(lens, "project", rays)),
        (
            lens.unproject_parameter_jacobian(rays * depths),
            by_differences(lens, "unproject", pixels),
        ),
    )
    steps = steps_of(lens)
    seen = np.isfinite(pairs[0][1]).all(axis=(1, 2)) & np.isfinite(pairs[1][1]).all(axis=(1, 2))
    for analytic, numeric in pairs:
        assert analytic.shape == numeric.shape
        assert np.isfinite(analytic[seen]).all()
        # In units of the steps, whose effects on the image are alike.
        effect, expected = analytic[seen] * steps, numeric[seen] * steps
        size = np.abs(expected).max(axis=(0, 1))
        scale = np.maximum(size, 1e-3 * size.max())
        np.testing.assert_allclose(effect / scale, expected / scale, rtol=0, atol=tolerance)
    return int(seen.sum())


def away_from_rim(lens: CameraModel, count: int, seed: int) -> np.ndarray:
    """Random pixels of the image, without those near the rim where derivatives have no bound."""
    pixels = np.random.default_rng(seed).uniform([0, 0], [639, 479], (count, 2))
    rays = lens.unproject(pixels)
    pixels, rays = pixels[np.isfinite(rays[:, 0])], rays[np.isfinite(rays[:, 0])]
    slopes = lens.unproject_jacobian(rays), lens.project_jacobian(rays)
    sizes = [np.linalg.norm(slope, axis=(1, 2)) for slope in slopes]
    return pixels[np.all([size < 4 * size.min(initial=np.inf) for size in sizes], axis=0)]


def test_derivatives_match_central_differences(lens: CameraModel) -> None:
    pixels = away_from_rim(lens, 400, 1)
    assert assert_parameter_jacobians_hold(lens, pixels) > 100


def test_all_derivatives_at_once_are_the_same(lens: CameraModel) -> None:
    rays = np.random.default_rng(0).normal(size=(100, 3))
    rays[0] = 0.0, 0.0, -1.0
    pixels, by_point, by_parameters = lens.linearised(rays)
    np.testing.assert_array_equal(pixels, lens.project(rays))
    np.testing.assert_array_equal(by_point, lens.project_jacobian(rays))
    np.testing.assert_array_equal(by_parameters, lens.project_parameter_jacobian(rays))


def test_derivatives_hold_on_the_axis_and_beside_it(lens: CameraModel) -> None:
    axis_px = lens.project(np.array([[0.0, 0.0, 1.0]]))[0]
    steps = np.array([[0, 0], [1e-8, 1e-8], [0, 1e-5], [1e-2, 0]])
    assert assert_parameter_jacobians_hold(lens, axis_px + steps) == 4


def test_derivatives_hold_at_the_border(lens: CameraModel) -> None:
    """At the image's border, or where the field ends before it."""
    axis_px = lens.project(np.array([[0.0, 0.0, 1.0]]))[0]
    border = pixel_grid((640, 480), 9)
    border = border[(np.abs(border - [319.5, 239.5]) > [319, 239]).any(axis=1)]
    shares = np.linspace(0.3, 1.0, 200)[:, None, None]
    lines = axis_px + shares * (border - axis_px)
    seen = np.isfinite(lens.unproject(lines.reshape(-1, 2))[:, 0]).reshape(len(shares), -1)
    last = len(shares) - 1 - np.argmax(seen[::-1], axis=0)
    # Half a per cent short of the rim.
    pixels = lines[np.maximum(last - 1, 0), np.arange(len(border))]
    assert assert_parameter_jacobians_hold(lens, pixels, tolerance=1e-4) > 20


def test_unseen_points_have_no_derivative(lens: CameraModel) -> None:
    points = np.random.default_rng(0).normal(size=(3000, 3))
    points[:2] = [[0, 0, 0], [np.nan, 0, 1]]
    unseen = np.isnan(lens.project(points)[:, 0])
    jacobian = lens.project_parameter_jacobian(points)
    assert jacobian.shape == (3000, 2, len(lens.parameters))
    assert whole_rows_are_nan(jacobian)
    np.testing.assert_array_equal(np.isnan(jacobian[:, 0, 0]), unseen)
    jacobian = lens.unproject_parameter_jacobian(points)
    assert jacobian.shape == (3000, 3, len(lens.parameters))
    assert whole_rows_are_nan(jacobian)
    np.testing.assert_array_equal(np.isnan(jacobian[:, 0, 0]), unseen)


def test_a_rays_derivative_is_perpendicular_to_it(lens: CameraModel) -> None:
    rays = lens.unproject(pixel_grid((640, 480), 15))
    rays = rays[np.isfinite(rays[:, 0]) & (np.abs(rays[:, 1]) < 1 - 1e-9)]
    jacobian = lens.unproject_parameter_jacobian(rays)
    along = np.einsum("ni,nij->nj", rays, jacobian) * steps_of(lens)
    np.testing.assert_allclose(along, 0, atol=1e-16)


def test_batches_of_any_length(lens: CameraModel) -> None:
    rays = np.random.default_rng(5).normal([0, 0, 3], 0.5, (8200, 3))
    some = [0, 4000, 8199]
    whole = lens.project_parameter_jacobian(rays)[some]
    np.testing.assert_allclose(whole, lens.project_parameter_jacobian(rays[some]), rtol=1e-13)
    count = len(lens.parameters)
    assert lens.project_parameter_jacobian(np.empty((0, 3))).shape == (0, 2, count)
    assert lens.unproject_parameter_jacobian(np.empty((0, 3))).shape == (0, 3, count)


def test_parameters_make_the_same_lens(lens: CameraModel) -> None:
    assert lens.with_parameters(np.array(list(lens.parameters.values()))) == lens
    assert lens.with_parameters(lens.parameters) == lens
    assert lens.with_parameters({}) == lens


def test_with_parameters_sets_each_by_place_and_by_name(lens: CameraModel) -> None:
    names = list(lens.parameters)
    values = np.array(list(lens.parameters.values())) + steps_of(lens)
    expected = dict(zip(names, values, strict=True))
    for other in (lens.with_parameters(values), lens.with_parameters(expected)):
        assert type(other) is type(lens)
        assert other.parameters == expected
    for name in names:
        other = lens.with_parameters({name: expected[name]})
        assert other.parameters == lens.parameters | {name: expected[name]}


def test_zeros_stay_parameters() -> None:
    """A coefficient or a skew that becomes zero does not shorten the vector."""
    lens = LENSES["mei"]
    zeros = dict.fromkeys(("k1", "k2", "p1", "p2", "skew"), 0.0)
    assert list(lens.with_parameters(zeros).parameters) == list(lens.parameters)


def test_with_parameters_names_what_is_wrong(lens: CameraModel) -> None:
    names, values = list(lens.parameters), list(lens.parameters.values())
    with pytest.raises(InputError, match=rf"values: expected shape \({len(names)},\)"):
        lens.with_parameters(np.array(values[:-1]))
    with pytest.raises(InputError, match=rf"values: expected shape \({len(names)},\)"):
        lens.with_parameters(np.array([values]))
    with pytest.raises(InputError, match="values: unknown parameter 'focal'"):
        lens.with_parameters({"focal": 3.0})
    for index, name in enumerate(names):
        for bad in (math.nan, math.inf, None, "wide"):
            with pytest.raises(InputError, match=f"^{name}: expected"):
                lens.with_parameters({name: bad})  # type: ignore[dict-item]
        broken = np.array(values)
        broken[index] = math.nan
        with pytest.raises(InputError, match=f"^{name}: expected"):
            lens.with_parameters(broken)


@pytest.mark.parametrize(
    ("lens", "name", "value"),
    [
        (LENSES["pinhole"], "fx", 0.0),
        (LENSES["kannala-brandt"], "fy", -200.0),
        (LENSES["eucm"], "alpha", 1.01),
        (LENSES["eucm"], "beta", 0.0),
        (LENSES["double sphere"], "xi", -1.5),
        (LENSES["unified, weak"], "xi", -0.1),
        (LENSES["arctangent"], "omega", 3.2),
        (LENSES["division, barrel"], "k", 1e7),
        (LENSES["scaramuzza fisheye"], "a0", 5.0),
        (LENSES["scaramuzza fisheye"], "c", 0.0),
        (LENSES["equirectangular"], "width", 0.0),
        (LENSES["pinhole, tilted"], "k4", 1e13),
    ],
)
def test_values_that_make_no_lens(lens: CameraModel, name: str, value: float) -> None:
    with pytest.raises(InputError, match="expected"):
        lens.with_parameters({name: value})


def test_refinable_is_the_same_lens_with_its_parameters(lens: CameraModel) -> None:
    pixels = pixel_grid((640, 480), 15)
    refinable = lens.refinable()
    np.testing.assert_array_equal(refinable.unproject(pixels), lens.unproject(pixels))
    names = list(refinable.parameters)
    assert names[: len(lens.parameters)] == list(lens.parameters)
    assert refinable.refinable() == refinable


def test_a_pinhole_without_distortion_is_refined_by_four_coefficients() -> None:
    lens = Pinhole(**FOCAL)
    assert list(lens.refinable().parameters) == ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"]
    assert lens.refinable().with_parameters({"k1": -0.2}) == Pinhole(
        **FOCAL, distortion=(-0.2, 0, 0, 0)
    )
    five = LENSES["pinhole, five"]
    assert five.refinable() == five


def small(bound: float) -> st.SearchStrategy[float]:
    return st.floats(-bound, bound)


def coefficients(count: int) -> st.SearchStrategy[tuple[float, ...]]:
    bounds = (0.3, 0.1, 0.01, 0.01, 0.05, 0.3, 0.1, 0.05, 0.01, 0.01, 0.01, 0.01, 0.2, 0.2)
    return st.tuples(*(small(bound) for bound in bounds[:count]))


focal = {"fx": st.floats(250, 900), "fy": st.floats(250, 900)}
focal |= {"cx": st.floats(200, 440), "cy": st.floats(150, 330)}
distortions = st.sampled_from([4, 5, 8, 12, 14]).flatmap(coefficients)
ANY_LENS = st.one_of(
    st.builds(Pinhole, **focal, distortion=distortions),
    st.builds(Unified, **focal, xi=st.floats(0.01, 3), distortion=distortions, skew=small(3)),
    st.builds(
        KannalaBrandt, **focal, k1=small(0.05), k2=small(0.02), k3=small(0.01), k4=small(0.003)
    ),
    st.builds(ExtendedUnified, **focal, alpha=st.floats(0.01, 0.99), beta=st.floats(0.3, 3)),
    st.builds(DoubleSphere, **focal, xi=small(0.9), alpha=st.floats(0.01, 0.99)),
    st.builds(Arctangent, **focal, omega=st.floats(0.01, 3)),
    st.builds(Division, **focal, k=small(1)),
    st.builds(
        Scaramuzza,
        coefficients=st.tuples(st.floats(-600, -150), small(0.1), small(2e-3), small(5e-6)),
        **{name: st.just(value) for name, value in CENTRE.items()},
        c=st.floats(0.9, 1.1),
        d=small(0.1),
        e=small(0.1),
    ),
    st.builds(Equirectangular, width=st.floats(640, 700), height=st.floats(480, 500)),
)


@settings(max_examples=100, deadline=None)
@given(lens=ANY_LENS, seed=st.integers(0, 1000))
def test_derivatives_of_any_lens(lens: CameraModel, seed: int) -> None:
    pixels = away_from_rim(lens, 300, seed)[:40]
    assume(len(pixels) > 3)
    assert_parameter_jacobians_hold(lens, pixels, tolerance=1e-5)
