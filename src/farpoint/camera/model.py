"""Protocol of lens models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, Self

import numpy as np

from farpoint.camera.roles import ParameterRoles

__all__ = ["CameraModel"]


class CameraModel(Protocol):
    """Interface of a lens model. Every model of this package is a frozen dataclass of floats.

    Pixel coordinates are OpenCV's: the centre of the top-left pixel is (0, 0). Camera axes are x
    right, y down, z forward.
    """

    @property
    def title(self) -> str:
        """Common name of this lens, such as ``"pinhole, radial-tangential distortion"``."""
        ...

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""
        ...

    @property
    def roles(self) -> ParameterRoles:
        """Effects of the parameters on the image, from which priors of their errors are built."""
        ...

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points in camera axes (N, 3); NaN rows for points that the lens does not
        see.
        """
        ...

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) of pixels (N, 2); NaN rows where no ray exists."""
        ...

    def project_jacobian(self, points: np.ndarray) -> np.ndarray:
        """Derivative of `project` by the point, shape (N, 2, 3); NaN where the result of `project`
        is NaN.
        """
        ...

    def unproject_jacobian(self, rays: np.ndarray) -> np.ndarray:
        """Derivative of the unit ray by the pixel, shape (N, 3, 2), rad/px, at rays (N, 3).

        The rays may have any length. The derivative is NaN for rays that the lens does not see.
        """
        ...

    def refinable(self) -> CameraModel:
        """The same lens, whose `parameters` include every parameter that can be estimated."""
        ...

    def with_parameters(self, values: np.ndarray | Mapping[str, float]) -> Self:
        """The lens with other values of its `parameters`: all values in order, or some by name."""
        ...

    def project_parameter_jacobian(self, points: np.ndarray) -> np.ndarray:
        """Derivative of `project` by the `parameters`, shape (N, 2, P), of points (N, 3).

        The columns are in the order of `parameters`. The derivative is NaN where `project` is NaN.
        """
        ...

    def linearised(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`project`, `project_jacobian` and `project_parameter_jacobian` of the same points."""
        ...

    def unproject_parameter_jacobian(self, rays: np.ndarray) -> np.ndarray:
        """Derivative of the unit ray of a fixed pixel by the `parameters`, shape (N, 3, P), rad.

        The rays (N, 3) may have any length. The derivative is NaN for rays that the lens does not
        see.
        """
        ...
