"""Point scenes keep what their options promise, and their truth is true."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.geometry import sphere
from farpoint.synthetic import (
    OutlierKind,
    PointScene,
    PointSceneOptions,
    make_point_scene,
    paper_camera,
    paper_example,
    paper_protocol,
)

small = st.floats(-0.1, 0.1)


def epipolar_errors(scene: PointScene) -> np.ndarray:
    """Sine of the angle between each ray 1 and the epipolar plane of its ray 0."""
    rays0 = scene.camera.unproject(scene.points0)
    rays1 = scene.camera.unproject(scene.points1)
    normals = np.cross(scene.direction_cam1_from_cam0, rays0 @ scene.rotation_cam1_from_cam0.T)
    return np.sum(sphere.normalize(normals) * rays1, axis=1)


@settings(max_examples=40, deadline=None)
@given(
    rotation=st.tuples(small, small, small),
    translation=st.tuples(small, small, small),
    far_share=st.floats(0.0, 1.0),
    outliers=st.integers(0, 60),
    seed=st.integers(0, 2**32),
)
def test_a_scene_is_what_its_options_say(rotation, translation, far_share, outliers, seed):
    options = PointSceneOptions(
        camera=paper_camera(),
        matches=60,
        outliers=outliers,
        far_share=far_share,
        rotation_vector_rad=rotation,
        translation_m=translation,
        noise_px=0.0,
    )
    scene = make_point_scene(options, seed=seed)
    true, near = ~scene.is_outlier, ~scene.is_outlier & ~scene.is_far
    assert scene.is_outlier.sum() == outliers
    assert scene.is_far.sum() == round(far_share * (60 - outliers))
    assert not (scene.is_far & scene.is_outlier).any()
    assert ((scene.depths[scene.is_far] >= 25) & (scene.depths[scene.is_far] <= 35)).all()
    assert ((scene.depths[near] >= 1) & (scene.depths[near] <= 4)).all()
    # Without noise, image 1 is the image of the points that image 0 and the depths define.
    X0 = scene.camera.unproject(scene.points0[true]) * scene.depths[true, None]
    X1 = X0 @ scene.rotation_cam1_from_cam0.T + scene.translation_cam1_from_cam0
    np.testing.assert_allclose(scene.camera.project(X1), scene.points1[true], atol=1e-8)
    for points in (scene.points0, scene.points1):
        assert ((points >= 0) & (points <= (639, 479))).all()


def test_the_same_seed_gives_the_same_scene_and_another_one_does_not():
    first, again, other = (make_point_scene(paper_example(), seed=seed) for seed in (3, 3, 4))
    assert first.points1.tobytes() == again.points1.tobytes()
    assert not np.allclose(first.points1, other.points1)


def test_noise_has_the_stated_sigma_in_each_image():
    options = PointSceneOptions(camera=paper_camera(), matches=4000, outliers=0, noise_px=0.5)
    scene = make_point_scene(options, seed=5)
    X0 = scene.true_rays0 * scene.depths[:, None]
    X1 = X0 @ scene.rotation_cam1_from_cam0.T + scene.translation_cam1_from_cam0
    noise0 = scene.points0 - scene.camera.project(X0)
    noise1 = scene.points1 - scene.camera.project(X1)
    # Relative standard error of a sigma from 8000 numbers: 0.8 %.
    assert noise0.std() == pytest.approx(0.5, rel=0.03)
    assert noise1.std() == pytest.approx(0.5, rel=0.03)
    assert abs(np.corrcoef(noise0.ravel(), noise1.ravel())[0, 1]) < 0.04


def test_outliers_along_epipolar_lines_pass_the_epipolar_test_and_uniform_ones_do_not():
    for kind, fits in ((OutlierKind.EPIPOLAR, True), (OutlierKind.UNIFORM, False)):
        options = PointSceneOptions(
            camera=paper_camera(),
            matches=200,
            outliers=200,
            outlier_kind=kind,
            rotation_vector_rad=(0.02, -0.03, 0.01),
            translation_m=(0.1, 0.0, -0.2),
            noise_px=0.0,
        )
        scene = make_point_scene(options, seed=6)
        errors = epipolar_errors(scene)
        assert np.isnan(scene.depths).all()
        assert bool((np.abs(errors) < 1e-9).all()) is fits
        # Wrong all the same: they lie anywhere, far from where the point went.
        assert np.median(np.linalg.norm(scene.points1 - scene.points0, axis=1)) > 50


def test_points_at_infinity_move_by_the_rotation_alone():
    options = PointSceneOptions(
        camera=paper_camera(),
        outliers=0,
        far_share=1.0,
        far_range_m=(math.inf, math.inf),
        rotation_vector_rad=(0.01, 0.02, 0.03),
        noise_px=0.0,
    )
    scene = make_point_scene(options)
    turned = scene.camera.unproject(scene.points0) @ scene.rotation_cam1_from_cam0.T
    np.testing.assert_allclose(scene.camera.project(turned), scene.points1, atol=1e-8)


def test_the_papers_example_has_the_papers_epipole():
    scene = make_point_scene(paper_example())
    heading = scene.heading_cam0
    assert heading is not None
    # Section 3 of the paper after derotation: R_p T_p = (0.724, 0.370, 1).
    np.testing.assert_allclose(heading / heading[2], (0.724, 0.370, 1.0), atol=5e-4)


def test_the_papers_protocol_has_its_counts():
    rng = np.random.default_rng(7)
    pairs = [paper_protocol(rng) for _ in range(2000)]
    # Standard error of the mean: sqrt(69.8 / 2000) = 0.19.
    assert np.mean([pair.matches for pair in pairs]) == pytest.approx(89.8, abs=0.8)
    assert {pair.outliers for pair in pairs} == {20}
    assert pairs[0].noise_px ** 2 == pytest.approx(0.05)
    assert len(make_point_scene(pairs[0], seed=rng)) == pairs[0].matches


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("matches", 0),
        ("outliers", -1),
        ("outliers", 111),
        ("far_share", 1.5),
        ("far_share", math.nan),
        ("noise_px", -0.1),
        ("noise_px", math.nan),
        ("near_range_m", (0.0, 1.0)),
        ("near_range_m", (2.0, 1.0)),
        ("far_range_m", (25.0, math.inf)),
        ("translation_m", (0.0, math.nan, 0.0)),
        ("rotation_vector_rad", (math.inf, 0.0, 0.0)),
        ("camera", Camera(model=paper_camera().model)),
    ],
)
def test_options_out_of_range_name_their_field(field, value):
    with pytest.raises(InputError) as error:
        PointSceneOptions(**{"camera": paper_camera(), field: value})
    assert error.value.field == field


def test_epipolar_outliers_need_a_translation():
    with pytest.raises(InputError, match="translation_m"):
        PointSceneOptions(
            camera=paper_camera(),
            outlier_kind=OutlierKind.EPIPOLAR,
            translation_m=(0.0, 0.0, 0.0),
        )


def test_a_motion_that_leaves_nothing_in_view_says_so():
    options = PointSceneOptions(camera=paper_camera(), rotation_vector_rad=(0.0, math.pi / 2, 0.0))
    with pytest.raises(InputError, match="stay in view"):
        make_point_scene(options)
