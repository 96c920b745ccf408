"""Gyroflow's lens profiles (JSON)."""

from __future__ import annotations

from collections.abc import Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.matrix import intrinsics_from_matrix
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "Gyroflow lens profile"
FIRST_IS_DEFAULT = False

LENS = "fisheye_params"
TOP_TO_BOTTOM = "TopToBottom"
FISHEYE, PINHOLE = "opencv_fisheye", "opencv_standard"
STRETCHES = ("input_horizontal_stretch", "input_vertical_stretch")
# In Gyroflow a stretch of at most this value means that the stretch is not given.
LEAST_STRETCH = 0.01
# Keys of the profile about the camera, its calibration, and Gyroflow's processing.
KNOWN = (
    *("name", "note", "calibrated_by", "camera_brand", "camera_model", "lens_model"),
    *("camera_setting", "calib_dimension", "orig_dimension", "output_dimension"),
    *("frame_readout_time", "frame_readout_direction", "gyro_lpf", "num_images", "fps"),
    *("official", "asymmetrical", "use_opencv_fisheye", "use_opencv_standard", "calib_params"),
    *("identifier", "calibrator_version", "date", "compatible_settings", "sync_settings"),
    *("focal_length", "crop_factor", "global_shutter", "digital_lens_params", "is_copy"),
    *("filename", "path_to_file", "optimal_fov", "rating", "checksum"),
    *(LENS, "distortion_model", "crop", *STRETCHES),
)
# A second distortion, applied in the camera; lenses between which a zoom lens is interpolated.
EXTRAS = ("digital_lens", "interpolations")
LENS_KNOWN = ("camera_matrix", "distortion_coeffs", "RMS_error", "radial_distortion_limit")


def matches(file: CalibrationFile) -> bool:
    """Whether there is a group ``fisheye_params``."""
    return isinstance(file.fields.values.get(LENS), Mapping)


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, for its only camera."""
    return [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of pictures of size ``calib_dimension``, with the principal point of the
    calibration.

    Gyroflow itself moves the principal point to the middle, unless a profile is ``asymmetrical``.
    """
    fields = file.fields
    refuse_others(fields, (*KNOWN, *EXTRAS))
    for key in EXTRAS:
        if fields.values.get(key):
            raise fields.error(key, "is not supported; expected none")
    for key in ("crop", *STRETCHES):
        value = fields.number(key) if fields.values.get(key) is not None else 1.0
        if value != 1.0 and not (key in STRETCHES and value <= LEAST_STRETCH):
            raise fields.error(key, f"is not supported; expected 1, got {value:g}")
    size = fields.group("calib_dimension").size("w", "h")
    if size is None:
        raise fields.error("calib_dimension.w", "the field is missing")
    camera = Camera(model=_lens(fields), size=size, name=name)
    readout_s = _readout_s(fields)
    return camera if readout_s is None else camera.with_readout(readout_s)


def _readout_s(fields: Fields) -> float | None:
    """Read-out time, s, from the first row to the last; None if the profile has no such time.

    The read-out time of a sensor that is read in another direction is not used.
    """
    if fields.values.get("global_shutter") is True:
        return 0.0
    if fields.values.get("frame_readout_direction") not in (None, "", TOP_TO_BOTTOM):
        return None
    if fields.values.get("frame_readout_time") is None:
        return None
    milliseconds = fields.number("frame_readout_time")
    return 1e-3 * milliseconds if milliseconds > 0.0 else None


def _lens(fields: Fields) -> CameraModel:
    model = fields.values.get("distortion_model")
    kind = FISHEYE if model in (None, "") else fields.text("distortion_model")
    if kind not in (FISHEYE, PINHOLE):
        raise fields.error(
            "distortion_model",
            f"the lens model {kind!r} is not supported; expected {FISHEYE} or {PINHOLE}",
        )
    group = fields.group(LENS)
    refuse_others(group, LENS_KNOWN)
    intrinsics = intrinsics_from_matrix(group, "camera_matrix")
    with blame(group, "camera_matrix", distortion="distortion_coeffs"):
        if kind == PINHOLE:
            coefficients = group.numbers("distortion_coeffs", (0, 4, 5, 8, 12))
            return Pinhole(**intrinsics, distortion=tuple(coefficients))
        coefficients = group.numbers("distortion_coeffs")
        if len(coefficients) < 4 or any(coefficients[4:]):
            raise group.error("distortion_coeffs", f"expected 4 numbers, got {len(coefficients)}")
        k1, k2, k3, k4 = coefficients[:4]
        return KannalaBrandt(**intrinsics, k1=k1, k2=k2, k3=k3, k4=k4)
