"""A calibrated camera: one class in front of every lens model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.values import as_rows
from farpoint.errors import InputError

__all__ = ["Camera", "CameraModel"]


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A lens model with the size of its images.

    Attributes
    ----------
    model : CameraModel
        The lens.
    size : (width, height) or None
        Pixels; None where the calibration gives none, until the first frame fixes it.
    name : str
        Name within its calibration file, or of the file.
    source : str or None
        The kind of file it was read from, and its path; None for one made in code.
    doubts : tuple of CameraModel
        Lenses that are one sigma off, one each way for each thing that is known only roughly; none
        for a calibrated camera. `Odometry` lets them widen the covariances.
    """

    model: CameraModel
    size: tuple[int, int] | None = None
    name: str = "camera"
    source: str | None = field(default=None, compare=False)
    doubts: tuple[CameraModel, ...] = ()

    @classmethod
    def pinhole(
        cls,
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        distortion: Sequence[float] = (),
    ) -> Camera:
        """Pinhole camera with radial-tangential distortion ``(k1, k2, p1, p2[, k3...])``.

        Parameters
        ----------
        width, height : int
            Image size, px.
        fx, fy, cx, cy : float
            Focal lengths and principal point, px; the centre of the top-left pixel is (0, 0).
        distortion : sequence of float
            OpenCV's coefficients in OpenCV's order; empty for none.

        Examples
        --------
        >>> Camera.pinhole(640, 480, 500, 500, 319.5, 239.5).unproject([[319.5, 239.5]])
        array([[0., 0., 1.]])
        """
        model = Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(distortion))
        return cls(model=model, size=_checked_size(width, height))

    def with_size(self, width: int, height: int) -> Camera:
        """The same camera for images of this size; an InputError if it has another size."""
        if self.size is not None and self.size != (width, height):
            raise InputError(
                f"images are {width}x{height} but the calibration is for "
                f"{self.size[0]}x{self.size[1]}",
                field="camera",
            )
        return replace(self, size=_checked_size(width, height))

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of rays or points in camera axes (N, 3), any length.

        NaN rows where the lens sees none (behind a pinhole, beyond the field where the model
        holds). Pixels outside the image rectangle are returned as they are.
        """
        return self.model.project(as_rows(points, 3, "points"))

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) in camera axes of pixels (N, 2); NaN rows where no ray exists."""
        return self.model.unproject(as_rows(pixels, 2, "pixels"))

    def unproject_jacobian(self, rays: np.ndarray) -> np.ndarray:
        """Derivative of the unit ray by the pixel, shape (N, 3, 2), rad/px, at rays (N, 3).

        Its columns are perpendicular to the ray: noise of a pixel times this is noise of the ray.
        NaN where the lens does not see the ray.
        """
        return self.model.unproject_jacobian(as_rows(rays, 3, "rays"))


def _checked_size(width: int, height: int) -> tuple[int, int]:
    for name, value in (("width", width), ("height", height)):
        if not (isinstance(value, int | np.integer) and value > 0):
            raise InputError(
                f"expected a positive whole number of pixels, got {value!r}", field=name
            )
    return int(width), int(height)
