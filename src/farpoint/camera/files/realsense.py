"""RealSense intrinsics, as ``rs-enumerate-devices -c`` and pyrealsense2 print them, or as JSON.

The lenses are those of librealsense's ``rs2_project_point_to_pixel``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from farpoint.camera.arctangent import Arctangent
from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import LENS_WORDS, refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "RealSense intrinsics"
FIRST_IS_DEFAULT = False

HEADING = re.compile(
    r"""(?m)^[ \t]*Intrinsics? of ["']?(?P<stream>[^"'/\n]+?)["']?\s*/\s*(?P<size>\d+x\d+)"""
    r"(?:\s*/\s*\{(?P<formats>[^}\n]*)\})?"
)
LINE = re.compile(
    r"(?m)^[ \t]*(Width|Height|PPX|PPY|Fx|Fy|Distortion|Coeffs|[KPSkps]\d+|Model):[ \t]*(.*)$"
)
N = r"[-+.\deE]+"
PRINTED = (
    re.compile(
        rf"\[\s*(?P<width>\d+)x(?P<height>\d+)\s+p\[(?P<ppx>{N}) (?P<ppy>{N})\]\s+"
        rf"f\[(?P<fx>{N}) (?P<fy>{N})\]\s+(?P<model>[A-Za-z][\w ]*?)\s*"
        r"\[(?P<coeffs>[^\]\n]*)\]\s*\]"
    ),
    re.compile(
        rf"width: (?P<width>\d+), height: (?P<height>\d+), ppx: (?P<ppx>{N}), ppy: (?P<ppy>{N}), "
        rf"fx: (?P<fx>{N}), fy: (?P<fy>{N}),\s+model: (?P<model>[^,\n]+), "
        r"coeffs: \[(?P<coeffs>[^\]\n]*)\]"
    ),
)
KNOWN = (
    *("width", "height", "ppx", "ppy", "fx", "fy", "coeffs"),
    *("model", "distortion_model", "distortion"),
)
MODEL_KEYS = ("model", "distortion_model", "distortion")
# In the order of the enumeration rs2_distortion.
MODELS = (
    *("none", "modifiedbrownconrady", "inversebrownconrady"),
    *("ftheta", "brownconrady", "kannalabrandt4"),
)
TANGENTIAL_AFTER_RADIAL = MODELS[1:3]


def matches(file: CalibrationFile) -> bool:
    """Whether the file has the intrinsics of a stream in a form that librealsense prints."""
    return bool(_cameras(file))


def names(file: CalibrationFile) -> list[str]:
    """Streams with a size, such as ``Color 640x480``, groups of JSON, or the name of the file.

    If pyrealsense2 printed several intrinsics, the names are numbers from 1.
    """
    return list(_cameras(file))


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of one stream."""
    camera = _cameras(file)[name]
    refuse_others(camera, KNOWN, only=LENS_WORDS)
    return Camera(model=_lens(camera), size=camera.size("width", "height"), name=name)


def _cameras(file: CalibrationFile) -> dict[str, Fields]:
    if HEADING.search(file.text):
        return _from_listing(file)
    if printed := [found for form in PRINTED for found in form.finditer(file.text)]:
        return _from_printed(file, printed)
    fields = file.fields
    if _is_camera(fields.values):
        return {file.path.stem: fields}
    return {
        key: fields.group(key)
        for key, value in fields.values.items()
        if isinstance(value, Mapping) and _is_camera(value)
    }


def _is_camera(values: Mapping[str, object]) -> bool:
    return "ppx" in values and "ppy" in values


def _from_printed(file: CalibrationFile, printed: list[re.Match[str]]) -> dict[str, Fields]:
    """Single intrinsics by the name of the file; several intrinsics by numbers from 1."""
    cameras = {}
    for index, found in enumerate(printed, start=1):
        name = file.path.stem if len(printed) == 1 else str(index)
        values = {str(key): value for key, value in found.groupdict().items()}
        cameras[name] = Fields(values, file.path, "" if len(printed) == 1 else f"{name} ")
    return cameras


def _from_listing(file: CalibrationFile) -> dict[str, Fields]:
    headings = list(HEADING.finditer(file.text))
    ends = [*(heading.start() for heading in headings[1:]), len(file.text)]
    cameras: dict[str, Fields] = {}
    for index, (heading, end) in enumerate(zip(headings, ends, strict=True), start=1):
        stream = f"{heading['stream'].strip()} {heading['size']}"
        synonyms = (stream, f"{stream} {heading['formats']}", f"{stream} {index}")
        name = next(name for name in synonyms if name not in cameras)
        # Extrinsics and motion intrinsics follow after an empty line.
        block = re.split(r"\n\s*\n", file.text[heading.end() : end])[0]
        values = {str(key).lower(): value.strip() for key, value in LINE.findall(block)}
        cameras[name] = Fields(values, file.path, f"{name} ")
    return cameras


def _lens(camera: Fields) -> CameraModel:
    fx, fy, cx, cy = (camera.number(key) for key in ("fx", "fy", "ppx", "ppy"))
    coefficients = camera.numbers("coeffs", (4, 5)) if "coeffs" in camera else []
    kind = _model(camera, is_plain=not any(coefficients))
    with blame(camera, "coeffs", fx="fx", fy="fy", cx="ppx", cy="ppy"):
        if kind == "ftheta":
            return Arctangent(fx=fx, fy=fy, cx=cx, cy=cy, omega=(*coefficients, 0.0)[0])
        if kind == "kannalabrandt4":
            k1, k2, k3, k4 = coefficients[:4] or (0.0,) * 4
            return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)
        if not any(coefficients):
            return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy)
        if kind == "none":
            raise camera.error("coeffs", "expected zeros for a lens without distortion")
        if kind in TANGENTIAL_AFTER_RADIAL and any(coefficients[2:4]):
            raise camera.error(
                "coeffs",
                "expected zeros for p1 and p2 of this lens model, whose tangential distortion is "
                "that of the radially distorted point, which farpoint does not have",
            )
        return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(coefficients))


def _model(camera: Fields, *, is_plain: bool) -> str:
    key = camera.first(*MODEL_KEYS)
    if key is None:
        if is_plain:
            return MODELS[0]
        raise camera.error(MODEL_KEYS[0], "the field is missing; the coefficients need it")
    text = camera.text(key)
    if text.isdigit() and int(text) < len(MODELS):
        return MODELS[int(text)]
    word = text.lower().removeprefix("distortion.").removeprefix("rs2_distortion_")
    word = re.sub(r"[^a-z0-9]", "", word)
    if word not in MODELS:
        raise camera.error(
            key, f"the lens model {text!r} is not supported; expected {' or '.join(MODELS)}"
        )
    return word
