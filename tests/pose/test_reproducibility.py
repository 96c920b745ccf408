"""The same inputs, options and seed give the same result, bit for bit, in any thread."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from pose_kit import assert_identical, estimate, point_scene

from farpoint import (
    RelativePoseOptions,
    estimate_relative_pose,
    estimate_relative_pose_from_rays,
)
from farpoint.geometry import so3, sphere

SCENES = [
    point_scene(seed, far_share=share, translation_m=(0.05, 0.0, -0.02))
    for seed, share in enumerate([0.5, 0.0, 0.5, 0.0, 1.0, 0.2])
]


@pytest.mark.parametrize("refine", [True, False])
def test_twice_is_the_same(refine):
    options = RelativePoseOptions(refine=refine)
    for scene in SCENES:
        assert_identical(
            estimate(scene, options=options, seed=3), estimate(scene, options=options, seed=3)
        )


def test_rays_twice_are_the_same():
    scene = SCENES[0]
    rays = [scene.camera.unproject(points) for points in (scene.points0, scene.points1)]
    assert_identical(
        estimate_relative_pose_from_rays(*rays, noise_rad=3e-4, seed=1),
        estimate_relative_pose_from_rays(*rays, noise_rad=3e-4, seed=1),
    )


def test_threads_give_the_same_answers():
    serial = [estimate(scene) for scene in SCENES]
    with ThreadPoolExecutor(4) as pool:
        parallel = list(pool.map(estimate, SCENES * 5))
    for k, pose in enumerate(parallel):
        assert_identical(pose, serial[k % len(SCENES)])


def test_nothing_is_remembered_from_one_call_to_the_next():
    first = estimate(SCENES[0])
    for scene in SCENES[1:]:
        estimate(scene, seed=99)
    assert_identical(estimate(SCENES[0]), first)


def test_another_seed_is_another_search_for_the_same_answer():
    scene = SCENES[0]
    poses = [estimate(scene, seed=seed) for seed in (0, 1, -1, 2**70, np.int64(5))]
    for pose in poses[1:]:
        assert so3.angle_between(
            pose.rotation_cam1_from_cam0, poses[0].rotation_cam1_from_cam0
        ) < 0.1 * np.sqrt(np.trace(pose.rotation_covariance))
        assert sphere.angle_between(
            pose.direction_cam1_from_cam0, poses[0].direction_cam1_from_cam0
        ) < 0.1 * np.sqrt(np.trace(pose.covariance[3:, 3:]))


def test_arguments_are_left_as_they_were():
    scene = SCENES[0]
    points0, points1 = scene.points0.copy(), scene.points1.copy()
    covariance = np.tile(np.diag([1.0, 2.0]), (len(points0), 1, 1))
    kept = covariance.copy()
    estimate_relative_pose(points0, points1, scene.camera, covariance0_px2=covariance)
    np.testing.assert_array_equal(points0, scene.points0)
    np.testing.assert_array_equal(points1, scene.points1)
    np.testing.assert_array_equal(covariance, kept)


@pytest.mark.parametrize(
    "form",
    [
        list,
        np.asfortranarray,
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: np.round(a).astype(np.int32),
        lambda a: a.astype(np.float32),
    ],
    ids=["list", "fortran", "strided", "integer", "single"],
)
def test_any_array_of_the_same_numbers_will_do(form):
    scene = SCENES[0]
    given = [form(points) for points in (scene.points0, scene.points1)]
    plain = [np.array(points, dtype=np.float64) for points in given]
    assert_identical(
        estimate_relative_pose(*given, scene.camera), estimate_relative_pose(*plain, scene.camera)
    )
