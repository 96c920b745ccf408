"""OpenCV's FileStorage (YAML, XML or JSON) and ROS ``camera_info``: a camera matrix by name.

Files that people write by hand, with fields ``fx fy cx cy`` in place of the matrix, are read, too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from farpoint.camera.camera import Camera
from farpoint.camera.files.deviations import with_deviations
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.matrix import (
    NAMED,
    Intrinsics,
    intrinsics_by_name,
    intrinsics_from_matrix,
    skew_of_matrix,
)
from farpoint.camera.files.read_out import ReadOut
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import (
    ORDER,
    is_nothing,
    named_distortion,
    names_lens_model,
    refuse_contradiction,
    refuse_others,
    refuse_unread,
)
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.unified import Unified
from farpoint.errors import InputError

TITLE = "OpenCV camera matrix"
FIRST_IS_DEFAULT = False

# Names of the matrix and of the coefficients. In a file with several cameras, both names of a
# camera contain the same side or number.
PREFIX, SUFFIX = r"(?:(left|right|[lr](?=_))_?)?", r"[_ -]?(\d|left|right|l|r|)(?:_fe)?"
MATRIX = re.compile(
    PREFIX + r"(?:camera[_ -]?mat(?:rix)?|intrinsics?(?:[_ -]?matrix)?|mtx|k|m)" + SUFFIX,
    re.IGNORECASE,
)
DISTORTION = re.compile(
    PREFIX
    + r"(?:dist(?:ortion)?[_ -]?(?:coeff?(?:icient)?s?|vec(?:tor)?|params?|parameters|array|mat|)"
    + r"|kc|d)"
    + SUFFIX,
    re.IGNORECASE,
)
FISHEYE_COEFFICIENTS = re.compile(r".*_fe", re.IGNORECASE)
SIZES = (
    *(("imagewidth", "imageheight"), ("width", "height"), ("cols", "rows")),
    *(("imgwidth", "imgheight"), ("w", "h")),
)
SIZE_PAIRS = ("imagesize", "imgsize", "resolution", "size", "cameraresolution")
# Keys of lists of cameras, and keys of the name of a camera in a list.
LISTS = ("cameras", "camera", "intrinsics")
LABELS = ("name", "camera_name", "label", "id", "camera_id")
PINHOLES = ("plumb_bob", "rational_polynomial", "radtan", "pinhole", "none")
FISHEYES = ("equidistant", "fisheye")
FISHEYE_ORDER = ("k1", "k2", "k3", "k4")
SYNONYMS = {
    **dict.fromkeys(("plumb", "brown", "brownconrady", "perspective", "opencv"), PINHOLES[0]),
    **dict.fromkeys(("radialtangential", "standard", "normal", "linear"), PINHOLES[0]),
    **dict.fromkeys(("opencvpinhole", "modifiedbrownconrady"), PINHOLES[0]),
    **dict.fromkeys(("rational", "thinprism"), PINHOLES[1]),
    **dict.fromkeys(("opencvfisheye", "equi", "kannalabrandt", "kannalabrandt4"), FISHEYES[0]),
    **dict.fromkeys(("kannalabrandt8", "kb4", "kb8"), FISHEYES[0]),
    **{name.replace("_", ""): name for name in (*PINHOLES, *FISHEYES)},
}
MODEL = re.compile(
    r"(?:lens|camera|projection|distortion|dist|model)_?(?:model|type|kind)|model|setup|projection|lens",
    re.IGNORECASE,
)
MAY_NAME_A_SENSOR = re.compile(r"(?:camera|lens)_?(?:model|type)|model|lens", re.IGNORECASE)
# Names of OpenCV's fisheye model in fields of a method or flags.
OPENCV_FISHEYE = re.compile(
    r"(?:.*\b(?:cv2?|opencv)\W*|.*calib_)fisheye.*|fish.?eye", re.IGNORECASE
)
LENS_NAME = re.compile(
    r".*(?:omni|mei|unified|ucm|sphere|spher|fov|atan|scaramuzza|ocam|cahvor|equirect|panoram|"
    r"catadioptric|poly|division|theta|stereographic|orthographic|fish|lens).*|ds|kb\d*"
)


@dataclass(frozen=True)
class _Keys:
    """Keys of the matrix and of the distortion of one camera.

    Without a matrix, ``matrix`` is the first of the keys ``fx fy cx cy``.
    """

    matrix: str
    distortion: str | None


def matches(file: CalibrationFile) -> bool:
    """Whether a field, at the top or in a group or list, has the name and the content of a camera
    matrix.
    """
    return bool(_cameras(file.fields) or _groups(file.fields))


def names(file: CalibrationFile) -> list[str]:
    """Keys of the matrices or groups of several cameras; else the ``camera_name`` or file name."""
    fields = file.fields
    if cameras := _cameras(fields):
        found = [keys.matrix for keys in cameras]
    else:
        found = list(_groups(fields))
    if len(found) > 1:
        return found
    return [fields.text("camera_name") if "camera_name" in fields else file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this name."""
    fields = file.fields
    groups = {} if _cameras(fields) else _groups(fields)
    if not groups:
        return read_fields(fields, name)
    camera = read_fields(groups[name if name in groups else next(iter(groups))], name)
    refuse_unread(fields)
    return camera


