"""Where in the image tracks may be: in the field of the lens, and where a mask allows."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.tracks.options import TrackerOptions
from farpoint.tracks.refinement import window_reach

__all__ = ["trackable_region", "unmasked_region"]

_STEP_PX = 4  # the field is probed this finely: a sixteenth of the time, and a rim 4 px narrower


def trackable_region(camera: Camera, options: TrackerOptions | None = None) -> np.ndarray | None:
    """Pixels whose matching window lies within the lens' field; None where that is all of them.

    The rim of a fisheye's circle is an edge that moves with the camera, and a very strong one: a
    window that touches it follows the rim, not the scene.

    Parameters
    ----------
    camera : Camera
        Of known image size.
    options : TrackerOptions, optional
        They say how wide the windows are.

    Returns
    -------
    ndarray of bool, shape (height, width), or None
    """
    assert camera.size is not None
    width, height = camera.size
    columns, rows = (np.arange(-_STEP_PX, n + _STEP_PX, _STEP_PX) for n in (width, height))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1)
    within = pixels.clip(0, np.array(camera.size) - 1)  # the image's border is no rim
    seen = np.isfinite(camera.unproject(within.reshape(-1, 2))[:, 0]).reshape(pixels.shape[:2])
    if seen.all():
        return None
    blind = (~seen).astype(np.uint8).repeat(_STEP_PX, axis=0).repeat(_STEP_PX, axis=1)
    # Each probe now stands for the four pixels from it on; those before it are added.
    apart = _apart_from(blind, _window_px(options) + _STEP_PX)
    return apart[_STEP_PX : _STEP_PX + height, _STEP_PX : _STEP_PX + width]


def unmasked_region(mask: np.ndarray, options: TrackerOptions | None = None) -> np.ndarray:
    """Pixels whose matching window, at the finest level, has no pixel that a mask leaves out.

    That is the mask eroded by half of the refinement's window and a pixel on either side for its
    gradients (`window_reach`), or by the corners' block where that is wider. The coarser levels of
    the pyramid reach farther: they only say where the refinement begins.

    Parameters
    ----------
    mask : ndarray of bool, shape (H, W)
        True where the image is used.
    options : TrackerOptions, optional
        They say how wide the windows are.

    Returns
    -------
    ndarray of bool, shape (H, W)
    """
    return _apart_from((~mask).astype(np.uint8), _window_px(options))


def _window_px(options: TrackerOptions | None) -> int:
    """How far from a track, px, its match may look at the finest level."""
    options = options or TrackerOptions()
    return max(window_reach(options.refinement), options.corners.block_px)


def _apart_from(blind: np.ndarray, reach: int) -> np.ndarray:
    """Pixels that have none of the blind ones (non-zero) within reach along either axis."""
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    return cv2.dilate(blind, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) == 0
