"""OpenCV: findEssentialMat and recoverPose."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from farpoint.bench.estimators.estimator import (
    Estimator,
    Motion,
    PinholePoints,
    load_peer,
    pinhole_points,
)
from farpoint.bench.views import TwoViews
from farpoint.geometry.sphere import normalize

__all__ = ["FAR_REACH", "opencv_estimators", "recovered_motion"]

_CONFIDENCE = 0.999
_THRESHOLD_PX = 1.0  # this and _CONFIDENCE are the defaults of findEssentialMat
_DEFAULT_REACH = 50.0  # baselines; recoverPose ignores points beyond this distance
FAR_REACH = 1e6  # far points also vote on the sign of the translation, so it is wrong less often


def opencv_estimators() -> tuple[Estimator, ...]:
    """RANSAC with defaults, USAC_ACCURATE and USAC_MAGSAC; empty if OpenCV is not installed."""
    cv2 = load_peer("cv2")
    if cv2 is None:
        return ()
    searches = (
        ("OpenCV RANSAC", "defaults", cv2.RANSAC, _DEFAULT_REACH),
        ("OpenCV USAC_ACCURATE", "recoverPose distanceThresh=1e6", cv2.USAC_ACCURATE, FAR_REACH),
        ("OpenCV USAC_MAGSAC", "recoverPose distanceThresh=1e6", cv2.USAC_MAGSAC, FAR_REACH),
    )
    return tuple(
        Estimator(name=name, settings=settings, prepare=_preparation(cv2, method, reach))
        for name, settings, method, reach in searches
    )


def _preparation(
    cv2: Any, method: int, reach: float
) -> Callable[[TwoViews, int], Callable[[], Motion | None]]:
    def prepare(views: TwoViews, seed: int) -> Callable[[], Motion | None]:
        """Convert matches and camera to OpenCV's format; returns the call that is timed."""
        del seed  # OpenCV draws the same samples every time
        ideal = pinhole_points(views)

        def estimate() -> Motion | None:
            """One call of the library; the result is converted to farpoint's conventions."""
            try:
                E, mask = cv2.findEssentialMat(
                    ideal.points0,
                    ideal.points1,
                    ideal.matrix,
                    method=method,
                    prob=_CONFIDENCE,
                    threshold=_THRESHOLD_PX,
                )
            except cv2.error:  # no model was found
                return None
            if E is None or E.shape != (3, 3):
                return None
            return recovered_motion(cv2, E, ideal, mask, reach)

        return estimate

    return prepare


def recovered_motion(
    cv2: Any, E: np.ndarray, ideal: PinholePoints, mask: np.ndarray | None, reach: float
) -> Motion | None:
    """The motion of an essential matrix, with the sign from cheirality.

    Cheirality is checked for inliers that are nearer than ``reach``, in units of the baseline.
    ``mask`` (N, 1) marks the inliers; with None all matches are inliers.
    """
    try:
        _, R, t, _, _ = cv2.recoverPose(
            E, ideal.points0, ideal.points1, ideal.matrix, distanceThresh=reach, mask=mask
        )
    except cv2.error:
        return None
    return Motion(R, normalize(t[:, 0]))
