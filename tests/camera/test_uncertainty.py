"""How far a calibration may be off: from general terms to a covariance of the parameters."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from lens_collection import FOCAL, LENSES

from farpoint.camera import (
    Camera,
    CameraUncertainty,
    ExtendedUnified,
    HorizontalField,
    KannalaBrandt,
    Pinhole,
    Unified,
    covariance_factor,
    describe,
)
from farpoint.errors import InputError

SIZE = (640, 480)
CORNERS = np.array([(0, 0), (639, 0), (0, 479), (639, 479)], dtype=float)
LENSES = LENSES | {
    "all coefficients": Pinhole(
        **FOCAL, distortion=(-0.02, 0.003, 0, 0, 0, 0.01, 0, 0, 0, 0, 0, 0, 0, 0)
    ),
}
# With a constant f the toolbox's polynomial has no distortion, and 360 degrees have no parameter.
DISTORTING = {
    name: lens
    for name, lens in LENSES.items()
    if name not in ("scaramuzza, endless", "equirectangular")
}
CENTRED = {name: lens for name, lens in LENSES.items() if name != "equirectangular"}


def displacements(camera: Camera, rays: np.ndarray) -> np.ndarray:
    """Displacements (r, N, 2), px, of rays by each independent error of 1 sigma."""
    lens = camera.model.refinable()
    given = np.array(list(lens.parameters.values()))
    moved = []
    for error in covariance_factor(camera.parameter_covariance()).T:
        # A tenth of it each way, so that what is not linear takes no part.
        ahead, behind = (lens.with_parameters(given + sign * 0.1 * error) for sign in (1, -1))
        moved.append((ahead.project(rays) - behind.project(rays)) / 0.2)
    return np.array(moved).reshape(-1, len(rays), 2)


def root_mean_square(displacements: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(displacements**2, axis=(0, 2)))))


@pytest.mark.parametrize("name", DISTORTING)
def test_distortion_moves_the_corners_by_what_is_given(name: str) -> None:
    camera = Camera(model=DISTORTING[name], size=SIZE).with_uncertainty(distortion_px=0.8)
    rays = camera.unproject(CORNERS)
    if np.isnan(rays).any():
        # The field of these ends before: it moves its rim.
        assert name in ("unified, strong", "mei")
        axis_px = camera.project(np.array([[0.0, 0.0, 1.0]]))
        shares = np.linspace(1, 0, 2000)[:, None, None]
        lines = camera.unproject((axis_px + shares * (CORNERS - axis_px)).reshape(-1, 2))
        lines = lines.reshape(2000, 4, 3)
        rays = lines[np.argmax(np.isfinite(lines[..., 0]), axis=0), np.arange(4)]
        rays += [0, 0, 1e-3]
    assert root_mean_square(displacements(camera, rays)) == pytest.approx(0.8, rel=0.02)


@pytest.mark.parametrize("name", DISTORTING)
def test_distortion_increases_from_the_centre(name: str) -> None:
    """No displacement and no change of scale on the axis, and less the nearer to it."""
    camera = Camera(model=DISTORTING[name], size=SIZE).with_uncertainty(distortion_px=0.8)
    axis_px = camera.project(np.array([[0.0, 0.0, 1.0]]))
    shares = np.array([0.0, 0.01, 0.2, 0.4, 0.6])
    found = []
    for share in shares:
        pixels = axis_px + share * (CORNERS - axis_px)
        found.append(root_mean_square(displacements(camera, camera.unproject(pixels))))
    assert found[0] < 1e-7
    assert found[1] < 1e-3 * 0.8
    assert np.all(np.diff(found) > 0)
    assert found[2] < 0.2 * 0.8


@pytest.mark.parametrize("name", CENTRED)
def test_focal_scales_the_image_about_its_centre(name: str) -> None:
    camera = Camera(model=CENTRED[name], size=SIZE).with_uncertainty(focal=0.005)
    axis_px = camera.project(np.array([[0.0, 0.0, 1.0]]))[0]
    for away in ([100.0, 0.0], [0.0, 100.0]):
        moved = displacements(camera, camera.unproject([axis_px + away]))[:, 0]
        along = np.linalg.norm(moved @ np.array(away)) / 100.0
        assert along == pytest.approx(0.5, rel=0.01)
        # Aspect ratio and shear are known far better.
        across = np.linalg.norm(moved @ np.array(away[::-1])) / 100.0
        assert across < 0.1


@pytest.mark.parametrize("name", CENTRED)
def test_scale_is_about_the_centre(name: str) -> None:
    lens = CENTRED[name]
    pixels = np.random.default_rng(4).uniform([200, 150], [440, 330], (50, 2))
    scale = np.array([lens.roles.scale.get(parameter, 0.0) for parameter in lens.parameters])
    moved = lens.project_parameter_jacobian(lens.unproject(pixels)) @ scale
    axis_px = lens.project(np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(moved, pixels - axis_px, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", CENTRED)
def test_every_parameter_has_a_role(name: str) -> None:
    """But for a turn of Scaramuzza's sensor, and the kink on its axis that it has not."""
    roles = CENTRED[name].roles
    deformed = {parameter for direction in roles.affine for parameter in direction}
    exact = set(CENTRED[name].parameters) - deformed - set(roles.scale)
    exact -= {*roles.center, *roles.radial, *roles.decentering}
    assert exact <= {"d"}
    sigmas = Camera(model=CENTRED[name], size=SIZE).with_uncertainty(
        focal=0.01, center_px=1.0, distortion_px=1.0
    )
    unknown = {name for name, sigma in sigmas.parameter_sigmas().items() if sigma == 0.0}
    assert unknown <= {"d", "a1"}


