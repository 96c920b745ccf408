"""Settings of stella_vslam (a group ``Camera``) and OpenVSLAM (keys such as ``Camera.fx``)."""

from __future__ import annotations

from collections.abc import Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.division import Division
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "stella_vslam settings"
FIRST_IS_DEFAULT = False

GROUP = "Camera"
COMMON = (
    *("name", "setup", "model", "cols", "rows", "fps", "color_order"),
    *("focal_x_baseline", "true_baseline", "depth_threshold", "num_grid_cols", "num_grid_rows"),
)
FOCAL = ("fx", "fy", "cx", "cy")
SPHERE = "equirectangular"
# For each lens its parameters beside the focal ones.
PARAMETERS = {
    "perspective": ("k1", "k2", "p1", "p2", "k3"),
    "fisheye": ("k1", "k2", "k3", "k4"),
    "radial_division": ("distortion",),
    SPHERE: (),
}


def matches(file: CalibrationFile) -> bool:
    """Whether the file has ``Camera.model``, or a group ``Camera`` with ``model``, ``setup`` or one
    of ``fx fy cx cy``.
    """
    group = file.fields.values.get(GROUP)
    return f"{GROUP}.model" in file.fields or (
        isinstance(group, Mapping) and any(key in group for key in ("model", "setup", *FOCAL))
    )


def names(file: CalibrationFile) -> list[str]:
    """The ``name`` of the camera, or else the name of the file."""
    camera = _camera(file)
    return [camera.text("name") if "name" in camera else file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera. An equirectangular picture has no parameters except its size."""
    camera = _camera(file)
    kind = camera.text("model").lower()
    if kind not in PARAMETERS:
        raise unsupported_lens(camera, "model", PARAMETERS)
    focal = () if kind == SPHERE else FOCAL
    refuse_others(camera, (*COMMON, *focal, *PARAMETERS[kind]))
    size = camera.size("cols", "rows")
    if size is None:
        raise camera.error("cols", "the field is missing")
    return Camera(model=_lens(camera, kind, size), size=size, name=name)


def _camera(file: CalibrationFile) -> Fields:
    fields = file.fields
    if isinstance(fields.values.get(GROUP), Mapping):
        return fields.group(GROUP)
    prefix = f"{GROUP}."
    flat = {
        key.removeprefix(prefix): value
        for key, value in fields.values.items()
        if key.startswith(prefix)
    }
    return Fields(flat, file.path, prefix)


def _lens(camera: Fields, kind: str, size: tuple[int, int]) -> CameraModel:
    if kind == SPHERE:
        return Equirectangular(width=size[0], height=size[1])
    fx, fy, cx, cy = (camera.number(key) for key in FOCAL)
    coefficients = tuple(camera.number(key) for key in PARAMETERS[kind])
    with blame(camera, "model", **{key: key for key in FOCAL}, k="distortion"):
        if kind == "perspective":
            return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=coefficients)
        if kind == "radial_division":
            return Division(fx=fx, fy=fy, cx=cx, cy=cy, k=coefficients[0])
        k1, k2, k3, k4 = coefficients
        return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)
