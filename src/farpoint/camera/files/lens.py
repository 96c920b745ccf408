"""Lens models from the names and numbers of EuRoC and Kalibr files."""

from __future__ import annotations

from collections.abc import Callable, Collection

from farpoint.camera.arctangent import Arctangent
from farpoint.camera.double_sphere import DoubleSphere
from farpoint.camera.extended_unified import ExtendedUnified
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.understood import refuse_contradiction
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.unified import Unified
from farpoint.errors import InputError

__all__ = ["lens_of_sensor", "unsupported_lens"]


def lens_of_sensor(fields: Fields, *, coefficients: str) -> CameraModel:
    """The lens of a group with ``camera_model``, ``intrinsics`` and ``distortion_model``.

    Parameters
    ----------
    fields : Fields
        The group.
    coefficients : str
        Key of the distortion coefficients.
    """
    projection = fields.text("camera_model").lower()
    if projection not in LENSES:
        raise unsupported_lens(fields, "camera_model", LENSES)
    distortions = LENSES[projection]
    distortion = fields.text("distortion_model").lower() if "distortion_model" in fields else "none"
    if distortion not in distortions:
        raise unsupported_lens(fields, "distortion_model", distortions)
    if distortion == "none" and "distortion_model" in fields:
        refuse_contradiction(fields, "distortion_model", coefficients)
    return distortions[distortion](fields, coefficients)


def unsupported_lens(fields: Fields, key: str, known: Collection[str]) -> InputError:
    """Error for a lens model that farpoint does not support."""
    problem = f"the lens model {fields.text(key)!r} is not supported; expected {' or '.join(known)}"
    return fields.error(key, problem)


def _pinhole(fields: Fields, coefficients: str | None) -> Pinhole:
    fx, fy, cx, cy = fields.numbers("intrinsics", (4,))
    distortion = () if coefficients is None else tuple(fields.numbers(coefficients))
    with blame(fields, "intrinsics", distortion=coefficients or "intrinsics"):
        return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=distortion)


def _undistorted_pinhole(fields: Fields, coefficients: str) -> Pinhole:  # noqa: ARG001
    return _pinhole(fields, None)


def _fisheye(fields: Fields, coefficients: str) -> KannalaBrandt:
    fx, fy, cx, cy = fields.numbers("intrinsics", (4,))
    k1, k2, k3, k4 = fields.numbers(coefficients, (4,))
    with blame(fields, "intrinsics"):
        return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)


def _extended_unified(fields: Fields, coefficients: str) -> ExtendedUnified:  # noqa: ARG001
    alpha, beta, fx, fy, cx, cy = fields.numbers("intrinsics", (6,))
    with blame(fields, "intrinsics"):
        return ExtendedUnified(fx=fx, fy=fy, cx=cx, cy=cy, alpha=alpha, beta=beta)


def _double_sphere(fields: Fields, coefficients: str) -> DoubleSphere:  # noqa: ARG001
    xi, alpha, fx, fy, cx, cy = fields.numbers("intrinsics", (6,))
    with blame(fields, "intrinsics"):
        return DoubleSphere(fx=fx, fy=fy, cx=cx, cy=cy, xi=xi, alpha=alpha)


def _arctangent(fields: Fields, coefficients: str) -> Arctangent:
    fx, fy, cx, cy = fields.numbers("intrinsics", (4,))
    (omega,) = fields.numbers(coefficients, (1,))
    with blame(fields, "intrinsics", omega=coefficients):
        return Arctangent(fx=fx, fy=fy, cx=cx, cy=cy, omega=omega)


def _unified(fields: Fields, coefficients: str | None) -> Unified:
    xi, fx, fy, cx, cy = fields.numbers("intrinsics", (5,))
    distortion = () if coefficients is None else tuple(fields.numbers(coefficients))
    with blame(fields, "intrinsics", distortion=coefficients or "intrinsics"):
        return Unified(fx=fx, fy=fy, cx=cx, cy=cy, xi=xi, distortion=distortion)


def _undistorted_unified(fields: Fields, coefficients: str) -> Unified:  # noqa: ARG001
    return _unified(fields, None)


LENSES: dict[str, dict[str, Callable[[Fields, str], CameraModel]]] = {
    "pinhole": {
        "radtan": _pinhole,
        "radial-tangential": _pinhole,
        "plumb_bob": _pinhole,
        "equidistant": _fisheye,
        "fov": _arctangent,
        "none": _undistorted_pinhole,
    },
    "omni": {"radtan": _unified, "none": _undistorted_unified},
    "eucm": {"none": _extended_unified},
    "ds": {"none": _double_sphere},
}