def test_focal_errors_of_x_and_y_are_one() -> None:
    camera = Camera(model=Pinhole(**FOCAL), size=SIZE).with_uncertainty(focal=0.005)
    covariance = camera.parameter_covariance()
    sigmas = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(sigmas[:2], [0.005 * FOCAL["fx"], 0.005 * FOCAL["fy"]], rtol=1e-12)
    assert 0.99 < covariance[0, 1] / (sigmas[0] * sigmas[1]) < 0.9999
    assert not covariance[2:].any()


@pytest.mark.parametrize("name", CENTRED)
def test_center_shifts_the_image(name: str) -> None:
    camera = Camera(model=CENTRED[name], size=SIZE).with_uncertainty(center_px=1.5)
    rays = camera.unproject([[300.0, 200.0], [350.0, 260.0]])
    moved = displacements(camera, rays)
    np.testing.assert_allclose(np.linalg.norm(moved, axis=0), 1.5, rtol=1e-9)
    assert moved.shape[0] == 2


def test_terms_add_up() -> None:
    camera = Camera(model=LENSES["kannala-brandt"], size=SIZE)
    terms = {"focal": 0.01, "center_px": 2.0, "distortion_px": 1.0}
    alone = [camera.with_uncertainty(**{name: value}) for name, value in terms.items()]
    total = camera.with_uncertainty(**terms).parameter_covariance()
    np.testing.assert_allclose(sum(one.parameter_covariance() for one in alone), total, rtol=1e-12)
    assert covariance_factor(total).shape == (8, 8)


@pytest.mark.parametrize("name", LENSES)
def test_an_exact_camera_has_no_covariance(name: str) -> None:
    camera = Camera(model=LENSES[name], size=SIZE)
    count = len(camera.model.refinable().parameters)
    assert camera.uncertainty is None
    assert camera.with_uncertainty(focal=0.1).with_uncertainty() == camera
    np.testing.assert_array_equal(camera.parameter_covariance(), np.zeros((count, count)))
    assert covariance_factor(camera.parameter_covariance()).shape == (count, 0)
    assert set(camera.parameter_sigmas().values()) == {0.0}


