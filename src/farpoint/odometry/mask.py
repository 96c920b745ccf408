"""The image region in which points are tracked: pixels inside the mask and the lens' field."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.frames.mask import WHITE
from farpoint.tracks import TrackerOptions, trackable_region, unmasked_region

__all__ = ["checked_mask", "tracked_region"]


def checked_mask(mask: np.ndarray, size: tuple[int, int] | None) -> np.ndarray:
    """Copy of the mask as bool (H, W). In a mask of uint8, 128 and above becomes True.

    Raises
    ------
    InputError
        If the mask is invalid, has no True pixel, or has another size than ``size`` (width and
        height).
    """
    mask = np.asarray(mask)
    if mask.ndim != 2 or mask.dtype not in (np.dtype(bool), np.dtype(np.uint8)):
        raise InputError(
            f"expected bool or uint8 of shape (H, W), got {mask.dtype} {mask.shape}", field="mask"
        )
    used = mask.copy() if mask.dtype == bool else mask >= WHITE
    if size is not None:
        _check_size(used, size)
    if not used.any():
        raise InputError("expected pixels that are used, True or from 128 on", field="mask")
    return used


def tracked_region(
    camera: Camera, mask: np.ndarray | None, options: TrackerOptions
) -> np.ndarray | None:
    """Region (H, W), bool, in which tracks may lie; None if tracks may lie everywhere.

    The image size of the camera must be known.

    Raises
    ------
    InputError
        If the size of the mask differs from the camera's, or if no window fits into the mask.
    """
    assert camera.size is not None
    region = trackable_region(camera, options)
    if mask is None:
        return region
    _check_size(mask, camera.size)
    unmasked = unmasked_region(mask, options)
    region = unmasked if region is None else region & unmasked
    if not region.any():
        width = options.refinement.window_px
        raise InputError(
            f"expected room for a window of {width}x{width} pixels among those that are used",
            field="mask",
        )
    return region


def _check_size(mask: np.ndarray, size: tuple[int, int]) -> None:
    if mask.shape[::-1] != tuple(size):
        raise InputError(
            f"expected {size[0]}x{size[1]} pixels like the frames, "
            f"got {mask.shape[1]}x{mask.shape[0]}",
            field="mask",
        )
