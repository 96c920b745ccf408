"""DSO's ``camera.txt``, which the TUM monoVO and TUM-VI data sets also contain."""

from __future__ import annotations

import re
from collections.abc import Callable

from farpoint.camera.arctangent import Arctangent
from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "DSO camera.txt"
FIRST_IS_DEFAULT = False

NUMBER = r"[-+]?[\d.][-+.\de]*"
FIRST = re.compile(rf"(?i)(?P<kind>[a-z]+)?\s*(?P<numbers>{NUMBER}(?:\s+{NUMBER}){{4,7}})")
SECOND = re.compile(r"\d+\s+\d+")


def _arctangent(fx: float, fy: float, cx: float, cy: float, omega: float) -> CameraModel:
    if omega == 0.0:
        return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy)
    return Arctangent(fx=fx, fy=fy, cx=cx, cy=cy, omega=omega)


def _pinhole(fx: float, fy: float, cx: float, cy: float, *distortion: float) -> CameraModel:
    return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=distortion if any(distortion) else ())


def _fisheye(fx: float, fy: float, cx: float, cy: float, *k: float) -> CameraModel:
    return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k[0], k2=k[1], k3=k[2], k4=k[3])


# Lens, and count of numbers after the first four. The one number of a pinhole must be zero.
LENSES: dict[str, tuple[Callable[..., CameraModel], int]] = {
    "fov": (_arctangent, 1),
    "pinhole": (_pinhole, 1),
    "radtan": (_pinhole, 4),
    "equidistant": (_fisheye, 4),
    "kannalabrandt": (_fisheye, 4),
}


def matches(file: CalibrationFile) -> bool:
    """Whether a line with a lens is followed by a line with an image size."""
    lines = file.lines
    return (
        2 <= len(lines) <= 4
        and FIRST.fullmatch(lines[0]) is not None
        and SECOND.fullmatch(lines[1]) is not None
    )


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, for its only camera."""
    return [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of the recorded images. DSO's crop and rectification are not applied.

    If both coordinates of the principal point are below 1, focal lengths and principal point are
    relative to the size of the image, and DSO subtracts 0.5 px from the principal point.
    """
    found = FIRST.fullmatch(file.lines[0])
    kind = (found["kind"] or "fov").lower() if found else ""
    fields = Fields(
        {"line 1": found["numbers"] if found else "", "line 2": file.lines[1]}, file.path
    )
    if kind not in LENSES:
        raise fields.error(
            "line 1", f"the lens model {kind!r} is not supported; expected {' or '.join(LENSES)}"
        )
    make, extra = LENSES[kind]
    fx, fy, cx, cy, *distortion = fields.numbers("line 1", (4 + extra,))
    size = fields.size_pair("line 2")
    if size is not None and cx < 1.0 and cy < 1.0:
        fx, fy, cx, cy = fx * size[0], fy * size[1], cx * size[0] - 0.5, cy * size[1] - 0.5
    with blame(fields, "line 1"):
        return Camera(model=make(fx, fy, cx, cy, *distortion), size=size, name=name)
