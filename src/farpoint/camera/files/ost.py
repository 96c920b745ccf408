"""ROS's ``ost.txt`` and ``.ini``, which ``camera_calibrator`` writes beside its YAML file."""

from __future__ import annotations

import re

from farpoint.camera.camera import Camera
from farpoint.camera.files.fields import Fields, blame
from farpoint.camera.files.matrix import intrinsics_from_matrix
from farpoint.camera.files.source import CalibrationFile
from farpoint.camera.files.understood import LENS_WORDS, refuse_others
from farpoint.camera.pinhole import Pinhole

TITLE = "ROS ost.txt"
FIRST_IS_DEFAULT = False

SECTION = re.compile(r"\[([^\]]+)\]")
HEADING = re.compile(r"[A-Za-z][A-Za-z _]*")
IMAGE, MATRIX, DISTORTION = "image", "camera matrix", "distortion"
KNOWN = (MATRIX, DISTORTION, "rectification", "projection")


def matches(file: CalibrationFile) -> bool:
    """Whether a section in brackets has a heading ``camera matrix``."""
    return any(MATRIX in section for section in _sections(file).values())


def names(file: CalibrationFile) -> list[str]:
    """The sections with a camera, such as ``narrow_stereo``."""
    return [name for name, section in _sections(file).items() if MATRIX in section]


def read(file: CalibrationFile, name: str) -> Camera:
    """The camera of the raw images.

    The file does not name the lens of its coefficients. Four coefficients can belong to a fisheye
    or to a pinhole, so a file with four coefficients is refused.
    """
    sections = _sections(file)
    camera = Fields(sections[name], file.path, f"[{name}] ")
    refuse_others(camera, KNOWN, only=LENS_WORDS)
    intrinsics = intrinsics_from_matrix(camera, MATRIX)
    if len(camera.numbers(DISTORTION)) == 4:
        raise camera.error(
            DISTORTION, "four numbers may be of a fisheye or a pinhole; expected 5 or 8"
        )
    with blame(camera, MATRIX, distortion=DISTORTION):
        model = Pinhole(**intrinsics, distortion=tuple(camera.numbers(DISTORTION)))
    image = Fields(sections.get(IMAGE, {}), file.path, f"[{IMAGE}] ")
    return Camera(model=model, size=image.size("width", "height"), name=name)


def _sections(file: CalibrationFile) -> dict[str, dict[str, str]]:
    """For each section, the text below each heading."""
    sections: dict[str, dict[str, list[str]]] = {}
    section = below = None
    for line in file.lines:
        if found := SECTION.fullmatch(line):
            section, below = sections.setdefault(found[1].strip(), {}), None
        elif section is None:
            continue
        elif HEADING.fullmatch(line):
            below = section[line.lower()] = []
        elif below is not None:
            below.append(line)
    return {
        name: {heading: " ".join(lines) for heading, lines in section.items()}
        for name, section in sections.items()
    }
