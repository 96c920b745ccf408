"""A basic program for comparison: monocular odometry in a few calls of OpenCV."""

from __future__ import annotations

from typing import Any

import numpy as np

from farpoint.camera import Camera, Pinhole
from farpoint.errors import InputError, optional_import

__all__ = ["PlainScript"]

_QUALITY = 0.01
_MIN_DISTANCE_PX = 8
_WINDOW_PX = 21
_LEVELS = 4
_BACK_PX = 1.0
_MIN_MATCHES = 5


class PlainScript:
    """Odometry by corners, Lucas-Kanade forward and back, and an essential matrix.

    New corners are detected in every frame.

    Parameters
    ----------
    camera : Camera
        A pinhole camera.
    max_corners : int
        Largest number of tracked points.
    """

    def __init__(self, camera: Camera, max_corners: int) -> None:
        model = camera.model
        if not isinstance(model, Pinhole):
            raise InputError("expected a pinhole camera: OpenCV's script knows no other")
        self._cv2: Any = optional_import("cv2", extra="video", purpose="the plain OpenCV script")
        self._matrix = np.array([[model.fx, 0, model.cx], [0, model.fy, model.cy], [0, 0, 1.0]])
        self._distortion = np.array(model.distortion) if any(model.distortion) else None
        self._max_corners = max_corners
        self._last: np.ndarray | None = None

    def process(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Rotation and direction, cam1_from_cam0, since the last image; None if unknown."""
        last, self._last = self._last, image
        if last is None:
            return None
        points0, points1 = self.match(last, image)
        if len(points0) < _MIN_MATCHES:
            return None
        if self._distortion is not None:
            points0, points1 = self._undistorted(points0), self._undistorted(points1)
        E, mask = self._cv2.findEssentialMat(points0, points1, self._matrix)
        if E is None or E.shape != (3, 3):
            return None
        _, R, t, _ = self._cv2.recoverPose(E, points0, points1, self._matrix, mask=mask)
        return R, t[:, 0]

    def match(self, image0: np.ndarray, image1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Corners (N, 2) of one image, and positions of the same points in the other image."""
        cv2 = self._cv2
        corners = cv2.goodFeaturesToTrack(image0, self._max_corners, _QUALITY, _MIN_DISTANCE_PX)
        if corners is None:
            return np.empty((0, 2)), np.empty((0, 2))
        window = {"winSize": (_WINDOW_PX, _WINDOW_PX), "maxLevel": _LEVELS}
        ahead, found, _ = cv2.calcOpticalFlowPyrLK(image0, image1, corners, None, **window)
        back, found_back, _ = cv2.calcOpticalFlowPyrLK(image1, image0, ahead, None, **window)
        start, end = corners.reshape(-1, 2), ahead.reshape(-1, 2)
        returned = np.linalg.norm(back.reshape(-1, 2) - start, axis=1) < _BACK_PX
        good = (found.ravel() == 1) & (found_back.ravel() == 1) & returned
        return start[good].astype(np.float64), end[good].astype(np.float64)

    def _undistorted(self, points: np.ndarray) -> np.ndarray:
        return self._cv2.undistortPoints(
            points[:, None], self._matrix, self._distortion, P=self._matrix
        )[:, 0]
