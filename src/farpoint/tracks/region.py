"""Where in the image of a wide lens tracks may be."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.tracks.options import TrackerOptions
from farpoint.tracks.refinement import window_reach

__all__ = ["trackable_region"]

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
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    blind = (~seen).astype(np.uint8).repeat(_STEP_PX, axis=0).repeat(_STEP_PX, axis=1)
    # Each probe now stands for the four pixels from it on; those before it are added.
    options = options or TrackerOptions()
    reach = max(window_reach(options.refinement), options.corners.block_px) + _STEP_PX
    widened = cv2.dilate(blind, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    return widened[_STEP_PX : _STEP_PX + height, _STEP_PX : _STEP_PX + width] == 0
