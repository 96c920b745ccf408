"""Axes to draw on; only this module loads matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError, optional_import

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["image_axes", "new_axes", "sized_camera"]

_WIDTH_IN = 8.0


def new_axes(aspect: float = 1.0) -> Axes:
    """Axes of a new figure for a picture with width / height = `aspect`."""
    pyplot = optional_import("matplotlib.pyplot", extra="plot", purpose="plotting")
    _, axes = pyplot.subplots(figsize=(_WIDTH_IN, _WIDTH_IN / aspect), layout="constrained")
    return axes


def image_axes(axes: Axes | None, size: tuple[int, int], image: np.ndarray | None) -> Axes:
    """Axes in pixels, y down, for an image of `size` (width, height); the image is optional."""
    width, height = size
    axes = new_axes(width / height) if axes is None else axes
    if image is not None:
        axes.imshow(image, cmap="gray" if image.ndim == 2 else None)
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_xlabel("x, px")
    axes.set_ylabel("y, px")
    return axes


def sized_camera(camera: Camera, image: np.ndarray | None) -> tuple[Camera, tuple[int, int]]:
    """The camera with its image size, from the calibration or from the image."""
    if image is not None:
        camera = camera.with_size(image.shape[1], image.shape[0])
    if camera.size is None:
        raise InputError(
            "knows no image size: expected one of known size, or an image", field="camera"
        )
    return camera, camera.size
