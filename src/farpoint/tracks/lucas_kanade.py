"""Points found again: pyramidal Lucas-Kanade, forward and back."""

from __future__ import annotations

import numpy as np

from farpoint.errors import optional_import
from farpoint.tracks.options import LucasKanadeOptions

__all__ = ["follow"]

# OpenCV gives a window up below this smallest eigenvalue of its normal matrix per pixel. Corners
# were chosen by a bound with a meaning; this one only keeps the division from overflowing.
_MIN_EIGENVALUE = 1e-6


def follow(
    image0: np.ndarray,
    image1: np.ndarray,
    points0: np.ndarray,
    start: np.ndarray,
    options: LucasKanadeOptions,
) -> tuple[np.ndarray, np.ndarray]:
    """Positions in ``image1`` of points in ``image0``, to a fraction of a pixel.

    Every point is followed from ``image0`` to ``image1`` and back (Kalal et al., "Forward-Backward
    Error", ICPR 2010, doi:10.1109/ICPR.2010.675). The way back begins as far from its goal as the
    way forth did, so that a wrong match cannot return by starting at the answer.

    Parameters
    ----------
    image0, image1 : ndarray of uint8, shape (H, W)
        Grey values.
    points0 : ndarray of float64, shape (N, 2)
        Pixels in ``image0``.
    start : ndarray of float64, shape (N, 2)
        Where to begin in ``image1``: predicted positions, or ``points0`` again.
    options : LucasKanadeOptions
        Window, pyramid and bounds.

    Returns
    -------
    points1 : ndarray of float64, shape (N, 2)
        Pixels in ``image1``.
    found : ndarray of bool, shape (N,)
        Whether the point came back and lies within ``image1``.

    Notes
    -----
    OpenCV's Python binding does not take prebuilt pyramids; building them anew for each of the two
    calls costs 2 % of the tracking.
    """
    points1, found = _lucas_kanade(image0, image1, points0, start, options)
    limit = np.array(image1.shape[::-1]) - 1
    found &= np.all((points1 >= 0) & (points1 <= limit), axis=1)
    there, home = points1[found], points0[found]
    again, back = _lucas_kanade(image1, image0, there, there + home - start[found], options)
    error_px = np.linalg.norm(again - home, axis=1)
    found[found] = back & (error_px <= options.forward_backward_px)
    return points1, found


def _lucas_kanade(
    image0: np.ndarray,
    image1: np.ndarray,
    points0: np.ndarray,
    start: np.ndarray,
    options: LucasKanadeOptions,
) -> tuple[np.ndarray, np.ndarray]:
    if len(points0) == 0:
        return points0.copy(), np.zeros(0, bool)
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    points1, status, _ = cv2.calcOpticalFlowPyrLK(
        image0,
        image1,
        points0.astype(np.float32),
        start.astype(np.float32),
        winSize=(options.window_px, options.window_px),
        maxLevel=options.levels,
        criteria=(
            cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS,
            options.max_iterations,
            options.tolerance_px,
        ),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=_MIN_EIGENVALUE,
    )
    return points1.astype(np.float64), status.ravel() == 1
