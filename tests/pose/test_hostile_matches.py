"""Matches that no camera makes: never a crash, a hang, or a number that is not one."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from pose_kit import assert_sound, point_scene

from farpoint import (
    Camera,
    RelativePoseOptions,
    estimate_relative_pose,
    estimate_relative_pose_from_rays,
)

# A hang is what the deadline is for; machines are slow at times.
hostile = settings(max_examples=60, deadline=10_000, suppress_health_check=[HealthCheck.too_slow])
WIDTH, HEIGHT = 640, 480
CAMERA = Camera.pinhole(WIDTH, HEIGHT, 500.0, 500.0, 319.5, 239.5)
# No ray ends beyond 310 px from the middle of this one.
FOLDING = Camera.pinhole(WIDTH, HEIGHT, 400.0, 400.0, 319.5, 239.5, (-0.25, 0.0, 0.0, 0.0))
SEEN = np.random.default_rng(0).uniform((0, 0), (WIDTH - 1, HEIGHT - 1), (40, 2))

counts = st.integers(0, 40)
seeds = st.integers(0, 2**32)
refine = st.booleans()


def check(points0: np.ndarray, points1: np.ndarray, camera: Camera, refine: bool) -> None:
    options = RelativePoseOptions(refine=refine)
    # Whatever floating point does on the way is no news to the caller.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pose = estimate_relative_pose(points0, points1, camera, options=options)
    assert_sound(pose, len(points0))


@pytest.fixture(autouse=True, scope="module")
def compiled() -> None:
    """The first estimate of each kind compiles: no example is charged with it."""
    for refine in (True, False):
        check(SEEN, SEEN + np.array([5.0, -3.0]), CAMERA, refine)


def moved(points: np.ndarray, kind: str, rng: np.random.Generator) -> np.ndarray:
    return {
        "same": lambda: points.copy(),
        "shifted": lambda: points + np.array([5.0, -3.0]),
        "zoomed": lambda: 1.1 * points - 25.0,
        "noisy": lambda: points + rng.normal(0.0, 0.5, points.shape),
        "shuffled": lambda: rng.permutation(points),
        "mirrored": lambda: [WIDTH - 1, 0] + points * [-1, 1],
        "elsewhere": lambda: rng.uniform(0.0, HEIGHT, points.shape),
    }[kind]()


kinds = st.sampled_from(["same", "shifted", "zoomed", "noisy", "shuffled", "mirrored", "elsewhere"])


@hostile
@given(count=counts, different=st.integers(1, 9), kind=kinds, seed=seeds, refine=refine)
@example(count=20, different=1, kind="same", seed=0, refine=True)
@example(count=20, different=1, kind="same", seed=0, refine=False)
@example(count=20, different=2, kind="elsewhere", seed=0, refine=True)
def test_repeated_points(count, different, kind, seed, refine):
    rng = np.random.default_rng(seed)
    which = rng.integers(different, size=count)
    points0 = rng.uniform(0, HEIGHT, (different, 2))
    check(points0[which], moved(points0, kind, rng)[which], CAMERA, refine)


@hostile
@given(
    count=counts,
    ends=st.tuples(*[st.integers(0, 479)] * 4),
    kind=kinds,
    seed=seeds,
    refine=refine,
)
@example(count=40, ends=(0, 0, 479, 320), kind="shifted", seed=0, refine=True)
@example(count=40, ends=(0, 240, 479, 240), kind="zoomed", seed=0, refine=True)
@example(count=40, ends=(0, 0, 479, 320), kind="elsewhere", seed=0, refine=True)
def test_points_on_a_line(count, ends, kind, seed, refine):
    rng = np.random.default_rng(seed)
    share = rng.uniform(0, 1, (count, 1))
    points0 = (1 - share) * ends[:2] + share * ends[2:]
    check(points0, moved(points0, kind, rng), CAMERA, refine)


@hostile
@given(
    count=counts,
    size=st.sampled_from([1e3, 1e4, 1e6, 1e9, 1e12, 1e15, 1e100, 1e154, 1e200, 1e307]),
    some=st.booleans(),
    seed=seeds,
    lens=st.sampled_from([CAMERA, FOLDING]),
    refine=refine,
)
@example(count=30, size=1e12, some=False, seed=0, lens=CAMERA, refine=True)
@example(count=30, size=1e15, some=False, seed=0, lens=CAMERA, refine=True)
@example(count=30, size=1e100, some=True, seed=0, lens=CAMERA, refine=True)
def test_huge_coordinates(count, size, some, seed, lens, refine):
    rng = np.random.default_rng(seed)
    points = [SEEN[:count], SEEN[:count] + rng.normal(0, 0.2, (count, 2))]
    huge = rng.uniform(-size, size, (2, count, 2))
    mask = rng.uniform(size=(count, 1)) < (0.1 if some else 1.0)
    check(*(np.where(mask, h, p) for h, p in zip(huge, points, strict=True)), lens, refine)


@hostile
@given(count=counts, size=st.sampled_from([1e-3, 1e-9, 1e-160, 1e-310]), seed=seeds, refine=refine)
@example(count=20, size=1e-9, seed=0, refine=True)
@example(count=20, size=1e-310, seed=0, refine=False)
def test_tiny_coordinates(count, size, seed, refine):
    rng = np.random.default_rng(seed)
    check(*(size * rng.uniform(size=(2, count, 2))), CAMERA, refine)


@hostile
@given(side=st.integers(1, 4), count=counts, seed=seeds, kind=kinds, refine=refine)
@example(side=1, count=21, seed=1742, kind="noisy", refine=False)
def test_tiny_images_and_whole_pixels(side, count, seed, kind, refine):
    rng = np.random.default_rng(seed)
    camera = Camera.pinhole(side, side, float(side), float(side), side / 2, side / 2)
    points0 = rng.integers(0, side, (count, 2)).astype(float)
    check(points0, moved(points0, kind, rng), camera, refine)


@hostile
@given(count=counts, seed=seeds, kind=kinds, lens=st.sampled_from([CAMERA, FOLDING]), refine=refine)
def test_points_on_the_border_and_beyond_the_lens(count, seed, kind, lens, refine):
    rng = np.random.default_rng(seed)
    points0 = rng.uniform((0, 0), (WIDTH - 1, HEIGHT - 1), (count, 2))
    axis = rng.integers(0, 2, count)
    border = np.array([WIDTH - 1.0, HEIGHT - 1.0])
    points0[np.arange(count), axis] = rng.choice([0.0, 1.0], count) * border[axis]
    check(points0, moved(points0, kind, rng), lens, refine)


@hostile
@given(
    count=counts,
    spread=st.sampled_from([1e-3, 1.0, 1e3]),
    scale=st.sampled_from([1e-200, 1e-30, 1.0, 1e30, 1e200]),
    seed=seeds,
    refine=refine,
)
def test_noise_of_any_size_and_shape(count, spread, scale, seed, refine):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(count, 2, 2)) * spread ** rng.normal(size=(count, 1, 1))
    covariance = scale * (A @ A.swapaxes(1, 2) + 1e-6 * np.eye(2))
    pose = estimate_relative_pose(
        SEEN[:count],
        SEEN[:count] + rng.normal(0, 0.3, (count, 2)),
        CAMERA,
        options=RelativePoseOptions(refine=refine),
        covariance0_px2=covariance,
    )
    assert_sound(pose, count)


@hostile
@given(
    count=counts,
    kind=st.sampled_from(["same", "opposite", "mirrored", "half turn", "elsewhere", "flat"]),
    noise_rad=st.sampled_from([1e-12, 1e-4, 0.1, 10.0]),
    length=st.sampled_from([1e-100, 1.0, 1e100]),
    seed=seeds,
    refine=refine,
)
def test_rays_all_around(count, kind, noise_rad, length, seed, refine):
    rng = np.random.default_rng(seed)
    rays0 = rng.normal(size=(count, 3))
    rays1 = {
        "same": rays0,
        "opposite": -rays0,
        "mirrored": rays0 * [1, 1, -1],
        "half turn": rays0 * [-1, -1, 1],
        "elsewhere": rng.normal(size=(count, 3)),
        "flat": rays0,
    }[kind]
    if kind == "flat":
        rays0, rays1 = rays0 * [1, 1, 0], rays1 * [1, 1, 0]
    options = RelativePoseOptions(refine=refine)
    pose = estimate_relative_pose_from_rays(
        length * rays0, length * rays1, noise_rad=noise_rad, options=options
    )
    assert_sound(pose, count)


@pytest.mark.parametrize("noise_rad", [1e-100, 1e-30, 1e30, 1e100])
def test_noise_of_rays_beyond_reason(noise_rad):
    rays = np.random.default_rng(0).normal(size=(30, 3))
    assert_sound(estimate_relative_pose_from_rays(rays, rays, noise_rad=noise_rad), 30)


@pytest.mark.parametrize("length", [1e100, 1e-100])
def test_rays_may_have_any_length(length):
    scene = point_scene(0, matches=60, outliers=0)
    rays0, rays1 = (scene.camera.unproject(p) for p in (scene.points0, scene.points1))
    unit = estimate_relative_pose_from_rays(rays0, rays1, noise_rad=3e-4)
    scaled = estimate_relative_pose_from_rays(length * rays0, rays1, noise_rad=3e-4)
    assert scaled.status is unit.status
    np.testing.assert_allclose(
        scaled.rotation_cam1_from_cam0, unit.rotation_cam1_from_cam0, rtol=0.0, atol=1e-6
    )


def test_a_few_impossible_matches_do_not_spoil_the_others():
    scene = point_scene(1, matches=100, outliers=10)
    plain = estimate_relative_pose(scene.points0, scene.points1, scene.camera)
    for size in (1e6, 1e12, 1e100, 1e200):
        wild = replace(scene, points1=scene.points1.copy())
        wild.points1[np.flatnonzero(scene.is_outlier)[:3]] = size
        pose = estimate_relative_pose(wild.points0, wild.points1, wild.camera)
        assert_sound(pose, 100)
        assert pose.status is plain.status
        np.testing.assert_allclose(
            pose.rotation_cam1_from_cam0,
            plain.rotation_cam1_from_cam0,
            rtol=0.0,
            atol=np.sqrt(np.trace(plain.rotation_covariance)),
        )
