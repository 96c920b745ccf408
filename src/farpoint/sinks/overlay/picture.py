"""Picture of the tracks, flow, epipole and values of one frame, as a pure function."""

from __future__ import annotations

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError, optional_import
from farpoint.odometry import OdometryResult
from farpoint.sinks.overlay.canvas import Canvas
from farpoint.sinks.overlay.layout import Layout
from farpoint.sinks.overlay.palette import (
    BACKGROUND,
    PALETTES,
    QUIET_GREY,
    Palette,
    PaletteName,
)
from farpoint.sinks.overlay.panel import draw_panel
from farpoint.sinks.overlay.panes import draw_flow_pane, draw_points_pane

__all__ = ["draw_overlay"]


def draw_overlay(
    image: np.ndarray | None,
    result: OdometryResult,
    camera: Camera,
    palette: PaletteName = "red-green",
    mask: np.ndarray | None = None,
) -> np.ndarray:
    """Draw the motion of one frame in the style of the screenshots of Burschka and Mair (2008).

    The left pane is the newer image with its tracks (far red, near green, outliers grey). The right
    pane is the translational flow in pixels of the older image; flow lines are great circles if the
    lens bends lines. The epipole is a circle with a cross inside its 95 % ellipse, and the opposite
    end of the line of travel is a circle with a slanting cross. If the epipole and the opposite end
    are outside the image, an arrow at the border points to the epipole. The panel below has the
    motion with its 1-sigma.

    Parameters
    ----------
    image : ndarray of uint8, shape (height, width) or (height, width, 3), or None
        The newer frame, grey or RGB; None if the frame could not be decoded. An image of another
        size is stretched to the camera's size.
    result : OdometryResult
        Result of the frame.
    camera : Camera
        The camera of both frames.
    palette : {"red-green", "orange-blue"}
        The colours of ``orange-blue`` (far orange, near blue) are distinct with any kind of colour
        vision.
    mask : ndarray of bool, shape (height, width), optional
        True where the image is used. Other parts are darkened and hatched. A mask of another size
        is stretched to the camera's size.

    Returns
    -------
    ndarray of uint8, shape (H, W, 3)
        The picture, RGB. Width and height are even and depend on the camera's image size alone.

    Raises
    ------
    InputError
        If neither the camera nor the image has a size, or if there is no such palette.
    """
    if palette not in PALETTES:
        raise InputError(f"expected one of {', '.join(PALETTES)}, got {palette!r}", field="palette")
    size = camera.size if image is None or camera.size is not None else image.shape[1::-1]
    if size is None:
        raise InputError("expected an image, or a camera that knows its image size", field="image")
    layout = Layout.of_image(*size)
    picture = np.empty((layout.height, layout.width, 3), np.uint8)
    picture[0] = BACKGROUND
    picture[1:] = picture[0]  # by rows: ten times faster than by pixels
    if image is not None:
        pane = picture[layout.pane_slices(0)]
        pane[:] = _fitted(image, layout.pane)
        if mask is not None:
            _hatch(pane, mask, layout.line_px)
    colours = PALETTES[palette]
    points, flow = (_canvas(picture, layout, index, size, colours) for index in (0, 1))
    draw_points_pane(points, result, camera, layout.line_px)
    draw_flow_pane(flow, result, camera, size, layout.line_px)
    draw_panel(picture[-layout.panel_height :], result, layout.line_px, colours)
    return picture


def _canvas(
    picture: np.ndarray, layout: Layout, index: int, size: tuple[int, int], palette: Palette
) -> Canvas:
    return Canvas(
        pixels=picture[layout.pane_slices(index)],
        scale=np.array(layout.pane) / np.array(size),
        stroke=layout.stroke,
        palette=palette,
    )


def _fitted(image: np.ndarray, pane: tuple[int, int]) -> np.ndarray:
    """The image at the pane's size, as RGB."""
    cv2 = optional_import("cv2", extra="video", purpose="drawing the overlay")
    if image.shape[1::-1] != pane:
        shrinks = image.shape[1] > pane[0]
        image = cv2.resize(
            image, pane, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        )
    return image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)


def _hatch(pane: np.ndarray, mask: np.ndarray, line_px: float) -> None:
    """Darken and stripe the picture where the mask is False; stripes also mark dark parts."""
    cv2 = optional_import("cv2", extra="video", purpose="drawing the overlay")
    height, width = pane.shape[:2]
    fitted = cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    unused = fitted == 0
    period = max(round(line_px), 4)
    across = np.add.outer(np.arange(height), np.arange(width)) % period
    pane[unused] //= 3
    pane[unused & (across < max(period // 8, 1))] = QUIET_GREY
