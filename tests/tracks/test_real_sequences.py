"""Real images: tracks obey the epipolar constraint, and their covariances know how well."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

from farpoint.geometry import so3
from farpoint.tracks import Tracker, Tracks

PAIRS = range(2, 47, 9)


def kitti_pair(folder: Path, k: int) -> tuple[Tracks, np.ndarray, np.ndarray]:
    """Tracks of frames k and k + 1, the camera matrix, and cam1_from_cam0 (3, 4) by the truth."""
    poses = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    world_from_cam = [np.vstack([pose, [0, 0, 0, 1]]) for pose in poses[k : k + 2]]
    first_line = (folder / "calib.txt").read_text().splitlines()[0]
    projection = np.array(first_line.split()[1:], float).reshape(3, 4)
    image0, image1 = (
        cv2.imread(str(folder / "images" / f"{i:06d}.png"), cv2.IMREAD_GRAYSCALE)
        for i in (k, k + 1)
    )
    tracker = Tracker()
    tracker.restart(image0)
    cam1_from_cam0 = np.linalg.solve(world_from_cam[1], world_from_cam[0])[:3]
    return tracker.match(image1), projection[:, :3], cam1_from_cam0


def epipolar(tracks: Tracks, K: np.ndarray, R: np.ndarray, t: np.ndarray):
    """Signed distances (N,) of points1 from their epipolar lines, px, and the lines' normals."""
    rays0 = np.linalg.solve(K, np.c_[tracks.points0, np.ones(len(tracks))].T).T
    lines = np.linalg.solve(K.T, so3.skew(t) @ R @ rays0.T).T
    length = np.linalg.norm(lines[:, :2], axis=1)
    distance = np.sum(lines[:, :2] * tracks.points1, axis=1) + lines[:, 2]
    return distance / length, lines[:, :2] / length[:, None]


def residuals(folder: Path) -> np.ndarray:
    """Epipolar residual, px, and its variance by the tracks' covariances, px^2, of all pairs.

    The truth of KITTI is off by 0.02 to 0.04 deg from frame to frame, which is three times the
    noise of a track: it is refitted to the tracks first, five numbers to hundreds of them.
    """
    rows = []
    for k in PAIRS:
        tracks, K, pose = kitti_pair(folder, k)
        R, t = pose[:, :3], pose[:, 3] / np.linalg.norm(pose[:, 3])

        def distances(x, tracks=tracks, K=K, R=R, t=t):
            return epipolar(tracks, K, so3.exp(x[:3]) @ R, so3.exp(x[3:]) @ t)

        fit = least_squares(lambda x, f=distances: f(x)[0], np.zeros(6), loss="cauchy", f_scale=0.1)
        assert np.linalg.norm(fit.x[:3]) < np.deg2rad(0.3)
        error, normal = distances(fit.x)
        variance = np.einsum("ni,nij,nj->n", normal, tracks.covariance_px2, normal)
        rows.append(np.stack([error, variance], axis=1))
    return np.concatenate(rows)


def mean_log_likelihood(error: np.ndarray, variance: np.ndarray) -> float:
    """Of Gaussian errors whose variances are right up to one factor, which is fitted."""
    scaled = variance * np.mean(error**2 / variance)
    return -0.5 * float(np.mean(np.log(2 * np.pi * scaled) + error**2 / scaled))


@pytest.mark.parametrize("sequence", ["kitti_a", "kitti_00"])
def test_covariances_say_which_tracks_obey_the_epipolar_constraint(shared_data, sequence):
    error, variance = residuals(shared_data / sequence).T
    right = np.abs(error) < 1.0
    assert len(error) > 1200
    assert right.mean() > 0.93
    error, variance = error[right], variance[right]
    assert np.median(np.abs(error)) / 0.6745 < 0.11
    constant = mean_log_likelihood(error, np.ones_like(error))
    assert mean_log_likelihood(error, variance) > constant + 0.25
    sharp, vague = np.array_split(error[np.argsort(variance)], 2)
    assert np.median(np.abs(sharp)) < 0.5 * np.median(np.abs(vague))


def test_a_standing_camera_keeps_its_tracks_in_place(shared_data):
    files = sorted((shared_data / "euroc_v101_micro").rglob("*.png"))[:6]
    tracker = Tracker()
    for file in files:
        tracks = tracker.track(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))
    assert len(tracks) > 600
    assert np.median(np.linalg.norm(tracks.points1 - tracks.points0, axis=1)) < 0.2
    assert (tracks.ids < 700).mean() > 0.9


def test_blur_and_quick_turns_leave_enough_tracks(shared_data):
    files = sorted((shared_data / "tum_fr1_rpy").rglob("*.png"))[:25]
    tracker, counts = Tracker(), []
    for file in files:
        counts.append(len(tracker.track(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE))))
    assert min(counts[1:]) > 50
