"""Prior covariance of lens parameters from sigmas of focal length, centre and distortion."""

from __future__ import annotations

import numpy as np

from farpoint.camera.model import CameraModel
from farpoint.camera.roles import Direction, ParameterRoles
from farpoint.camera.uncertainty import CameraUncertainty
from farpoint.errors import InputError

__all__ = ["prior_covariance"]

ASPECT_SHARE = 0.1
"""Error of the aspect ratio and the shear of pixels, divided by the error of the focal length
(convention: pixels are square by construction, the focal length depends on the lens)."""

DECENTERING_SHARE = 0.25
"""Displacement at the corner by tangential, prism and tilt errors, divided by the displacement by
all errors of the distortion (convention)."""

ORDER_SHARE = 0.5
"""Displacement at the corner by each radial coefficient, divided by the displacement by the
coefficient before it (convention: displacements grow smoothly towards the corner, and no
coefficient is exact)."""

AXIS_STEP = 1e-4
"""Tangent of the angle off the axis of two rays, one on each side of the axis. The scale at the
centre of the image is proportional to the distance between the pixels of the two rays."""

NO_EFFECT_PX = 1e-9
"""Largest displacement at the corner, px per unit of a parameter, of a parameter that counts as
without effect, such as beta of an extended unified model with alpha = 0."""

RIM_SAMPLES = 2048


def prior_covariance(
    model: CameraModel, size: tuple[int, int] | None, uncertainty: CameraUncertainty | None
) -> np.ndarray:
    """Covariance (P, P) of the parameters of ``model.refinable()``, in their order and units.

    The covariance is the sum of independent errors, each along one direction of the parameters:
    common scale, aspect ratio, shear, each coordinate of the centre, and each coefficient of the
    distortion. Each error of a coefficient includes a change of the scale, so that the scale at the
    centre of the image does not change.

    Parameters
    ----------
    model : CameraModel
        The lens. Its ``refinable()`` may have more parameters than the lens.
    size : (width, height) or None
        Size of the images, px, which is needed for an error of the distortion.
    uncertainty : CameraUncertainty or None
        If None, the parameters are exact, and the covariance is zero.

    Raises
    ------
    InputError
        If the size is needed and unknown (field ``camera.size``), or the covariance has a wrong
        size (field ``covariance``).
    """
    refinable = model.refinable()
    names = list(refinable.parameters)
    if uncertainty is None:
        return np.zeros((len(names), len(names)))
    if uncertainty.covariance is not None:
        return _padded(np.array(uncertainty.covariance), len(model.parameters), len(names))
    roles = refinable.roles
    errors: list[Direction] = []
    if uncertainty.focal is not None:
        errors += _focal_errors(roles, uncertainty.focal)
    if uncertainty.center_px is not None:
        errors += [{name: uncertainty.center_px} for name in roles.center]
    if uncertainty.distortion_px is not None and roles.radial:
        errors += _distortion_errors(refinable, size, uncertainty.distortion_px)
    directions = np.zeros((len(names), len(errors)))
    for column, error in enumerate(errors):
        for name, change in error.items():
            directions[names.index(name), column] = change
    return directions @ directions.T


def _padded(covariance: np.ndarray, given: int, refinable: int) -> np.ndarray:
    """Covariance of all refinable parameters, with zeros for parameters without given values."""
    if len(covariance) not in (given, refinable):
        expected = " or ".join(f"({count}, {count})" for count in sorted({given, refinable}))
        raise InputError(f"expected shape {expected}, got {covariance.shape}", field="covariance")
    padded = np.zeros((refinable, refinable))
    padded[: len(covariance), : len(covariance)] = covariance
    return padded


def _focal_errors(roles: ParameterRoles, focal: float) -> list[Direction]:
    """Errors of scale, aspect and shear. The relative 1 sigma of fx and of fy is `focal`."""
    deformation = ASPECT_SHARE * focal
    common = np.sqrt(focal**2 - 0.25 * deformation**2)
    return [
        *([_scaled(roles.scale, common)] if roles.scale else []),
        *(_scaled(direction, deformation) for direction in roles.affine),
    ]


def _distortion_errors(
    model: CameraModel, size: tuple[int, int] | None, distortion_px: float
) -> list[Direction]:
    """Errors of the coefficients, together an RMS displacement `distortion_px` at the corners."""
    if size is None:
        raise InputError(
            "expected the size of the images: an error of the distortion is one at their corner",
            field="camera.size",
        )
    corners, errors = _corner_rays(model, size), []
    for names, shares, amount in _kinds(model.roles):
        directions = [_at_constant_scale(model, name) for name in names]
        effects = np.array([_displacement_px(model, change, corners) for change in directions])
        shares = np.where(effects > NO_EFFECT_PX, shares, 0.0)
        total = np.linalg.norm(shares)
        errors += [
            _scaled(direction, distortion_px * amount * share / (total * effect))
            for direction, share, effect in zip(directions, shares, effects, strict=True)
            if share > 0.0
        ]
    return errors


def _kinds(roles: ParameterRoles) -> list[tuple[tuple[str, ...], np.ndarray, float]]:
    """Radial and decentering distortion: parameters, their shares, and the share of the kind.

    A share is the displacement at the corner by one parameter (up to a common factor) or by one
    kind, divided by the total displacement. The squared shares of the two kinds sum to 1.
    """
    decentering = DECENTERING_SHARE if roles.decentering else 0.0
    return [
        (roles.radial, ORDER_SHARE ** np.arange(len(roles.radial)), np.sqrt(1.0 - decentering**2)),
        (roles.decentering, np.ones(len(roles.decentering)), decentering),
    ]


def _scaled(direction: Direction, factor: float) -> Direction:
    return {name: factor * change for name, change in direction.items()}


def _at_constant_scale(model: CameraModel, name: str) -> Direction:
    """A unit change of a parameter, and a change of scale that keeps the scale at the centre."""
    beside = np.array([[AXIS_STEP, 0.0, 1.0], [-AXIS_STEP, 0.0, 1.0]])
    width = np.subtract(*model.project(beside)[:, 0])
    column = list(model.parameters).index(name)
    slope = np.subtract(*model.project_parameter_jacobian(beside)[:, 0, column]) / width
    direction = _scaled(model.roles.scale, -slope)
    return direction | {name: direction.get(name, 0.0) + 1.0}


def _displacement_px(model: CameraModel, direction: Direction, rays: np.ndarray) -> float:
    """RMS displacement of the pixels of rays by the change `direction` of the parameters."""
    change = np.array([direction.get(name, 0.0) for name in model.parameters])
    displacement = model.project_parameter_jacobian(rays) @ change
    return float(np.sqrt(np.mean(np.sum(displacement**2, axis=1))))


def _corner_rays(model: CameraModel, size: tuple[int, int]) -> np.ndarray:
    """Rays (4, 3) of the corners of the image, or of the end of the field towards a corner."""
    right, bottom = size[0] - 1.0, size[1] - 1.0
    corners = np.array([(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)])
    axis_px = model.project(np.array([[0.0, 0.0, 1.0]]))
    shares = np.linspace(1.0, 0.0, RIM_SAMPLES)
    lines = axis_px + shares[:, None, None] * (corners - axis_px)
    rays = model.unproject(lines.reshape(-1, 2)).reshape(RIM_SAMPLES, 4, 3)
    seen = np.isfinite(model.project(rays.reshape(-1, 3))[:, 0]).reshape(RIM_SAMPLES, 4)
    return rays[np.argmax(seen, axis=0), np.arange(4)]
