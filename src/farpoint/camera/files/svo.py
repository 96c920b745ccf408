"""SVO Pro's camera files: a list ``cameras``, each item with intrinsics and distortion."""

from __future__ import annotations

from collections.abc import Mapping

from farpoint.camera.arctangent import Arctangent
from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_contradiction, refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.scaramuzza import Scaramuzza

TITLE = "SVO Pro cameras"
FIRST_IS_DEFAULT = False

KNOWN = (
    *("label", "id", "serial", "line-delay-nanoseconds", "image_width", "image_height"),
    *("type", "intrinsics", "distortion", "mask", "T_B_C"),
)
TYPES = ("pinhole", "omni")
DISTORTIONS = ("none", "radial-tangential", "equidistant", "fisheye")
# Polynomial 5, centre 2, affine part 3, inverse polynomial 12, radii of the mask 2.
OMNI_COUNTS = (22, 24)


def matches(file: CalibrationFile) -> bool:
    """Whether the file has a list of groups ``camera``, or one such group."""
    fields = file.fields
    cameras = fields.values.get("cameras")
    if isinstance(cameras, list):
        return any(isinstance(item, Mapping) and "camera" in item for item in cameras)
    return all(key in fields for key in ("type", "intrinsics", "image_width")) and isinstance(
        fields.values.get("distortion", {}), Mapping
    )


def names(file: CalibrationFile) -> list[str]:
    """Labels of the cameras. A camera without a label is named ``cam0``, ``cam1`` and so on."""
    return list(_cameras(file))


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this name."""
    camera = _cameras(file)[name]
    refuse_others(camera, KNOWN)
    kind = camera.text("type").lower()
    if kind not in TYPES:
        raise unsupported_lens(camera, "type", TYPES)
    model = _omni(camera) if kind == "omni" else _pinhole(camera)
    return Camera(model=model, size=camera.size("image_width", "image_height"), name=name)


def _cameras(file: CalibrationFile) -> dict[str, Fields]:
    items = file.fields.values.get("cameras")
    if not isinstance(items, list):
        found = [file.fields]
    else:
        found = [
            Fields(item, file.path, f"cameras[{index}].").group("camera")
            for index, item in enumerate(items)
            if isinstance(item, Mapping)
        ]
    cameras: dict[str, Fields] = {}
    for index, camera in enumerate(found):
        label = camera.text("label") if "label" in camera else ""
        cameras[label if label and label not in cameras else f"cam{index}"] = camera
    return cameras


def _distortion(camera: Fields, allowed: tuple[str, ...]) -> tuple[str, Fields]:
    if "distortion" not in camera:
        return "none", camera
    group = camera.group("distortion")
    refuse_others(group, ("type", "parameters"))
    kind = group.text("type").lower()
    if kind not in allowed:
        raise unsupported_lens(group, "type", allowed)
    if kind == "none":
        refuse_contradiction(group, "type", "parameters")
    return kind, group


def _pinhole(camera: Fields) -> CameraModel:
    kind, distortion = _distortion(camera, DISTORTIONS)
    fx, fy, cx, cy = camera.numbers("intrinsics", (4,))
    at = distortion.place("parameters").removeprefix(camera.within)
    with blame(camera, "intrinsics", omega=at, distortion=at):
        if kind == "none":
            return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy)
        if kind == "radial-tangential":
            coefficients = tuple(distortion.numbers("parameters", (4,)))
            return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=coefficients)
        if kind == "fisheye":
            (omega,) = distortion.numbers("parameters", (1,))
            return Arctangent(fx=fx, fy=fy, cx=cx, cy=cy, omega=omega)
        k1, k2, k3, k4 = distortion.numbers("parameters", (4,))
        return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)


def _omni(camera: Fields) -> CameraModel:
    """OCamCalib's polynomial. The inverse polynomial in the file is approximate and not used."""
    _distortion(camera, ("none",))
    numbers = camera.numbers("intrinsics", OMNI_COUNTS)
    cx, cy, c, d, e = numbers[5:10]
    with blame(camera, "intrinsics"):
        return Scaramuzza(coefficients=tuple(numbers[:5]), cx=cx, cy=cy, c=c, d=d, e=e)
