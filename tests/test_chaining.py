"""From one pose to the next, and from one motion to where it takes the tracks."""

from __future__ import annotations

import numpy as np

from boards import CAMERA, STEP, TURN
from farpoint import PoseStatus, Tracks, estimate_relative_pose
from farpoint.geometry import so3, sphere
from farpoint.pose import failed_pose
from farpoint.path.chain import chain
from farpoint.path.prediction import inverse_depths, point_predictor


def exact_matches(count: int = 40) -> tuple[Tracks, np.ndarray]:
    """Tracks of one motion without noise, and where its repetition takes them."""
    rng = np.random.default_rng(0)
    X = rng.uniform([-1.0, -0.7, 2.0], [1.0, 0.7, 6.0], (count, 3))
    X1 = X @ TURN.T + STEP
    tracks = Tracks(
        ids=rng.permutation(1000)[:count],
        points0=CAMERA.project(X),
        points1=CAMERA.project(X1),
        covariance_px2=np.tile(np.eye(2), (count, 1, 1)),
    )
    return tracks, CAMERA.project(X1 @ TURN.T + STEP)


def test_inverse_depths_are_those_of_the_points():
    rng = np.random.default_rng(1)
    X = rng.uniform([-1.0, -0.7, 2.0], [1.0, 0.7, 6.0], (30, 3))
    t = sphere.normalize(STEP)
    X1 = X @ TURN.T + t
    depths = inverse_depths(sphere.normalize(X), sphere.normalize(X1), TURN, t)
    np.testing.assert_allclose(depths, 1.0 / np.linalg.norm(X1, axis=1), rtol=1e-9)


def test_prediction_repeats_the_motion_exactly():
    tracks, after = exact_matches()
    motion = estimate_relative_pose(tracks.points0, tracks.points1, CAMERA)
    assert motion.status is PoseStatus.OK
    order = np.argsort(tracks.ids)
    now = tracks.points1[order]
    predicted = point_predictor(CAMERA, motion, tracks, tracks.ids[order], now)(now)
    np.testing.assert_allclose(predicted, after[order], rtol=0.0, atol=1e-4)


def test_a_track_without_a_depth_is_expected_to_go_where_its_neighbour_does():
    tracks, after = exact_matches()
    motion = estimate_relative_pose(tracks.points0, tracks.points1, CAMERA)
    quickest = np.argsort(np.linalg.norm(after - tracks.points1, axis=1))[-2:]
    beside = tracks.points1[quickest] + [[0.3, -0.2], [-0.1, 0.2]]
    fresh = np.array([5000, 5001])
    predicted = point_predictor(CAMERA, motion, tracks, fresh, beside)(beside)
    np.testing.assert_allclose(predicted, after[quickest], rtol=0.0, atol=0.5)
    turned = CAMERA.project(CAMERA.unproject(beside) @ TURN.T)
    assert np.linalg.norm(after[quickest] - turned, axis=1).min() > 2.0


def test_prediction_without_a_direction_turns_and_without_a_motion_stays():
    tracks, _ = exact_matches()
    X = CAMERA.unproject(tracks.points0)
    turned = CAMERA.project(X @ TURN.T)
    motion = estimate_relative_pose(tracks.points0, turned, CAMERA)
    assert motion.status is PoseStatus.ROTATION_ONLY
    predicted = point_predictor(CAMERA, motion, tracks, np.sort(tracks.ids), turned)(turned)
    np.testing.assert_allclose(predicted, CAMERA.project(X @ (TURN @ TURN).T), rtol=0.0, atol=1e-4)
    nothing = failed_pose("No consensus here.", 40)
    np.testing.assert_array_equal(
        point_predictor(CAMERA, nothing, tracks, np.sort(tracks.ids), turned)(turned), turned
    )


def test_chaining_is_multiplication_by_the_inverse_motion():
    tracks, _ = exact_matches()
    motion = estimate_relative_pose(tracks.points0, tracks.points1, CAMERA)
    start = np.eye(4)
    start[:3, :3], start[:3, 3] = so3.exp(np.array([0.3, -0.2, 0.5])), [1.0, 2.0, 3.0]
    end = chain(start, motion, 0.7)
    # A point keeps its place in the world whichever camera it is seen from.
    X_cam0 = np.array([0.4, -0.3, 5.0])
    X_cam1 = motion.rotation_cam1_from_cam0 @ X_cam0 + 0.7 * motion.direction_cam1_from_cam0
    np.testing.assert_allclose(
        end[:3, :3] @ X_cam1 + end[:3, 3],
        start[:3, :3] @ X_cam0 + start[:3, 3],
        rtol=0.0,
        atol=1e-12,
    )
    # The camera has gone along its heading by the scale.
    heading_world = start[:3, :3] @ motion.heading_cam0
    np.testing.assert_allclose(end[:3, 3], start[:3, 3] + 0.7 * heading_world, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(end[3], [0.0, 0.0, 0.0, 1.0])
    # No scale, no translation; no motion, no change.
    np.testing.assert_allclose(
        chain(start, motion, None)[:3, 3], start[:3, 3], rtol=0.0, atol=1e-15
    )
    np.testing.assert_array_equal(chain(start, failed_pose("No consensus here."), None), start)