def _groups(fields: Fields) -> dict[str, Fields]:
    """Groups that each describe a camera, such as ``left`` and ``right``, or the items of a list.

    An item of a list has the name in the item, or else a name ``cam0``, ``cam1`` and so on.
    """
    found: dict[str, Fields] = {}
    for key, value in fields.values.items():
        if isinstance(value, Mapping) and _cameras(Fields(value, fields.file)):
            found[key] = Fields(value, fields.file, f"{fields.place(key)}.")
        elif isinstance(value, list) and key.lower() in LISTS:
            for index, item in enumerate(value):
                camera = Fields(
                    item if isinstance(item, Mapping) else {}, fields.file, f"{key}[{index}]."
                )
                if _cameras(camera):
                    label = _label(camera)
                    found[label if label and label not in found else f"cam{index}"] = camera
    return found


def _label(camera: Fields) -> str:
    key = camera.first(*LABELS)
    return "" if key is None else camera.text(key)


def read_fields(fields: Fields, name: str) -> Camera:
    """One camera from fields, which need not come from a file."""
    cameras = _cameras(fields)
    keys = next((keys for keys in cameras if keys.matrix == name), cameras[0])
    size = _size(fields)
    camera = Camera(model=_lens(fields, keys), size=size, name=name)
    camera = with_deviations(camera, fields, keys.matrix, keys.distortion)
    camera = _as_read_out(camera, fields)
    others = {key for other in cameras for key in (other.matrix, other.distortion) if key}
    others |= {key for key in fields.values if _names_opencv_fisheye(key, fields.values[key])}
    refuse_unread(fields, others)
    return camera


def _as_read_out(camera: Camera, fields: Fields) -> Camera:
    """The camera after the binning and the region of interest of ROS's ``camera_info``.

    If ``binning_x`` or ``binning_y`` is missing, the camera is returned unchanged, and other fields
    of the read-out are left to the check for unread fields.
    """
    if not {"binning_x", "binning_y"} <= fields.values.keys():
        return camera
    with blame(fields, "roi", binning="binning_x"):
        binning = _whole(fields, "binning_x"), _whole(fields, "binning_y")
        region = (0, 0, 0, 0)
        if "roi" in fields:
            roi = fields.group("roi")
            if "do_rectify" in roi:
                roi.text("do_rectify")  # counts as read; only for rectified images
            x, y = _whole(roi, "x_offset"), _whole(roi, "y_offset")
            region = (x, y, _whole(roi, "width"), _whole(roi, "height"))
        read_out = ReadOut(binning=binning, roi=region)
        if camera.uncertainty is not None and not read_out.is_whole(camera.size):
            raise InputError("not understood beside standard deviations", field="roi")
        return read_out.of(camera)


