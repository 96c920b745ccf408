"""DepthAI's calibration of OAK cameras: a list ``cameraData`` of sockets and cameras."""

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

TITLE = "DepthAI calibration"
FIRST_IS_DEFAULT = False

LIST = "cameraData"
KNOWN = (
    *("cameraType", "distortionCoeff", "extrinsics", "height", "intrinsicMatrix"),
    *("lensPosition", "specHfovDeg", "width"),
)
PINHOLE, FISHEYE = 0, 1
TYPES = {PINHOLE: "perspective", FISHEYE: "fisheye"}


def matches(file: CalibrationFile) -> bool:
    """Whether there is a list ``cameraData``."""
    return isinstance(file.fields.values.get(LIST), list)


def names(file: CalibrationFile) -> list[str]:
    """The sockets: ``CAM_A``, ``CAM_B`` and so on."""
    return list(_cameras(file))


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera at one socket."""
    camera = _cameras(file)[name]
    refuse_others(camera, KNOWN)
    return Camera(model=_lens(camera), size=camera.size("width", "height"), name=name)


def _cameras(file: CalibrationFile) -> dict[str, Fields]:
    cameras = {}
    for index, item in enumerate(file.fields.values[LIST]):
        place = f"{LIST}[{index}]"
        if not (isinstance(item, list) and len(item) == 2 and isinstance(item[1], Mapping)):
            raise file.fields.error(place, "expected a socket and a camera")
        socket, camera = item
        is_letter = isinstance(socket, int) and 0 <= socket < 26
        cameras[f"CAM_{chr(65 + socket)}" if is_letter else str(socket)] = Fields(
            camera, file.path, f"{place}."
        )
    if not cameras:
        raise file.fields.error(LIST, "expected at least one camera")
    return cameras


def _lens(camera: Fields) -> CameraModel:
    kind = camera.number("cameraType") if "cameraType" in camera else PINHOLE
    if kind not in TYPES:
        known = " or ".join(f"{number} ({word})" for number, word in TYPES.items())
        raise camera.error(
            "cameraType", f"the lens model {kind:g} is not supported; expected {known}"
        )
    intrinsics = intrinsics_from_matrix(camera, "intrinsicMatrix")
    coefficients = camera.numbers("distortionCoeff", (0, 4, 5, 8, 12, 14))
    with blame(camera, "intrinsicMatrix", distortion="distortionCoeff"):
        if kind == PINHOLE:
            return Pinhole(
                **intrinsics, distortion=tuple(coefficients) if any(coefficients) else ()
            )
        if any(coefficients[4:]):
            raise camera.error("distortionCoeff", "expected zeros after the four of a fisheye")
        k1, k2, k3, k4 = coefficients[:4] or (0.0,) * 4
        return KannalaBrandt(**intrinsics, k1=k1, k2=k2, k3=k3, k4=k4)
