"""MAGSAC++ and GC-RANSAC from their authors' packages; OpenCV decomposes essential matrices."""

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
from farpoint.bench.estimators.opencv_peer import FAR_REACH, recovered_motion
from farpoint.bench.views import TwoViews

__all__ = ["magsac_estimators"]

_CONFIDENCE = 0.999
_UNIFORM = 0  # the sampler of plain RANSAC

_Search = Callable[[np.ndarray, np.ndarray, float, float], tuple[np.ndarray | None, np.ndarray]]
"""Essential matrix and mask of the inliers, from matches (N, 4), K, width and height."""


def magsac_estimators() -> tuple[Estimator, ...]:
    """MAGSAC++ and GC-RANSAC, if installed. The random samples differ from call to call."""
    cv2, found = load_peer("cv2"), []
    if cv2 is None:
        return ()
    if (pymagsac := load_peer("pymagsac")) is not None:
        found.append(("MAGSAC++", "conf=0.999, sampler=0", _magsac(pymagsac)))
    if (pygcransac := load_peer("pygcransac")) is not None:
        found.append(("GC-RANSAC", "conf=0.999, sampler=0", _graph_cut(pygcransac)))
    return tuple(
        Estimator(name=name, settings=settings, prepare=_preparation(cv2, search))
        for name, settings, search in found
    )


def _magsac(pymagsac: Any) -> _Search:
    def search(
        matches: np.ndarray, K: np.ndarray, width: float, height: float
    ) -> tuple[np.ndarray | None, np.ndarray]:
        return pymagsac.findEssentialMatrix(
            matches, K, K, width, height, width, height, probabilities=np.array([]),
            sampler=_UNIFORM, conf=_CONFIDENCE,
        )  # fmt: skip

    return search


def _graph_cut(pygcransac: Any) -> _Search:
    def search(
        matches: np.ndarray, K: np.ndarray, width: float, height: float
    ) -> tuple[np.ndarray | None, np.ndarray]:
        return pygcransac.findEssentialMatrix(
            matches, K, K, int(height), int(width), int(height), int(width), np.array([]),
            sampler=_UNIFORM, conf=_CONFIDENCE,
        )  # fmt: skip

    return search


def _preparation(
    cv2: Any, search: _Search
) -> Callable[[TwoViews, int], Callable[[], Motion | None]]:
    def prepare(views: TwoViews, seed: int) -> Callable[[], Motion | None]:
        """Convert matches and camera for the packages; returns the call that is timed."""
        del seed  # neither package takes a seed
        ideal = pinhole_points(views)
        matches = np.ascontiguousarray(np.hstack([ideal.points0, ideal.points1]))
        width, height = views.camera.size or _extent(ideal)

        def estimate() -> Motion | None:
            """One call of the library; the result is converted to farpoint's conventions."""
            try:
                E, mask = search(matches, ideal.matrix, float(width), float(height))
            except RuntimeError:  # too few matches
                return None
            if E is None or np.shape(E) != (3, 3):
                return None
            inliers = np.ascontiguousarray(np.reshape(mask, (-1, 1)), np.uint8)
            return recovered_motion(cv2, E, ideal, inliers if inliers.any() else None, FAR_REACH)

        return estimate

    return prepare


def _extent(ideal: PinholePoints) -> tuple[float, float]:
    """Width and height, px, of images that contain all points."""
    width, height = np.ceil(np.maximum(ideal.points0, ideal.points1).max(axis=0, initial=1.0))
    return float(width), float(height)