def _whole(fields: Fields, key: str) -> int:
    """A whole number of pixels; 0 if the key is absent."""
    value = fields.number(key) if key in fields else 0.0
    if value != int(value):
        raise fields.error(key, f"expected a whole number of pixels, got {value:g}")
    return int(value)


def _lens(fields: Fields, keys: _Keys) -> CameraModel:
    distortion = _distortion(fields, keys)
    with blame(fields, keys.matrix, distortion=keys.distortion or keys.matrix, xi="xi"):
        if "xi" in fields and isinstance(fields.values[keys.matrix], list | Mapping):
            (xi,) = fields.numbers("xi", (1,))
            intrinsics = intrinsics_from_matrix(fields, keys.matrix, skewed=True)
            skew = skew_of_matrix(fields, keys.matrix)
            return Unified(**intrinsics, xi=xi, distortion=distortion, skew=skew)
        intrinsics = _intrinsics(fields, keys.matrix)
        if _is_fisheye(fields, keys):
            if len(distortion) != 4:
                at = keys.distortion or "distortion_coefficients"
                fields.numbers(at, (4,))
            k1, k2, k3, k4 = distortion
            return KannalaBrandt(**intrinsics, k1=k1, k2=k2, k3=k3, k4=k4)
        return Pinhole(**intrinsics, distortion=distortion)


def _intrinsics(fields: Fields, key: str) -> Intrinsics:
    """Focal lengths and principal point from a matrix, or from the fields ``fx fy cx cy``."""
    value = fields.values[key]
    if not isinstance(value, list | Mapping):
        return intrinsics_by_name(fields)
    if isinstance(value, Mapping) and _has_focal_names(value):
        return intrinsics_by_name(fields.group(key))
    return intrinsics_from_matrix(fields, key)


def _has_focal_names(values: Mapping[str, object]) -> bool:
    """Whether the file has all of ``fx fy cx cy``, each as a single number or word."""
    return all(name in values and not isinstance(values[name], list | Mapping) for name in NAMED)


def _distortion(fields: Fields, keys: _Keys) -> tuple[float, ...]:
    """Coefficients from a list, a group ``k1: ...``, or fields such as ``k1`` beside the matrix."""
    if keys.distortion is None:
        group = fields
        value = fields.values[keys.matrix]
        if isinstance(value, Mapping) and _has_focal_names(value) and not _has_any(fields):
            group = fields.group(keys.matrix)
        return _named_distortion(group, is_fisheye=_is_fisheye(fields, keys))
    for key in fields.values:
        if MODEL.fullmatch(key) and "dist" in key.lower() and _is_none(fields.values[key]):
            refuse_contradiction(fields, key, keys.distortion)
    value = fields.values[keys.distortion]
    if isinstance(value, Mapping) and "data" not in value:
        group = fields.group(keys.distortion)
        refuse_others(group, ORDER)
        return _named_distortion(group, is_fisheye=_is_fisheye(fields, keys))
    return tuple(fields.numbers(keys.distortion))


def _has_any(fields: Fields) -> bool:
    return any(name in fields for name in ORDER)


def _is_none(value: object) -> bool:
    return isinstance(value, str) and value.strip().lower() == "none"


def _named_distortion(group: Fields, *, is_fisheye: bool) -> tuple[float, ...]:
    """Coefficients from fields such as ``k1``, in the order of the lens: pinhole or fisheye.

    Fields ``k1 k2 k3 k4`` alone may belong to either lens, and raise an InputError if no field
    names the lens.
    """
    if not _has_any(group):
        return ()
    if is_fisheye:
        for key in ORDER:
            if key not in FISHEYE_ORDER and not is_nothing(group.values.get(key)):
                raise group.error(key, "expected k1 k2 k3 k4 alone of a fisheye")
        return tuple(group.number(key) for key in FISHEYE_ORDER)
    if all(key in group for key in FISHEYE_ORDER) and "p1" not in group and "k5" not in group:
        raise group.error(
            "k4",
            "k1 k2 k3 k4 alone may be of a fisheye; expected a field that names the lens model",
        )
    return named_distortion(group)


