from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from bench_kit import PEERS, absent, some_views

from farpoint.bench.estimators import (
    CLOSED_FORM,
    FARPOINT,
    all_estimators,
    peer_versions,
    pinhole_points,
)
from farpoint.bench.views import TwoViews, views_of_scene
from farpoint.camera import Camera
from farpoint.geometry import so3, sphere
from farpoint.synthetic import PointSceneOptions, make_point_scene, paper_camera

# So far away that the closed form, which takes far points to be infinitely far, is exact too.
EXACT = views_of_scene(
    make_point_scene(
        PointSceneOptions(
            camera=paper_camera(),
            matches=60,
            outliers=6,
            far_share=0.3,
            far_range_m=(1e5, 1e6),
            rotation_vector_rad=(0.02, -0.05, 0.01),
            translation_m=(0.1, 0.02, -0.2),
            noise_px=0.0,
        )
    )
)

UNSEEDED = ("MAGSAC++", "GC-RANSAC")  # draw other samples in every call


def distorted(views: TwoViews) -> TwoViews:
    """The same scene through a lens that bends its edges by some 20 px."""
    m = EXACT.camera.model
    lens = Camera.pinhole(640, 480, m.fx, m.fy, m.cx, m.cy, (-0.2, 0.05, 0.001, -0.001))
    points0, points1 = (
        lens.project(views.camera.unproject(points)) for points in (views.points0, views.points1)
    )
    return replace(views, camera=lens, points0=points0, points1=points1)


@pytest.mark.parametrize("views", [EXACT, distorted(EXACT)], ids=["ideal", "distorted"])
@pytest.mark.parametrize(
    "estimator", [*all_estimators(), CLOSED_FORM], ids=lambda estimator: estimator.name
)
def test_every_estimator_finds_an_exact_motion(estimator, views):
    motion = estimator.prepare(views, 0)()
    R_true = views.rotation_cam1_from_cam0
    off_deg = np.degrees(so3.angle_between(motion.rotation_cam1_from_cam0, R_true))
    assert off_deg < 0.01
    direction_true = sphere.normalize(views.translation_cam1_from_cam0)
    off_deg = np.degrees(sphere.angle_between(motion.direction_cam1_from_cam0, direction_true))
    assert off_deg < 0.1
    assert np.linalg.norm(motion.direction_cam1_from_cam0) == pytest.approx(1.0)


def test_peers_get_the_points_that_an_ideal_lens_would_have_seen():
    bent = distorted(EXACT)
    assert np.abs(bent.points0 - EXACT.points0).max() > 5.0
    ideal = pinhole_points(bent)
    np.testing.assert_allclose(ideal.points0, EXACT.points0, atol=1e-6)
    np.testing.assert_allclose(ideal.points1, EXACT.points1, atol=1e-6)
    np.testing.assert_array_equal(ideal.matrix, [[727, 0, 319.5], [0, 727, 239.5], [0, 0, 1]])


@pytest.mark.parametrize(
    "estimator",
    [e for e in all_estimators() if e.name not in UNSEEDED],
    ids=lambda estimator: estimator.name,
)
def test_the_same_seed_gives_the_same_answer(estimator):
    views = some_views(1, seed=5)[0]
    first, second = (estimator.prepare(views, 3)() for _ in range(2))
    np.testing.assert_array_equal(first.rotation_cam1_from_cam0, second.rotation_cam1_from_cam0)
    np.testing.assert_array_equal(first.direction_cam1_from_cam0, second.direction_cam1_from_cam0)


@pytest.mark.parametrize("estimator", all_estimators(), ids=lambda estimator: estimator.name)
def test_matches_without_any_motion_in_them_are_no_crash(estimator):
    rng = np.random.default_rng(0)
    views = replace(
        EXACT,
        points0=rng.uniform(0, 480, (8, 2)),
        points1=np.full((8, 2), 100.0),
    )
    motion = estimator.prepare(views, 0)()
    assert motion is None or np.isfinite(motion.rotation_cam1_from_cam0).all()


def test_every_installed_peer_takes_part():
    pytest.importorskip("poselib")
    pytest.importorskip("pycolmap")
    pytest.importorskip("cv2")
    pytest.importorskip("pymagsac")
    pytest.importorskip("pygcransac")
    assert [estimator.name for estimator in all_estimators()] == [
        "farpoint",
        "PoseLib",
        "PoseLib tuned",
        "pycolmap",
        "pycolmap tuned",
        "OpenCV RANSAC",
        "OpenCV USAC_ACCURATE",
        "OpenCV USAC_MAGSAC",
        "MAGSAC++",
        "GC-RANSAC",
    ]
    assert all(peer_versions().values())


def test_absent_peers_leave_farpoint(monkeypatch: pytest.MonkeyPatch):
    absent(monkeypatch, *PEERS)
    assert all_estimators() == (FARPOINT,)
    assert set(peer_versions().values()) == {None}


def test_importing_the_benchmark_loads_no_peer():
    script = f"import sys, farpoint.bench; print([name for name in {PEERS} if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
