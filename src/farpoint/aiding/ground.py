"""Height of the camera over the ground in view."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera
from farpoint.odometry import OdometryResult
from farpoint.path.prediction import inverse_depths
from farpoint.pose import TrackLabel

__all__ = ["find_ground"]

_LEAST_POINTS = 12
_LEAST_SHARE = 0.25  # least share of inliers of the points below the horizon: fewer may be a kerb
_BELOW = 0.1  # sine of the least angle between the horizon and a ray to a ground point
_TILT = 0.17  # rad: largest angle between the plane's normal and the camera's y axis
_BAND = 0.06  # largest distance of an inlier from the plane, divided by the height
_HYPOTHESES = 150


def find_ground(camera: Camera, result: OdometryResult) -> float | None:
    """Height of the camera over the ground, in units of the trajectory; None without a ground.

    The ground is the plane with the most inliers among the points below the horizon (RANSAC), with
    a normal within 10 degrees of the y axis of the camera. The points are triangulated from the
    NEAR matches of the motion. The result is None with too few points or too few inliers.
    """
    points = _points_below(camera, result)
    if len(points) < _LEAST_POINTS:
        return None
    rng = np.random.default_rng(result.frame1)
    three = points[rng.integers(0, len(points), (_HYPOTHESES, 3))]
    normals = np.cross(three[:, 1] - three[:, 0], three[:, 2] - three[:, 0])
    length = np.linalg.norm(normals, axis=1)
    level = np.abs(normals[:, 1]) > np.cos(_TILT) * np.maximum(length, np.finfo(float).tiny)
    normals = normals[level] / (length * np.sign(normals[:, 1]))[level, None]
    heights = np.sum(normals * three[level, 0], axis=1)
    if not len(heights):
        return None
    off = np.abs(points @ normals.T - heights) < _BAND * heights
    best = int(np.argmax(off.sum(axis=0)))
    on = points[off[:, best]]
    if len(on) < max(_LEAST_POINTS, _LEAST_SHARE * len(points)):
        return None
    # Least-squares plane n . x = h, written as (n / h) . x = 1.
    plane = np.linalg.lstsq(on, np.ones(len(on)), rcond=None)[0]
    return float(1.0 / np.linalg.norm(plane))


def _points_below(camera: Camera, result: OdometryResult) -> np.ndarray:
    """Points (N, 3) in the axes of camera 1, in the unit of the trajectory, below the horizon."""
    pose, tracks = result.pose, result.tracks
    if pose is None or result.scale is None or pose.direction_cam1_from_cam0 is None:
        return np.empty((0, 3))
    R = pose.rotation_cam1_from_cam0
    assert R is not None
    near = tracks.select(pose.labels == TrackLabel.NEAR)
    rays0, rays1 = camera.unproject(near.points0), camera.unproject(near.points1)
    inverse = inverse_depths(rays0, rays1, R, pose.direction_cam1_from_cam0)
    below = (rays1[:, 1] > _BELOW) & (inverse > 0.0)
    # The parallax is at least 20 sigma of the noise, so that the distances have small errors.
    angle = np.linalg.norm(np.cross(rays1, rays0 @ R.T), axis=1)
    noise = (pose.noise_px or 0.1) * float(np.median(_px_rad(camera, rays1)))
    sure = below & (angle > 20.0 * noise)
    return result.scale * rays1[sure] / inverse[sure, None]


def _px_rad(camera: Camera, rays: np.ndarray) -> np.ndarray:
    """Angle, rad, that one pixel covers at each ray (N,)."""
    if not len(rays):
        return np.ones(1)
    return np.linalg.norm(camera.unproject_jacobian(rays), axis=(1, 2)) / np.sqrt(2.0)
