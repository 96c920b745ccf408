"""Summary of a calibration in a few lines."""

from __future__ import annotations

import numpy as np

from farpoint.camera.camera import Camera
from farpoint.camera.field_of_view import field_of_view
from farpoint.camera.radial_curve import draw_radial_curve

__all__ = ["describe"]


def describe(camera: Camera) -> str:
    """Text with source, image size, field of view, a line for each parameter, and radial curve.

    Parameters are printed with their 1 sigma if the camera has an uncertainty.

    Without an image size the text has neither field of view nor curve.

    Examples
    --------
    >>> lines = describe(Camera.pinhole(640, 480, 320, 320, 319.5, 239.5)).splitlines()
    >>> print(*lines[:7], sep=chr(10))
    camera: pinhole without distortion
    image size: 640 x 480 px
    field of view: horizontal 90.0 deg, vertical 73.7 deg, diagonal 102.7 deg
    fx = 320
    fy = 320
    cx = 319.5
    cy = 239.5
    """
    lines = [f"{camera.name}: {camera.model.title}"]
    if camera.source is not None:
        lines.append(f"read from: {camera.source}")
    lines += _extent(camera)
    lines += _uncertainty(camera)
    sigmas = _sigmas(camera)
    lines += [
        f"{name} = {value:.12g}" + (f" +- {sigmas[name]:.3g}" if sigmas.get(name) else "")
        for name, value in camera.model.parameters.items()
    ]
    if camera.size is not None:
        lines += ["", draw_radial_curve(camera)]
    return "\n".join(lines)


def _uncertainty(camera: Camera) -> list[str]:
    """Lines with the sigmas of focal length, centre and distortion, and with the read-out time."""
    lines, given = [], camera.uncertainty
    if given is not None and given.covariance is None:
        terms = (
            ("focal length", given.focal and f"{100 * given.focal:.3g} %"),
            ("principal point", given.center_px and f"{given.center_px:.3g} px"),
            ("distortion at the corner", given.distortion_px and f"{given.distortion_px:.3g} px"),
        )
        words = ", ".join(f"{name} {amount}" for name, amount in terms if amount)
        lines.append(f"uncertainty (1 sigma): {words}")
    if camera.readout_s is not None:
        sigma = camera.readout_sigma_s
        allowance = "" if sigma is None else f" +- {1e3 * sigma:.3g}"
        lines.append(f"read-out of a frame: {1e3 * camera.readout_s:.6g}{allowance} ms")
    return lines


def _sigmas(camera: Camera) -> dict[str, float]:
    """1 sigma of each parameter; empty if the sigmas need the unknown size of the images."""
    given = camera.uncertainty
    if given is not None and given.distortion_px is not None and camera.size is None:
        return {}
    return camera.parameter_sigmas()


def _extent(camera: Camera) -> list[str]:
    if camera.size is None:
        return ["image size: not in the calibration; the first frame fixes it"]
    field = field_of_view(camera)
    angles = ", ".join(
        f"{name} {np.rad2deg(angle):.1f} deg"
        for name, angle in (
            ("horizontal", field.horizontal_rad),
            ("vertical", field.vertical_rad),
            ("diagonal", field.diagonal_rad),
        )
    )
    lines = [f"image size: {camera.size[0]} x {camera.size[1]} px", f"field of view: {angles}"]
    if not field.complete:
        lines.append("no ray exists for part of the image: the lens model does not reach there")
    return lines
