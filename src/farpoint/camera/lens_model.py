"""The common part of all lens models: validation, and the inverse of the derivative."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from typing import Any, Self, cast

import numpy as np

from farpoint.camera.kernels.lens import invert_projection
from farpoint.camera.roles import ParameterRoles
from farpoint.camera.values import in_blocks, parameter_values
from farpoint.errors import InputError

__all__ = ["LensModel"]


class LensModel(ABC):
    """Public methods of `CameraModel`, computed by row-by-row functions of a subclass."""

    @property
    @abstractmethod
    def title(self) -> str:
        """Common name of this lens."""

    @property
    @abstractmethod
    def parameters(self) -> dict[str, float]:
        """All parameters by name, in the usual order."""

    @property
    @abstractmethod
    def roles(self) -> ParameterRoles:
        """Roles of the parameters, for priors of their errors."""

    @abstractmethod
    def _project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points (N, 3)."""

    @abstractmethod
    def _unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) of pixels (N, 2)."""

    @abstractmethod
    def _project_jacobian(self, points: np.ndarray) -> np.ndarray:
        """Derivative of `_project` by the point, rows (N, 6) of d(u, v) / d(x, y, z)."""

    @abstractmethod
    def _project_parameter_jacobian(self, points: np.ndarray) -> np.ndarray:
        """Derivative of `_project` by the P parameters, (N, 2, P); NaN rows for unseen points."""

    @classmethod
    def _fields_of(cls, parameters: Mapping[str, float]) -> dict[str, Any]:
        """All arguments of the class, from the lens's parameters."""
        return dict(parameters)

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, float]) -> Self:
        """The lens with these `parameters`, by name in any order.

        Raises
        ------
        InputError
            For a missing or unknown parameter, which the message names, or for invalid values.
        """
        make: Callable[..., Self] = cls
        known = {field.name: field.default is MISSING for field in fields(cast(Any, cls))}
        given = cls._fields_of(parameters)
        for name in known | given:
            if name not in known:
                raise InputError(f"is no parameter of {cls.__name__}", field=name)
            if known[name] and name not in given:
                raise InputError("the parameter is missing", field=name)
        lens = make(**given)
        for name in lens.parameters:
            if name not in parameters:
                raise InputError("the parameter is missing", field=name)
        return lens

    def refinable(self) -> LensModel:
        """The same lens with all parameters that a refinement estimates.

        The result is the lens itself, except for a pinhole without distortion, which gets
        coefficients of zero.
        """
        return self

    def with_parameters(self, values: np.ndarray | Mapping[str, float]) -> Self:
        """The lens with other values of its `parameters`.

        Parameters
        ----------
        values : array_like, shape (P,), or mapping
            All values in the order of `parameters`, or some values by name. Parameters that are not
            named keep their values.

        Raises
        ------
        InputError
            For a wrong number of values, an unknown name, or invalid values.
        """
        return self.from_parameters(parameter_values(self.parameters, values))

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (N, 2) of points in camera axes (N, 3); NaN rows outside the field of the lens."""
        return in_blocks(self._project, points, 2)

    def unproject(self, pixels: np.ndarray) -> np.ndarray:
        """Unit rays (N, 3) of pixels (N, 2); NaN rows where no ray exists."""
        return in_blocks(self._unproject, pixels, 3)

    def project_jacobian(self, points: np.ndarray) -> np.ndarray:
        """Derivative of `project` by the point, shape (N, 2, 3); NaN where the result of `project`
        is NaN.
        """
        return in_blocks(self._project_jacobian, points, 6).reshape(-1, 2, 3)

    def project_parameter_jacobian(self, points: np.ndarray) -> np.ndarray:
        """Derivative of `project` by the `parameters`, shape (N, 2, P); NaN where the result of
        `project` is NaN.
        """
        count = len(self.parameters)
        flat = in_blocks(
            lambda part: self._project_parameter_jacobian(part).reshape(-1, 2 * count),
            points,
            2 * count,
        )
        return flat.reshape(-1, 2, count)

    def linearised(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`project`, `project_jacobian` and `project_parameter_jacobian` of the same points."""
        return (
            self.project(points),
            self.project_jacobian(points),
            self.project_parameter_jacobian(points),
        )

    def unproject_jacobian(self, rays: np.ndarray) -> np.ndarray:
        """Derivative of the unit ray by the pixel, shape (N, 3, 2), rad/px; NaN for rays outside
        the field.

        The derivative is the inverse of `project_jacobian` on the plane perpendicular to each of
        the rays (N, 3). The lengths of the rays are arbitrary.
        """
        rays = np.ascontiguousarray(rays, dtype=np.float64)
        jacobian = np.empty((len(rays), 3, 2))
        invert_projection(rays, self.project_jacobian(rays), jacobian)
        return jacobian

    def unproject_parameter_jacobian(self, rays: np.ndarray) -> np.ndarray:
        """Derivative of the unit ray of a fixed pixel by the `parameters`, shape (N, 3, P).

        The implicit function theorem gives the derivative: the pixel ``project(ray(p), p)`` does
        not change, so ``d ray / dp = -(d ray / d pixel) (d pixel / dp)``. The result is NaN for
        rays (N, 3) outside the field of the lens.
        """
        return -self.unproject_jacobian(rays) @ self.project_parameter_jacobian(rays)