def test_a_360_degree_picture_is_exact() -> None:
    camera = Camera(model=LENSES["equirectangular"], size=SIZE)
    camera = camera.with_uncertainty(focal=0.1, center_px=3, distortion_px=2)
    assert not camera.parameter_covariance().any()


def test_parameters_without_effect_stay() -> None:
    """beta of an EUCM that is a pinhole moves nothing: any error would be as good as any other."""
    camera = Camera(model=ExtendedUnified(**FOCAL, alpha=0.0, beta=1.0), size=SIZE)
    camera = camera.with_uncertainty(distortion_px=1.0)
    assert camera.parameter_sigmas()["beta"] == 0.0
    assert camera.parameter_sigmas()["alpha"] > 0.0


def test_a_distortion_needs_the_size() -> None:
    camera = Camera(model=Pinhole(**FOCAL)).with_uncertainty(focal=0.01, distortion_px=1.0)
    with pytest.raises(InputError, match=r"^camera\.size: expected"):
        camera.parameter_covariance()
    assert "uncertainty (1 sigma): focal length 1 %, distortion at the corner 1 px" in describe(
        camera
    )
    assert camera.with_size(*SIZE).parameter_covariance()[4, 4] > 0.0
    assert Camera(model=Pinhole(**FOCAL)).with_uncertainty(focal=0.1).parameter_covariance().any()


@pytest.mark.parametrize("name", ["focal", "center_px", "distortion_px"])
@pytest.mark.parametrize("value", [0, -1.0, math.nan, math.inf, "much", [1.0]])
def test_terms_are_positive_numbers(name: str, value: object) -> None:
    camera = Camera(model=Pinhole(**FOCAL), size=SIZE)
    with pytest.raises(InputError, match=f"^{name}: expected"):
        camera.with_uncertainty(**{name: value})  # type: ignore[arg-type]


def test_a_covariance_is_given_back() -> None:
    lens = KannalaBrandt(**FOCAL)
    root = np.random.default_rng(3).normal(size=(8, 8)) * np.geomspace(1, 1e-5, 8)[:, None]
    camera = Camera(model=lens).with_parameter_covariance(root @ root.T)
    np.testing.assert_allclose(camera.parameter_covariance(), root @ root.T, rtol=1e-12)
    assert camera.uncertainty is not None
    assert hash(camera.uncertainty) == hash(camera.uncertainty)
    assert camera.with_uncertainty(focal=0.1).uncertainty == CameraUncertainty(focal=0.1)


def test_a_covariance_of_the_parameters_given_leaves_the_others_exact() -> None:
    camera = Camera(model=Pinhole(**FOCAL)).with_parameter_covariance(np.diag([4.0, 4, 1, 1]))
    np.testing.assert_array_equal(
        camera.parameter_covariance(), np.diag([4.0, 4, 1, 1, 0, 0, 0, 0])
    )
    refinable = replace(camera, model=camera.model.refinable())
    np.testing.assert_array_equal(refinable.parameter_covariance(), camera.parameter_covariance())
    whole = np.diag([4.0, 4, 1, 1, 1e-4, 1e-4, 1e-6, 1e-6])
    camera = camera.with_parameter_covariance(whole)
    np.testing.assert_array_equal(camera.parameter_covariance(), whole)


