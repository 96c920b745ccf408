"""Image regions where tracks may lie: inside the lens' field and the mask."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import optional_import
from farpoint.tracks.constants import FIELD_STEP_PX
from farpoint.tracks.options import TrackerOptions
from farpoint.tracks.refinement import window_reach

__all__ = ["trackable_region", "unmasked_region"]


def trackable_region(camera: Camera, options: TrackerOptions | None = None) -> np.ndarray | None:
    """Mask of pixels whose matching window lies within the lens' field; None for all pixels.

    The edge of a fisheye's image circle has a strong contrast and does not move with the scene. A
    window that contains this edge would be matched at the same pixel in every image.

    Parameters
    ----------
    camera : Camera
        Camera of known image size.
    options : TrackerOptions, optional
        Window sizes.

    Returns
    -------
    ndarray of bool, shape (height, width), or None
    """
    assert camera.size is not None
    width, height = camera.size
    columns, rows = (
        np.arange(-FIELD_STEP_PX, n + FIELD_STEP_PX, FIELD_STEP_PX) for n in (width, height)
    )
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1)
    within = pixels.clip(0, np.array(camera.size) - 1)  # the image border is not the field's border
    seen = np.isfinite(camera.unproject(within.reshape(-1, 2))[:, 0]).reshape(pixels.shape[:2])
    if seen.all():
        return None
    blind = (~seen).astype(np.uint8).repeat(FIELD_STEP_PX, axis=0).repeat(FIELD_STEP_PX, axis=1)
    # Each sample stands for the 4 px to its right and below. The dilation by 4 px adds the pixels
    # to its left and above.
    apart = _apart_from(blind, _window_px(options) + FIELD_STEP_PX)
    return apart[FIELD_STEP_PX : FIELD_STEP_PX + height, FIELD_STEP_PX : FIELD_STEP_PX + width]


def unmasked_region(mask: np.ndarray, options: TrackerOptions | None = None) -> np.ndarray:
    """Pixels whose matching window, at the finest level, lies inside a mask.

    The mask is eroded by the larger of `window_reach` and `CornerOptions.block_px`. Windows of
    coarser pyramid levels can reach outside the mask, but coarser levels only give the initial
    positions of the refinement.

    Parameters
    ----------
    mask : ndarray of bool, shape (H, W)
        True where the image is used.
    options : TrackerOptions, optional
        Window sizes.

    Returns
    -------
    ndarray of bool, shape (H, W)
    """
    return _apart_from((~mask).astype(np.uint8), _window_px(options))


def _window_px(options: TrackerOptions | None) -> int:
    """Half width, px, of the image patch that detection and matching use at the finest level."""
    options = options or TrackerOptions()
    return max(window_reach(options.refinement), options.corners.block_px)


def _apart_from(blind: np.ndarray, reach: int) -> np.ndarray:
    """Mask of pixels without a blind (non-zero) pixel in the square of half width ``reach``."""
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    return cv2.dilate(blind, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)) == 0
