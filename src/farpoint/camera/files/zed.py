"""ZED's ``SN....conf``: a section for each camera and resolution."""

from __future__ import annotations

import configparser
import re

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import named_distortion, refuse_others
from farpoint.camera.kannala_brandt import KannalaBrandt
from farpoint.camera.model import CameraModel
from farpoint.camera.pinhole import Pinhole
from farpoint.errors import InputError

TITLE = "ZED configuration"
FIRST_IS_DEFAULT = False

SECTION = re.compile(r"(?m)^[ \t]*\[((?:(?:LEFT|RIGHT)_)?)CAM_(\w+)\][ \t\r]*$")
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
FOCAL = ("fx", "fy", "cx", "cy")
SIZES = {
    "2K": (2208, 1242),
    "FHD": (1920, 1080),
    "HD": (1280, 720),
    "VGA": (672, 376),
    "FHD1200": (1920, 1200),
    "SVGA": (960, 600),
    "4K": (3840, 2160),
    "QHDPLUS": (3200, 1800),
}


def matches(file: CalibrationFile) -> bool:
    """Whether there is a section such as ``[LEFT_CAM_HD]``."""
    return SECTION.search(file.text) is not None


def names(file: CalibrationFile) -> list[str]:
    """The sections of cameras, such as ``LEFT_CAM_HD``."""
    return list(dict.fromkeys(f"{side}CAM_{size}" for side, size in SECTION.findall(file.text)))


def read(file: CalibrationFile, name: str) -> Camera:
    """One camera at one resolution, not rectified.

    The coefficients are in the section of the camera, or in the section ``DISTO`` of the camera's
    side.
    """
    sections = _sections(file)
    camera = Fields(sections[name], file.path, f"[{name}] ")
    side, _, size = name.rpartition("CAM_")
    shared = f"{side}DISTO"
    refuse_others(camera, (*FOCAL, *COEFFICIENTS))
    distortion = camera
    if shared in sections:
        distortion = Fields(sections[shared], file.path, f"[{shared}] ")
        refuse_others(distortion, COEFFICIENTS)
    model = _lens(camera, distortion)
    return Camera(model=model, size=SIZES.get(size.upper()), name=name)


def _sections(file: CalibrationFile) -> dict[str, dict[str, str]]:
    parser = configparser.ConfigParser(interpolation=None, default_section="")
    try:
        parser.read_string(file.text, source=file.path.name)
    except configparser.Error as error:
        problem = " ".join(str(error).split())
        raise InputError(f"malformed sections: {problem}", file=file.path) from None
    return {section: dict(parser[section]) for section in parser.sections()}


def _lens(camera: Fields, distortion: Fields) -> CameraModel:
    fx, fy, cx, cy = (camera.number(key) for key in FOCAL)
    coefficients = named_distortion(distortion)
    with blame(camera, "fx", **{key: key for key in FOCAL}):
        if len(coefficients) == 8:
            k1, k2, p1, p2, k3, k4, k5, k6 = coefficients
            # Stereolabs' calibration tool writes k1 to k4 of a fisheye, and zeros for the others.
            if k4 and not any((p1, p2, k5, k6)):
                return KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, k1=k1, k2=k2, k3=k3, k4=k4)
        return Pinhole(fx=fx, fy=fy, cx=cx, cy=cy, distortion=coefficients)
