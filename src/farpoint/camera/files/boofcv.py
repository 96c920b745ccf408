"""BoofCV's YAML: a group ``pinhole`` and a ``model``, for one camera or a stereo pair."""

from __future__ import annotations

from collections.abc import Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.matrix import intrinsics_by_name
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_others, refuse_unread
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.unified import Unified

TITLE = "BoofCV calibration"
FIRST_IS_DEFAULT = False

PINHOLE, BROWN = "pinhole", "pinhole_radial_tangential"
OMNI = "omnidirectional_universal"
MODELS = (PINHOLE, BROWN, OMNI)
# Groups: left and right of a stereo pair; intrinsic of a camera with depth or above a plane.
GROUPS = ("left", "right", "intrinsic")
MOST_RADIAL = 3


def matches(file: CalibrationFile) -> bool:
    """Whether the file has a ``model`` and a group ``pinhole``, at the top or in a group."""
    return bool(_cameras(file))


def names(file: CalibrationFile) -> list[str]:
    """``left`` and ``right`` of a stereo pair, or the name of the file for a single camera."""
    return list(_cameras(file))


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this file."""
    camera = _cameras(file)[name]
    kind = camera.text("model").lower()
    if kind not in MODELS:
        raise unsupported_lens(camera, "model", MODELS)
    pinhole = camera.group("pinhole")
    model = _lens(camera, pinhole, kind)
    refuse_unread(camera)
    return Camera(model=model, size=pinhole.size("width", "height"), name=name)


def _cameras(file: CalibrationFile) -> dict[str, Fields]:
    fields = file.fields
    if _is_camera(fields.values):
        return {file.path.stem: fields}
    found = {key: fields.group(key) for key in GROUPS if _is_camera(fields.values.get(key))}
    if set(found) == {"intrinsic"}:
        return {file.path.stem: found["intrinsic"]}
    return found


def _is_camera(values: object) -> bool:
    return (
        isinstance(values, Mapping)
        and isinstance(values.get("pinhole"), Mapping)
        and isinstance(values.get("model"), str)
    )


def _lens(camera: Fields, pinhole: Fields, kind: str) -> CameraModel:
    refuse_others(pinhole, ("fx", "fy", "cx", "cy", "skew", "width", "height"))
    intrinsics = intrinsics_by_name(pinhole)
    skew = pinhole.number("skew") if "skew" in pinhole else 0.0
    distortion = () if kind == PINHOLE else _distortion(camera)
    with blame(camera, "pinhole", distortion="radial_tangential", xi="mirror_offset"):
        if kind == OMNI:
            xi = camera.number("mirror_offset")
            return Unified(**intrinsics, xi=xi, distortion=distortion, skew=skew)
        if skew:
            raise pinhole.error("skew", f"a pinhole with skew is not supported; got {skew:g}")
        return Pinhole(**intrinsics, distortion=distortion)


def _distortion(camera: Fields) -> tuple[float, ...]:
    """Coefficients in OpenCV's order.

    BoofCV's formula ``r += radial[i] r^(2 i + 3)``, with t1 and t2, is that of OpenCV, but with any
    number of radial coefficients.
    """
    if camera.values.get("radial_tangential") is None:
        return ()
    group = camera.group("radial_tangential")
    refuse_others(group, ("radial", "t1", "t2"))
    radial = group.numbers("radial") if group.values.get("radial") is not None else []
    if any(radial[MOST_RADIAL:]):
        raise group.error("radial", f"expected at most {MOST_RADIAL} numbers, got {len(radial)}")
    k1, k2, k3 = (*radial, 0.0, 0.0, 0.0)[:MOST_RADIAL]
    t1, t2 = (group.number(key) if key in group else 0.0 for key in ("t1", "t2"))
    return (k1, k2, t1, t2, k3) if k3 else (k1, k2, t1, t2)