def _cameras(fields: Fields) -> list[_Keys]:
    distortions = {
        _which(hit): key
        for key, value in fields.values.items()
        if not _is_a_word(value) and (hit := DISTORTION.fullmatch(key))
    }
    matrices = {
        _which(hit): key
        for key, value in fields.values.items()
        if isinstance(value, list | Mapping) and (hit := MATRIX.fullmatch(key))
    }
    if not matrices and _has_focal_names(fields.values):
        matrices = {"": NAMED[0]}
    if len(matrices) == len(distortions) == 1:  # whatever suffixes they have
        return [_Keys(*matrices.values(), *distortions.values())]
    return [_Keys(key, distortions.get(suffix)) for suffix, key in matrices.items()]


def _which(hit: re.Match[str]) -> str:
    """The side or number of a camera, from before or after the name of a field."""
    return f"{hit[1] or ''}{hit[2]}".lower()


def _is_a_word(value: object) -> bool:
    """Whether a value is text without a number, such as the name of a model."""
    return isinstance(value, str) and not re.search(r"\d", value)


def _is_fisheye(fields: Fields, keys: _Keys) -> bool:
    """Whether the coefficients belong to a fisheye. An unknown lens raises an InputError."""
    if keys.distortion is not None and FISHEYE_COEFFICIENTS.fullmatch(keys.distortion):
        return True
    flags = [_is_fisheye_flag(fields, key) for key in fields.values if "fisheye" in key.lower()]
    named = [kind for key in fields.values if MODEL.fullmatch(key) for kind in _kind(fields, key)]
    has_opencv_name = any(_names_opencv_fisheye(key, value) for key, value in fields.values.items())
    return has_opencv_name or any(flags) or any(kind in FISHEYES for kind in named)


def _names_opencv_fisheye(key: str, value: object) -> bool:
    """Whether a text, or one of a list of texts, is a name of OpenCV's fisheye model."""
    texts = value if isinstance(value, list) else [value]
    return names_lens_model(key, value) and any(
        OPENCV_FISHEYE.fullmatch(str(text)[:200]) for text in texts
    )


def _is_fisheye_flag(fields: Fields, key: str) -> bool:
    """Whether a field, which must be a flag, marks the lens as a fisheye."""
    word = fields.text(key).lower()
    if word in ("true", "yes", "on", "1", "1.0", "1."):
        return True
    if word in ("false", "no", "off", "0", "0.0", "0.", "none", "null", ""):
        return False
    raise fields.error(key, f"expected 0 or 1, got {word!r}")


def _kind(fields: Fields, key: str) -> list[str]:
    """The lens model that a field names, in a list; empty for a field that names no lens."""
    if is_nothing(fields.values[key]) or isinstance(fields.values[key], list | Mapping):
        return []
    word = re.sub(r"[^a-z0-9]", "", fields.text(key).lower())
    if word in SYNONYMS:
        return [SYNONYMS[word]]
    is_sensor = MAY_NAME_A_SENSOR.fullmatch(key) and not LENS_NAME.fullmatch(word)
    if is_sensor and not word.isdigit():
        return []
    raise unsupported_lens(fields, key, (*PINHOLES, *FISHEYES))


def _size(fields: Fields) -> tuple[int, int] | None:
    plain = {key.replace("_", "").lower(): key for key in fields.values}
    for width, height in SIZES:
        if width in plain and height in plain:
            return fields.size(plain[width], plain[height])
    pair = next((plain[key] for key in SIZE_PAIRS if key in plain), None)
    return None if pair is None else fields.size_pair(pair)