def test_sigmas_by_place_and_by_name() -> None:
    camera = Camera(model=Pinhole(**FOCAL))
    expected = dict.fromkeys(camera.model.refinable().parameters, 0.0) | {"fx": 2.0, "cy": 0.5}
    assert camera.with_parameter_sigmas([2, 0, 0, 0.5]).parameter_sigmas() == expected
    assert camera.with_parameter_sigmas({"fx": 2, "cy": 0.5}).parameter_sigmas() == expected
    found = camera.with_parameter_sigmas({"k1": 0.01}).parameter_sigmas()
    assert found["k1"] == pytest.approx(0.01, rel=1e-15)
    for bad, field in (
        ([1, 2], "sigmas: expected shape"),
        ({"f": 1}, "sigmas: unknown parameter 'f'"),
        ({"fx": -1}, "fx: expected no negative"),
        ({"fx": math.nan}, "fx: expected a finite"),
    ):
        with pytest.raises(InputError, match=field):
            camera.with_parameter_sigmas(bad)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("matrix", "problem"),
    [
        (np.eye(5), r"expected shape \(4, 4\) or \(8, 8\), got \(5, 5\)"),
        (np.eye(8)[:4], r"expected shape \(P, P\), got \(4, 8\)"),
        (np.ones(4), r"expected shape \(P, P\), got \(4,\)"),
        (np.diag([1, 1, 1, math.nan]), "finite"),
        (np.diag([1, 1, 1, -1.0]), "negative variance"),
        (np.eye(4) + np.eye(4, k=1), "symmetric"),
        (np.eye(4) + 2 * np.eye(4, k=1) + 2 * np.eye(4, k=-1), "semi-definite"),
        (np.diag([0.0, 1, 1, 1]) + 0.1 * (np.eye(4, k=1) + np.eye(4, k=-1)), "semi-definite"),
        (np.diag([0.0, 1, 1, 1]) + 1e-6 * (np.eye(4, k=1) + np.eye(4, k=-1)), "semi-definite"),
        ([[1, 2], [3]], "numbers"),
        ("large", r"expected"),
    ],
)
def test_what_is_no_covariance(matrix: np.ndarray, problem: str) -> None:
    camera = Camera(model=Pinhole(**FOCAL))
    with pytest.raises(InputError, match=f"^covariance: .*{problem}"):
        camera.with_parameter_covariance(matrix)


def test_a_covariance_takes_the_place_of_the_terms() -> None:
    with pytest.raises(InputError, match=r"^covariance: expected none beside focal"):
        CameraUncertainty(focal=0.1, covariance=((1.0,),))


def test_a_factor_keeps_small_parameters_and_drops_what_depends() -> None:
    factor = np.array([[3.0, 0.0], [6.0, 0.0], [0.0, 1e-9], [0.0, 0.0]])
    found = covariance_factor(factor @ factor.T)
    assert found.shape == (4, 2)
    np.testing.assert_allclose(found @ found.T, factor @ factor.T, rtol=1e-12, atol=0)


def test_a_guess_tells_how_far_it_is_off() -> None:
    """10 % of the focal length, 5 % of the corner's distance."""
    camera = HorizontalField(degrees=70.0).camera(640, 480)
    assert camera.uncertainty == CameraUncertainty(focal=0.1, distortion_px=20.0)
    fx = camera.model.parameters["fx"]
    assert camera.parameter_sigmas()["fx"] == pytest.approx(0.1 * fx, rel=0.01)


def test_a_readout_time() -> None:
    camera = Camera(model=Pinhole(**FOCAL))
    assert camera.readout_s is None
    rolling = camera.with_readout(0.021, 0.002)
    assert (rolling.readout_s, rolling.readout_sigma_s) == (0.021, 0.002)
    assert "read-out of a frame: 21 +- 2 ms" in describe(rolling)
    assert camera.with_readout(0).readout_sigma_s is None
    for values, field in (
        ((-0.1,), "readout_s"),
        ((math.nan,), "readout_s"),
        ((0.02, 0.0), "readout_sigma_s"),
        ((0.02, "some"), "readout_sigma_s"),
    ):
        with pytest.raises(InputError, match=f"^{field}: expected"):
            camera.with_readout(*values)  # type: ignore[arg-type]


def test_description_has_the_sigma_of_each_parameter() -> None:
    camera = Camera(model=Unified(**FOCAL, xi=1.0), size=SIZE)
    assert "+- " not in describe(camera)
    assert "xi = 1 +- 0.03" in describe(camera.with_parameter_sigmas({"xi": 0.03}))
    assert "cx = 318.7 +- 2\n" in describe(camera.with_uncertainty(center_px=2.0))
