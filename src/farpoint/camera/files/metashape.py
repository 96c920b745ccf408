"""Metashape's camera calibration (XML), with the formulas from the appendix of the manual."""

from __future__ import annotations

import math

from farpoint.camera.camera import Camera
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import unsupported_lens
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

TITLE = "Metashape calibration"
FIRST_IS_DEFAULT = False

FRAME, FISHEYES, SPHERE = "frame", ("fisheye", "equidistant_fisheye"), "spherical"
COMMON = ("projection", "width", "height", "f", "cx", "cy", "date")
OPTIONAL = ("b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2")


def matches(file: CalibrationFile) -> bool:
    """Whether an XML file gives a ``projection`` and a focal length."""
    fields = file.fields
    return (
        file.text.lstrip()[:1] == "<"
        and "projection" in fields
        and fields.first("f", "fx", "width") is not None
    )


def names(file: CalibrationFile) -> list[str]:
    """The name of the file, for its only camera."""
    return [file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera. Metashape gives the principal point as an offset from the middle of the picture.

    Metashape counts from the corner of the first pixel. In farpoint's convention the middle of the
    picture is ``(width - 1) / 2``.
    """
    fields = file.fields
    kind = fields.text("projection").lower()
    known = (FRAME, *FISHEYES, SPHERE)
    if kind not in known:
        raise unsupported_lens(fields, "projection", known)
    refuse_others(fields, (*COMMON, *OPTIONAL))
    size = fields.size("width", "height")
    if size is None:
        raise fields.error("width", "the field is missing")
    model = _sphere(fields, size) if kind == SPHERE else _lens(fields, kind, size)
    return Camera(model=model, size=size, name=name)


def _optional(fields: Fields, key: str) -> float:
    return fields.number(key) if key in fields else 0.0


def _expect_zero(fields: Fields, keys: tuple[str, ...], lens: str) -> None:
    for key in keys:
        value = _optional(fields, key)
        if value:
            raise fields.error(key, f"is not supported for a {lens}; expected 0, got {value:g}")


def _lens(fields: Fields, kind: str, size: tuple[int, int]) -> CameraModel:
    f = fields.number("f")
    cx = 0.5 * size[0] + _optional(fields, "cx") - 0.5
    cy = 0.5 * size[1] + _optional(fields, "cy") - 0.5
    fx = f + _optional(fields, "b1")
    k1, k2, k3, k4 = (_optional(fields, key) for key in ("k1", "k2", "k3", "k4"))
    with blame(fields, "f"):
        if kind == FRAME:
            _expect_zero(fields, ("b2", "k4"), "frame camera")
            # Metashape's p1 and p2 are OpenCV's p2 and p1.
            p1, p2 = _optional(fields, "p2"), _optional(fields, "p1")
            distortion = (k1, k2, p1, p2, k3)
            return Pinhole(
                **{"fx": fx, "fy": f, "cx": cx, "cy": cy},
                distortion=distortion if any(distortion) else (),
            )
        _expect_zero(fields, ("b2", "p1", "p2"), "fisheye")
        return KannalaBrandt(fx=fx, fy=f, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)


def _sphere(fields: Fields, size: tuple[int, int]) -> CameraModel:
    _expect_zero(fields, ("cx", "cy", *OPTIONAL), "spherical camera")
    width, height = size
    if width != 2 * height:
        raise fields.error("height", f"expected {width / 2:g}, half of the width, got {height}")
    full = width / (2.0 * math.pi)
    if "f" in fields and abs(fields.number("f") - full) > 0.01 * full:
        raise fields.error(
            "f", f"expected {full:.6g} of a whole sphere, got {fields.number('f'):g}"
        )
    return Equirectangular(width=width, height=height)
