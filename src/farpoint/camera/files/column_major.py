"""Camera matrices written column by column: Open3D's, ARKit's and Record3D's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.matrix import Intrinsics, intrinsics_from_matrix
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import LENS_WORDS, refuse_others
from farpoint.camera.pinhole import Pinhole

TITLE = "Open3D or ARKit intrinsics"
FIRST_IS_DEFAULT = False

OPEN3D = "intrinsic_matrix"
# The first is Record3D's.
ARKIT = ("K", "intrinsics", "cameraIntrinsics", "camera_intrinsics", "intrinsicMatrix")
SIZES = (("width", "height"), ("w", "h"), ("imageWidth", "imageHeight"))
SIZE_PAIRS = (
    *("imageResolution", "image_resolution", "cameraResolution", "resolution"),
    *("intrinsicMatrixReferenceDimensions", "imageSize"),
)
# Record3D's fields that are not read: intrinsics of each frame, and the kind of camera.
OTHER = ("perFrameIntrinsicCoeffs", "cameraType")


@dataclass(frozen=True)
class _Place:
    """The group that holds a matrix, and its key."""

    fields: Fields
    key: str


def matches(file: CalibrationFile) -> bool:
    """Whether a matrix is stored by columns, with the principal point in the last of three rows."""
    return bool(_places(file))


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, or the numbers of a trajectory's cameras if the cameras differ."""
    return list(_places(file))


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera. ARKit counts from the corner of the first pixel, and Open3D from the centre."""
    place = _places(file)[name]
    fields, key = place.fields, place.key
    refuse_others(fields, (key, *OTHER), only=LENS_WORDS)
    columns = fields.numbers(key, (9,))
    rows = [columns[start::3] for start in range(3)]
    intrinsics = intrinsics_from_matrix(Fields({key: rows}, fields.file, fields.within), key)
    if key != OPEN3D:
        intrinsics = Intrinsics(
            fx=intrinsics["fx"],
            fy=intrinsics["fy"],
            cx=intrinsics["cx"] - 0.5,
            cy=intrinsics["cy"] - 0.5,
        )
    with blame(fields, key):
        return Camera(model=Pinhole(**intrinsics), size=_size(fields), name=name)


def _places(file: CalibrationFile) -> dict[str, _Place]:
    fields = file.fields
    groups = [fields]
    if isinstance(fields.values.get("intrinsic"), Mapping):
        groups.append(fields.group("intrinsic"))
    found = [place for group in groups if (place := _place(group)) is not None]
    if found:
        return {file.path.stem: found[0]}
    return _trajectory(fields, file.path.stem)


def _trajectory(fields: Fields, stem: str) -> dict[str, _Place]:
    """The cameras of Open3D's ``PinholeCameraTrajectory``, or one camera if all are equal."""
    items = fields.values.get("parameters")
    places = {}
    for index, item in enumerate(items if isinstance(items, list) else []):
        if isinstance(item, Mapping) and isinstance(item.get("intrinsic"), Mapping):
            group = Fields(item["intrinsic"], fields.file, f"parameters[{index}].intrinsic.")
            if (place := _place(group)) is not None:
                places[str(index)] = place
    if len({repr(place.fields.values) for place in places.values()}) == 1:
        return {stem: next(iter(places.values()))}
    return places


def _place(fields: Fields) -> _Place | None:
    for key in (OPEN3D, *ARKIT):
        if _is_column_major(fields.values.get(key)):
            return _Place(fields, key)
    return None


def _is_column_major(value: object) -> bool:
    if not isinstance(value, list):
        return False
    flat = [item for part in value for item in (part if isinstance(part, list) else [part])]
    try:
        numbers = [float(item) for item in flat]
    except (TypeError, ValueError):
        return False
    return (
        len(numbers) == 9
        and numbers[2] == numbers[5] == 0.0
        and numbers[8] == 1.0
        and (numbers[6] != 0.0 or numbers[7] != 0.0)
    )


def _size(fields: Fields) -> tuple[int, int] | None:
    for width, height in SIZES:
        if width in fields and height in fields:
            return fields.size(width, height)
    key = fields.first(*SIZE_PAIRS)
    if key is None:
        return None
    if isinstance(fields.values[key], Mapping):
        return fields.group(key).size("width", "height")
    return fields.size_pair(key)
