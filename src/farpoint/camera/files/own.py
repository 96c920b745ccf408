"""farpoint's own ``camera.yaml``: one camera with its uncertainty, without loss of digits."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from farpoint.camera.arctangent import Arctangent
from farpoint.camera.camera import Camera
from farpoint.camera.division import Division
from farpoint.camera.double_sphere import DoubleSphere
from farpoint.camera.equirectangular import Equirectangular
from farpoint.camera.extended_unified import ExtendedUnified
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.lens_model import LensModel
from farpoint.camera.pinhole import Pinhole
from farpoint.camera.scaramuzza import Scaramuzza
from farpoint.camera.unified import Unified
from farpoint.errors import InputError

__all__ = ["write_camera"]

TITLE = "farpoint camera.yaml"
FIRST_IS_DEFAULT = False

VERSION = 1
MODELS: dict[str, type[LensModel]] = {
    model.__name__: model
    for model in (
        *(Arctangent, Division, DoubleSphere, Equirectangular, ExtendedUnified),
        *(KannalaBrandt, Pinhole, Scaramuzza, Unified),
    )
}
TERMS = ("focal", "center_px", "distortion_px")


def write_camera(camera: Camera, path: str | os.PathLike[str]) -> None:
    """Write a camera to a file, from which `load_camera` reads the same camera without rounding.

    The lens, the image size, the name, the uncertainty and the read-out time are kept. The
    attribute `source` is not kept.

    Parameters
    ----------
    camera : Camera
        Camera to write.
    path : str or path
        The file, which is overwritten if it exists.

    Raises
    ------
    InputError
        If the lens model is not one of farpoint's models (field ``camera``).
    OSError
        If the file cannot be written.
    """
    Path(path).write_text("\n".join(_lines(camera)) + "\n", encoding="utf-8")


def matches(file: CalibrationFile) -> bool:
    """Whether farpoint wrote the file."""
    return "farpoint_camera" in file.fields


def names(file: CalibrationFile) -> list[str]:
    """The name of the camera in the file, or else the name of the file."""
    name = file.fields.values.get("name")
    return [name if isinstance(name, str) else file.path.stem]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of this file."""
    fields = file.fields
    if fields.number("farpoint_camera") != VERSION:
        raise fields.error(
            "farpoint_camera", f"expected {VERSION}, got {fields.text('farpoint_camera')}"
        )
    camera = Camera(model=_model(fields), size=fields.size_pair("size"), name=name)
    if "readout_s" in fields:
        sigma = fields.number("readout_sigma_s") if "readout_sigma_s" in fields else None
        with blame(fields, "readout_s", readout_sigma_s="readout_sigma_s"):
            camera = camera.with_readout(fields.number("readout_s"), sigma)
    return _with_uncertainty(camera, fields)


def _lines(camera: Camera) -> list[str]:
    model = camera.model
    if MODELS.get(type(model).__name__) is not type(model):
        raise InputError(f"expected a lens of farpoint, got {type(model).__name__}", field="camera")
    lines = [f"farpoint_camera: {VERSION}", f"name: {_quoted(camera.name)}"]
    lines += [f"model: {type(model).__name__}"]
    if camera.size is not None:
        lines += [f"size: [{camera.size[0]}, {camera.size[1]}]"]
    lines += ["parameters:", *(f"  {name}: {value!r}" for name, value in model.parameters.items())]
    lines += _uncertainty_lines(camera)
    for key in ("readout_s", "readout_sigma_s"):
        if getattr(camera, key) is not None:
            lines += [f"{key}: {getattr(camera, key)!r}"]
    return lines


def _quoted(text: str) -> str:
    """The text between quotation marks on one line; special characters are escaped."""
    import yaml

    return yaml.safe_dump(text, default_style='"', width=math.inf).strip()


def _uncertainty_lines(camera: Camera) -> list[str]:
    given = camera.uncertainty
    if given is None:
        return []
    if given.covariance is None:
        terms = [(name, getattr(given, name)) for name in TERMS]
        known = [f"  {name}: {value!r}" for name, value in terms if value is not None]
        return ["uncertainty:  # 1 sigma", *known]
    covariance = camera.parameter_covariance().tolist()
    named = dict(zip(camera.model.refinable().parameters, covariance, strict=True))
    sigmas = camera.parameter_sigmas()
    return [
        "sigma:  # the roots of the diagonal of the covariance",
        *(f"  {name}: {sigma!r}" for name, sigma in sigmas.items()),
        "covariance:",
        *(f"  {name}: [{', '.join(map(repr, row))}]" for name, row in named.items()),
    ]


def _model(fields: Fields) -> LensModel:
    kind = fields.text("model")
    if kind not in MODELS:
        raise fields.error("model", f"expected one of {', '.join(MODELS)}, got {kind}")
    group = fields.group("parameters")
    parameters = {name: group.number(name) for name in group.values}
    with blame(fields, "parameters"):
        return MODELS[kind].from_parameters(parameters)


def _with_uncertainty(camera: Camera, fields: Fields) -> Camera:
    """The camera with the file's covariance, or else its sigmas, or else its `TERMS`."""
    if "covariance" in fields:
        group = fields.group("covariance")
        expected = list(camera.model.refinable().parameters)
        if list(group.values) not in (expected, list(camera.model.parameters)):
            raise fields.error("covariance", f"expected rows {', '.join(expected)}")
        count = len(group.values)
        rows = [group.numbers(name, (count,)) for name in group.values]
        with blame(fields, "covariance"):
            return camera.with_parameter_covariance(np.array(rows))
    if "sigma" in fields:
        group = fields.group("sigma")
        with blame(fields, "sigma"):
            return camera.with_parameter_sigmas({name: group.number(name) for name in group.values})
    if "uncertainty" in fields:
        group = fields.group("uncertainty")
        unknown = [name for name in group.values if name not in TERMS]
        if unknown:
            raise group.error(unknown[0], f"expected only {', '.join(TERMS)}")
        with blame(fields, "uncertainty"):
            terms: Mapping[str, float] = {name: group.number(name) for name in group.values}
            return camera.with_uncertainty(**terms)
    return camera
