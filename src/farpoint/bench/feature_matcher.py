"""Matches of two images by a few calls of OpenCV, as in OpenCV's tutorials."""

from __future__ import annotations

from typing import Any, Literal, Protocol

import numpy as np

from farpoint.errors import optional_import

__all__ = ["FeatureMatcher", "Matcher"]

_FEATURES = 1000
_RATIO = 0.8


class Matcher(Protocol):
    """Interface of objects that find points of one image in another image."""

    def match(self, image0: np.ndarray, image1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (N, 2) of one image, and positions of the same points in the other image."""
        ...


class FeatureMatcher:
    """Matcher of nearest descriptors with Lowe's ratio test.

    A match is kept if the distance of the nearest descriptor is below 0.8 of the distance of the
    second nearest descriptor.

    Parameters
    ----------
    kind : {"SIFT", "ORB"}
        Kind of features and descriptors. OpenCV's defaults are used, except for a number of 1000
        features.
    """

    def __init__(self, kind: Literal["SIFT", "ORB"]) -> None:
        cv2: Any = optional_import("cv2", extra="video", purpose="OpenCV's features")
        is_sift = kind == "SIFT"
        self._features = cv2.SIFT_create(_FEATURES) if is_sift else cv2.ORB_create(_FEATURES)
        self._matcher = cv2.BFMatcher(cv2.NORM_L2 if is_sift else cv2.NORM_HAMMING)

    def match(self, image0: np.ndarray, image1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Features (N, 2) of one image, and positions of the same points in the other image."""
        (points0, words0), (points1, words1) = (
            self._features.detectAndCompute(image, None) for image in (image0, image1)
        )
        if words0 is None or words1 is None:
            return np.empty((0, 2)), np.empty((0, 2))
        nearest = (found for found in self._matcher.knnMatch(words0, words1, 2) if len(found) == 2)
        plain = [first for first, second in nearest if first.distance < _RATIO * second.distance]
        return (
            np.array([points0[match.queryIdx].pt for match in plain]).reshape(-1, 2),
            np.array([points1[match.trainIdx].pt for match in plain]).reshape(-1, 2),
        )
