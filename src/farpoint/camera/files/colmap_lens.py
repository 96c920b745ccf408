"""COLMAP's lens models by name: parameters in COLMAP's order, with pixels shifted by 0.5."""

from __future__ import annotations

from collections.abc import Callable

from farpoint.camera.arctangent import Arctangent
from farpoint.camera.division import Division
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.extended_unified import ExtendedUnified
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole

__all__ = ["PARAMETERS", "lens_of_colmap"]

RADTAN8 = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")

# Parameters after the principal point. The models are in the order of their numbers in COLMAP.
_EXTRA: dict[str, tuple[str, ...]] = {
    "SIMPLE_PINHOLE": (),
    "PINHOLE": (),
    "SIMPLE_RADIAL": ("k1",),
    "RADIAL": ("k1", "k2"),
    "OPENCV": RADTAN8[:4],
    "OPENCV_FISHEYE": ("k1", "k2", "k3", "k4"),
    "FULL_OPENCV": RADTAN8,
    "FOV": ("omega",),
    "SIMPLE_RADIAL_FISHEYE": ("k1",),
    "RADIAL_FISHEYE": ("k1", "k2"),
    "THIN_PRISM_FISHEYE": (*RADTAN8[:6], "sx1", "sy1"),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        *("k0", "k1", "k2", "k3", "k4", "k5"),
        *("p0", "p1", "s0", "s1", "s2", "s3"),
    ),
    "SIMPLE_DIVISION": ("k",),
    "DIVISION": ("k",),
    "SIMPLE_FISHEYE": (),
    "FISHEYE": (),
    "EUCM": ("alpha", "beta"),
    "EQUIRECTANGULAR": (),
}
ONE_FOCAL = ("RADIAL", "RADIAL_FISHEYE")


def _names(model: str, extra: tuple[str, ...]) -> tuple[str, ...]:
    if model == "EQUIRECTANGULAR":
        return "width", "height"
    if model.startswith("SIMPLE_") or model in ONE_FOCAL:
        return "f", "cx", "cy", *extra
    return "fx", "fy", "cx", "cy", *extra


PARAMETERS = {model: _names(model, extra) for model, extra in _EXTRA.items()}
"""Names of the parameters of each model, in COLMAP's order."""


def _pinhole(**values: float) -> Pinhole:
    intrinsics = {name: values.pop(name) for name in ("fx", "fy", "cx", "cy")}
    order = RADTAN8[: max(len(values), 4)]
    distortion = tuple(values.get(name, 0.0) for name in order) if values else ()
    return Pinhole(**intrinsics, distortion=distortion)


LENSES: dict[str, Callable[..., CameraModel]] = {
    **dict.fromkeys(
        ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"), _pinhole
    ),
    **dict.fromkeys(
        (
            *("SIMPLE_FISHEYE", "FISHEYE"),
            *("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "OPENCV_FISHEYE"),
        ),
        KannalaBrandt,
    ),
    "FOV": Arctangent,
    "SIMPLE_DIVISION": Division,
    "DIVISION": Division,
    "EUCM": ExtendedUnified,
    "EQUIRECTANGULAR": Equirectangular,
}


def lens_of_colmap(fields: Fields, key: str, model: str) -> CameraModel:
    """The lens of COLMAP's model of this name. COLMAP's pixel centres are at (0.5, 0.5).

    Parameters
    ----------
    fields : Fields
        The fields that are being read.
    key : str
        Key of the parameters, in COLMAP's order.
    model : str
        Name of the model, such as ``"OPENCV"``.
    """
    if model not in LENSES:
        raise fields.error(
            key, f"the lens model {model!r} is not supported; expected {' or '.join(LENSES)}"
        )
    names = PARAMETERS[model]
    values = dict(zip(names, fields.numbers(key, (len(names),)), strict=True))
    if "f" in values:
        values["fx"] = values["fy"] = values.pop("f")
    for name in ("cx", "cy"):
        if name in values:
            values[name] -= 0.5
    with blame(fields, key):
        return LENSES[model](**values)
