"""Kalibr's ``results-cam.txt``: the lenses of a camera chain, with the sigma of each parameter."""

from __future__ import annotations

import re
from collections.abc import Mapping

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.lens import lens_of_sensor
from farpoint.camera.files.source import CalibrationFile
from farpoint.errors import InputError

TITLE = "Kalibr results-cam.txt"
FIRST_IS_DEFAULT = False

CAMERA = re.compile(r"(?m)^\s*(cam\d+) \(.*\):\s*$")
KIND = re.compile(r"type:\s*<class '[\w.]*?(\w+)CameraGeometry'>")
ARRAY = r"\[([^\]]*)\]"
VALUES = {
    "distortion_coeffs": re.compile(rf"distortion:\s*{ARRAY}\s*\+-\s*{ARRAY}"),
    "intrinsics": re.compile(rf"projection:\s*{ARRAY}\s*\+-\s*{ARRAY}"),
}
KINDS = {
    "Pinhole": ("pinhole", "none"),
    "DistortedPinhole": ("pinhole", "radtan"),
    "EquidistantDistortedPinhole": ("pinhole", "equidistant"),
    "FovDistortedPinhole": ("pinhole", "fov"),
    "Omni": ("omni", "none"),
    "DistortedOmni": ("omni", "radtan"),
    "ExtendedUnified": ("eucm", "none"),
    "DoubleSphere": ("ds", "none"),
}
# Kalibr's order of the intrinsics and of the coefficients, by the names that farpoint has.
INTRINSICS = {
    "pinhole": ("fx", "fy", "cx", "cy"),
    "omni": ("xi", "fx", "fy", "cx", "cy"),
    "eucm": ("alpha", "beta", "fx", "fy", "cx", "cy"),
    "ds": ("xi", "alpha", "fx", "fy", "cx", "cy"),
}
COEFFICIENTS = {
    "none": (),
    "radtan": ("k1", "k2", "p1", "p2"),
    "equidistant": ("k1", "k2", "k3", "k4"),
    "fov": ("omega",),
}


def matches(file: CalibrationFile) -> bool:
    """Whether the text has Kalibr's heading, and a camera below this heading."""
    return "Camera-system parameters:" in file.text and bool(names(file))


def names(file: CalibrationFile) -> list[str]:
    """Names ``cam0``, ``cam1`` and so on."""
    return list(_sections(file.text))


def read(file: CalibrationFile, name: str) -> Camera:
    """One camera of the chain, without an image size, because these files give none."""
    section = _sections(file.text)[name]
    projection, distortion = _lens(section, file, name)
    named = {"camera_model": projection, "distortion_model": distortion}
    values = Fields({**named, **_arrays(section, 1)}, file.path, f"{name}.")
    camera = Camera(model=lens_of_sensor(values, coefficients="distortion_coeffs"), name=name)
    sigmas = Fields(_arrays(section, 2), file.path, f"{name}.sigma of ")
    parameters = {
        "intrinsics": INTRINSICS[projection],
        "distortion_coeffs": COEFFICIENTS[distortion],
    }
    found: dict[str, float] = {}
    for key, expected in parameters.items():
        if expected:
            numbers = sigmas.numbers(key, (len(expected),))
            found |= dict(zip(expected, numbers, strict=True))
    with blame(
        sigmas, "intrinsics", **dict.fromkeys(COEFFICIENTS[distortion], "distortion_coeffs")
    ):
        return camera.with_parameter_sigmas(found)


def _lens(section: str, file: CalibrationFile, name: str) -> tuple[str, str]:
    """Projection and distortion of a camera. The suffix ``Rs`` is a rolling shutter, not a lens."""
    hit = KIND.search(section)
    kind = hit[1] if hit else ""
    lens = KINDS.get(kind.removesuffix("Rs"))
    if lens is None:
        problem = f"the lens model {kind!r} is not supported; expected {' or '.join(KINDS)}"
        raise InputError(problem, file=file.path, field=f"{name}.type")
    return lens


def _sections(text: str) -> dict[str, str]:
    """The text under the heading of each camera."""
    parts = CAMERA.split(text)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def _arrays(section: str, group: int) -> Mapping[str, str]:
    """The arrays in a section, as text: values (group 1) or sigmas (group 2)."""
    hits = {key: pattern.search(section) for key, pattern in VALUES.items()}
    return {key: hit[group] for key, hit in hits.items() if hit}
