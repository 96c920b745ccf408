"""ROS's binning and region of interest: the part of the sensor that the images show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from farpoint.camera.camera import Camera
from farpoint.errors import InputError

__all__ = ["ReadOut"]


@dataclass(frozen=True, kw_only=True)
class ReadOut:
    """Binning and region of interest, as in ``sensor_msgs/CameraInfo``.

    Attributes
    ----------
    binning : tuple of int
        Number of pixels of the full image per pixel of the images, along x and y; 0 means 1.
    roi : tuple of int
        Part of the full image that is read out: x, y, width and height, px; zeros mean the full
        image.
    """

    binning: tuple[int, int] = (0, 0)
    roi: tuple[int, int, int, int] = (0, 0, 0, 0)

    def __post_init__(self) -> None:
        x, y, width, height = self.roi
        if min(self.binning) < 0:
            raise InputError(f"expected 0 or more, got {min(self.binning)}", field="binning")
        if min(self.roi) < 0 or (any(self.roi) and not (width and height)):
            raise InputError(f"{width} x {height} pixels at ({x}, {y}) are no part", field="roi")

    def is_whole(self, size: tuple[int, int] | None) -> bool:
        """Whether the images show the full image, which has this size, px."""
        return max(self.binning) <= 1 and self.roi in ((0, 0, 0, 0), (0, 0, *(size or ())))

    def of(self, camera: Camera) -> Camera:
        """The camera of the images, from the camera of the full image.

        A pixel (u, v) of the full image is ``((u - x) / bx, (v - y) / by)`` in a region of interest
        that begins at (x, y) and is binned by (bx, by), as in ``image_geometry``.

        Raises
        ------
        InputError
            If the region is not within the full image.
        """
        bx, by = (max(binning, 1) for binning in self.binning)
        x, y, width, height = self.roi
        if camera.size is not None:
            full_width, full_height = camera.size
            if x + width > full_width or y + height > full_height:
                problem = f"{width} x {height} pixels at ({x}, {y}) of {full_width} x {full_height}"
                raise InputError(problem, field="roi")
            if not width:
                width, height = camera.size
        model: Any = camera.model  # every lens of a CameraInfo has fx, fy, cx and cy
        model = replace(
            model,
            fx=model.fx / bx,
            fy=model.fy / by,
            cx=(model.cx - x) / bx,
            cy=(model.cy - y) / by,
        )
        return replace(camera, model=model, size=(width // bx, height // by) if width else None)
