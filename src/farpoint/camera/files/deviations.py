"""Standard deviations that OpenCV's calibration estimates and writes to a file."""

from __future__ import annotations

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.pinhole import Pinhole

__all__ = ["with_deviations"]

# Keys, without underscores, of the vector of deviations from `calibrateCameraExtended`.
WHOLE = (
    *("stddeviationsintrinsics", "stdintrinsics", "stddevintrinsics", "stdintr"),
    *("standarddeviationsintrinsics", "intrinsicsstddev"),
)
FEWEST = 4  # fx fy cx cy


def with_deviations(camera: Camera, fields: Fields, matrix: str, distortion: str | None) -> Camera:
    """The camera with the standard deviations of its parameters, if the file has deviations.

    OpenCV's interactive calibration appends ``_std_dev`` to the names of the matrix and of the
    coefficients. The deviations are in OpenCV's order, which is also the order of the parameters of
    `Pinhole`. A parameter that was not estimated has a deviation of zero. With a fixed aspect ratio
    the deviation of fx is zero, too, although fx follows fy.

    Parameters
    ----------
    camera : Camera
        Camera read from the file.
    fields : Fields
        The file.
    matrix, distortion : str
        Keys of the camera matrix and of the coefficients in the file.
    """
    if not isinstance(camera.model, Pinhole):
        return camera
    key, sigmas = _deviations(fields, matrix, distortion)
    if key is None or not any(sigmas):
        return camera
    if len(sigmas) < FEWEST:
        raise fields.error(key, f"expected at least {FEWEST} numbers, got {len(sigmas)}")
    with blame(fields, key):
        named = dict(zip(camera.model.parameters, sigmas, strict=False))
        camera = camera.with_parameter_sigmas(named)
    return _with_fixed_aspect(camera) if sigmas[0] == 0.0 < sigmas[1] else camera


def _with_fixed_aspect(camera: Camera) -> Camera:
    """The camera in which the relative error of fx equals that of fy."""
    covariance, parameters = camera.parameter_covariance(), camera.model.parameters
    ratio = parameters["fx"] / parameters["fy"]
    covariance[0, 0] = ratio**2 * covariance[1, 1]
    covariance[0, 1] = covariance[1, 0] = ratio * covariance[1, 1]
    return camera.with_parameter_covariance(covariance)


def _deviations(
    fields: Fields, matrix: str, distortion: str | None
) -> tuple[str | None, list[float]]:
    """The key of the deviations (None without deviations), and all values in OpenCV's order."""
    key = f"{matrix}_std_dev"
    if key in fields:
        beside = f"{distortion}_std_dev"
        rest = fields.numbers(beside) if beside in fields else []
        return key, fields.numbers(key, (4,)) + rest
    plain = {name.replace("_", "").lower(): name for name in fields.values}
    whole = next((plain[name] for name in WHOLE if name in plain), None)
    return (None, []) if whole is None else (whole, fields.numbers(whole))
