"""OpenSfM's ``camera_models.json``, also OpenDroneMap's ``cameras.json``: relative to the picture.

Lengths are relative to the larger side of the picture. The origin is the middle of the picture.
"""

from __future__ import annotations

from collections.abc import Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "OpenSfM camera models"
FIRST_IS_DEFAULT = False

KIND = "projection_type"
COMMON = (KIND, "width", "height")
ONE_FOCAL = ("focal",)
TWO_FOCAL = ("focal_x", "focal_y", "c_x", "c_y")
RADIAL, FISHEYE = ("k1", "k2"), ("k1", "k2", "k3", "k4")
DUAL = "dual"
SPHERES = ("spherical", "equirectangular")
# Parameters of each lens. Other parameters in a file must be zero.
PINHOLES = {
    "perspective": (*ONE_FOCAL, *RADIAL),
    "simple_radial": (*TWO_FOCAL, "k1"),
    "radial": (*TWO_FOCAL, *RADIAL),
    "brown": (*TWO_FOCAL, *RADIAL, "k3", "p1", "p2"),
}
FISHEYES = {
    "fisheye": (*ONE_FOCAL, *RADIAL),
    "fisheye_opencv": (*TWO_FOCAL, *FISHEYE),
    # These lenses have more coefficients, which must be zero.
    "fisheye62": (*TWO_FOCAL, *FISHEYE),
    "fisheye624": (*TWO_FOCAL, *FISHEYE),
}
PARAMETERS = {
    **PINHOLES,
    **FISHEYES,
    DUAL: (*ONE_FOCAL, *RADIAL, "transition"),
    **dict.fromkeys(SPHERES, ()),
}


def matches(file: CalibrationFile) -> bool:
    """Whether a group has a ``projection_type``."""
    return bool(names(file))


def names(file: CalibrationFile) -> list[str]:
    """Identifiers of the cameras, which OpenSfM generates from the EXIF data of the images."""
    return [
        key
        for key, group in file.fields.values.items()
        if isinstance(group, Mapping) and KIND in group
    ]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this name."""
    camera = file.fields.group(name)
    kind = camera.text(KIND).lower()
    if kind not in PARAMETERS:
        raise unsupported_lens(camera, KIND, PARAMETERS)
    refuse_others(camera, (*COMMON, *PARAMETERS[kind]))
    size = camera.size("width", "height")
    if size is None:
        raise camera.error("width", "the field is missing")
    return Camera(model=_lens(camera, kind, size), size=size, name=name)


def _lens(camera: Fields, kind: str, size: tuple[int, int]) -> CameraModel:
    if kind in SPHERES:
        if size[0] != 2 * size[1]:
            raise camera.error("height", f"expected half of the width, got {size[0]} x {size[1]}")
        return Equirectangular(width=size[0], height=size[1])
    if kind == DUAL:
        kind = _either(camera)
    fx, fy, cx, cy = _intrinsics(camera, size)
    k1, k2, k3, k4, p1, p2 = (
        camera.number(key) if key in camera else 0.0 for key in (*FISHEYE, "p1", "p2")
    )
    with blame(camera, KIND, fx=camera.first("focal", "focal_x") or KIND, fy="focal_y"):
        if kind in FISHEYES:
            return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)
        distortion = (k1, k2, p1, p2, k3)
        return Pinhole(
            **{"fx": fx, "fy": fy, "cx": cx, "cy": cy},
            distortion=distortion if any(distortion) else (),
        )


def _either(camera: Fields) -> str:
    """Lens of the model ``dual``, a blend of fisheye and pinhole, which must be one of the two."""
    transition = camera.number("transition") if "transition" in camera else 0.5
    if transition not in (0.0, 1.0):
        raise camera.error(
            "transition",
            "a lens between a fisheye and a pinhole is not supported; expected 0 or 1, "
            f"got {transition:g}",
        )
    return "perspective" if transition else "fisheye"


def _intrinsics(camera: Fields, size: tuple[int, int]) -> tuple[float, float, float, float]:
    scale = max(size)
    middle = [0.5 * (side - 1.0) for side in size]
    if "focal" in camera or "focal_x" not in camera:
        f = scale * camera.number("focal")
        return f, f, middle[0], middle[1]
    offsets = [camera.number(key) if key in camera else 0.0 for key in ("c_x", "c_y")]
    return (
        scale * camera.number("focal_x"),
        scale * camera.number("focal_y"),
        scale * offsets[0] + middle[0],
        scale * offsets[1] + middle[1],
    )
