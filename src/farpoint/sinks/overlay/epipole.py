"""Where the direction of travel meets the image, and how surely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.camera import Camera
from farpoint.pose import RelativePose

__all__ = ["EpipoleView", "view_epipole"]


@dataclass(frozen=True, kw_only=True, eq=False)
class EpipoleView:
    """The epipole as an image shows it.

    Attributes
    ----------
    heading : ndarray, shape (3,)
        Direction of travel in camera 0.
    pixel : ndarray, shape (2,), or None
        The epipole in image 0; None where neither end of the line of travel is in the image.
    backward : bool
        The pixel is where the camera comes from, not where it goes.
    ring_px : ndarray, shape (K, 2)
        Boundary of the heading's 95 % region, closed; NaN where the lens does not see it.
    """

    heading: np.ndarray
    pixel: np.ndarray | None
    backward: bool
    ring_px: np.ndarray


def view_epipole(pose: RelativePose, camera: Camera, size: tuple[int, int]) -> EpipoleView | None:
    """The epipole of a pose in an image of size (width, height); None without a direction."""
    heading, ring = pose.heading_cam0, pose.heading_region(0.95)
    if heading is None or ring is None:
        return None
    ends_px = camera.project(np.stack([heading, -heading]))
    beyond = np.abs(ends_px - (np.array(size) - 1) / 2.0) - np.array(size) / 2.0
    ahead_seen, behind_seen = np.all(beyond <= 0.0, axis=1)  # NaN compares as outside
    backward = bool(behind_seen and not ahead_seen)
    return EpipoleView(
        heading=heading,
        pixel=ends_px[int(backward)] if ahead_seen or behind_seen else None,
        backward=backward,
        ring_px=camera.project(-ring if backward else ring),
    )
