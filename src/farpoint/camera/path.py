"""Images of paths on the sphere: curved lines, cut at the end of the field or at a seam."""

from __future__ import annotations

import numpy as np

from farpoint.camera.camera import Camera
from farpoint.camera.values import as_rows

__all__ = ["project_path"]

_STRAIGHT_PX = 0.2  # largest distance between the middle of a chord and its arc
_WIDEST_RAD = np.deg2rad(2.0)  # longest arc, so that no arc skips a part of the field
_FINEST_RAD = 1e-7  # arcs up to this length are not bisected
_HALVINGS = 30
_JUMP_PX = 1.0  # an arc that is not bisected crosses a seam if its pixels are farther apart
_CROWDED_PX = 0.1


def project_path(camera: Camera, rays: np.ndarray) -> np.ndarray:
    """Image of a path that joins rays by arcs of great circles.

    Pixels are added until the chords between neighbouring pixels are within 0.2 px of the arcs. A
    line ends in three cases: at the end of the field of the lens (found to a fraction of a pixel),
    at pixels that are farther outside the image than the image's own size, and at the seam of a
    360-degree picture.

    Parameters
    ----------
    camera : Camera
        Camera with any lens. If the camera has no image size, the line ends only at the end of the
        field of the lens, or at a seam.
    rays : ndarray, shape (K, 3)
        Corners of the path, as rays of any length in camera axes. Neighbours must be less than 180
        degrees apart. A row of NaN begins a new path, so that many paths can be drawn in one call.

    Returns
    -------
    ndarray, shape (M, 2)
        Pixels in the order of the path, with a row of NaN between pieces. Empty if no part of the
        path is seen.

    Examples
    --------
    >>> from farpoint.camera import Equirectangular
    >>> sphere = Camera(model=Equirectangular(width=400, height=200), size=(400, 200))
    >>> line = project_path(sphere, np.array([[0.1, 0.0, -1.0], [-0.1, 0.0, -1.0]]))
    >>> at_seam = int(np.flatnonzero(np.isnan(line[:, 0]))[0])
    >>> line[[0, at_seam - 1, at_seam + 1, -1], 0].round(1)  # out right, in again left
    array([393.2, 399.5,  -0.5,   5.8])
    """
    rays = as_rows(rays, 3, "rays")
    with np.errstate(invalid="ignore", divide="ignore"):
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    pixels = _seen(camera, rays)
    split = np.ones(max(len(rays) - 1, 0), bool)
    for _ in range(_HALVINGS):
        split, middles, middles_px = _to_bisect(camera, rays, pixels, split)
        if not split.any():
            break
        after = np.flatnonzero(split) + 1
        rays = np.insert(rays, after, middles, axis=0)
        pixels = np.insert(pixels, after, middles_px, axis=0)
        split = np.repeat(split, 1 + split)
    return _pieces(rays, pixels)


def _to_bisect(
    camera: Camera, rays: np.ndarray, pixels: np.ndarray, suspect: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mask of the suspect arcs that need a point in the middle, with rays and pixels of the
    middles.
    """
    start = np.flatnonzero(suspect)
    one, two = rays[start], rays[start + 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = (one + two) / np.linalg.norm(one + two, axis=1, keepdims=True)
    angle = np.linalg.norm(two - one, axis=1)  # NaN where a new path begins
    middle_px = _seen(camera, middle)
    one_px, two_px = pixels[start], pixels[start + 1]
    miss_px = np.linalg.norm((one_px + two_px) / 2.0 - middle_px, axis=1)
    seen = np.isfinite(np.stack([one_px, two_px, middle_px])[..., 0])
    rough = np.where(seen.all(axis=0), miss_px > _STRAIGHT_PX, seen.any(axis=0))
    needed = (angle > _FINEST_RAD) & (rough | (angle > _WIDEST_RAD))
    marked = np.zeros(len(suspect), bool)
    marked[start[needed]] = True
    return marked, middle[needed], middle_px[needed]


def _seen(camera: Camera, rays: np.ndarray) -> np.ndarray:
    """Pixels of rays; NaN also for pixels farther outside the image than the image's own size."""
    pixels = camera.project(rays)
    if camera.size is not None:
        size = np.array(camera.size)
        with np.errstate(invalid="ignore"):
            near = np.all((pixels > -size) & (pixels < 2 * size), axis=1)
        pixels[~near] = np.nan
    return pixels


def _pieces(rays: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The pixels, with one row of NaN at each end of the field and at each seam."""
    closest = np.linalg.norm(np.diff(rays, axis=0), axis=1) <= 2.0 * _FINEST_RAD
    jump = closest & (np.linalg.norm(np.diff(pixels, axis=0), axis=1) > _JUMP_PX)
    pixels = np.insert(pixels, np.flatnonzero(jump) + 1, np.nan, axis=0)
    pixels = pixels[~_crowded(pixels)]
    gap = np.isnan(pixels[:, 0])
    first_gap = gap & ~np.concatenate([[True], gap[:-1]])
    kept = pixels[~gap | first_gap]
    return kept[:-1] if len(kept) and np.isnan(kept[-1, 0]) else kept


def _crowded(pixels: np.ndarray) -> np.ndarray:
    """Mask of the pixels whose two neighbours are both closer than `_CROWDED_PX`."""
    crowded = np.zeros(len(pixels), bool)
    close = np.linalg.norm(np.diff(pixels, axis=0), axis=1) < _CROWDED_PX
    crowded[1:-1] = close[:-1] & close[1:]
    return crowded
