"""``plot.epipole``: the epipole with its 95 % region."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.plot.axes import image_axes, sized_camera
from farpoint.pose import RelativePose
from farpoint.sinks.overlay.epipole import view_epipole

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["epipole"]

_COLOUR = "#d18a00"


def epipole(
    pose: RelativePose,
    camera: Camera,
    *,
    image: np.ndarray | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the epipole in image 0 as a circle with a cross, with the 95 % region of the epipole.

    If the opposite point, from which the camera comes, is in view, a slanting cross marks this
    point. If neither point is in view, the visible parts of both regions are drawn.

    Parameters
    ----------
    pose : RelativePose
        A pose with a direction.
    camera : Camera
        Camera of image 0.
    image : ndarray, shape (height, width) or (height, width, 3), optional
        Image 0, drawn in the background.
    ax : matplotlib.axes.Axes, optional
        New axes by default, of the size of the image.

    Returns
    -------
    matplotlib.axes.Axes
        Axes in pixels of image 0, y down.

    Raises
    ------
    InputError
        If the pose has no direction, or neither the camera nor the image has a size.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).
    """
    camera, size = sized_camera(camera, image)
    view = view_epipole(pose, camera, size)
    if view is None:
        raise InputError(
            f"has no direction, its status is {pose.status.value}; expected OK", field="pose"
        )
    ax = image_axes(ax, size, image)
    ax.plot(*view.ring_px.T, color=_COLOUR, label="95 % of the epipole")
    for pixel, marker, name in (
        (view.ahead_px, "+", "epipole"),
        (view.behind_px, "x", "where the camera comes from"),
    ):
        if pixel is not None:
            x, y = pixel
            ax.plot(x, y, linestyle="", marker="o", markersize=11, fillstyle="none", color=_COLOUR)
            ax.plot(x, y, linestyle="", marker=marker, markersize=16, color=_COLOUR, label=name)
    return ax
