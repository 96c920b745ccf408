"""Reader of a camera from a calibration file of any known format."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

from farpoint.camera.camera import Camera
from farpoint.camera.files import (
    autoware,
    basalt,
    boofcv,
    bouguet,
    camodocal,
    colmap,
    column_major,
    depthai,
    dso,
    gyroflow,
    kalibr,
    kalibr_report,
    kitti,
    mc_calib,
    metashape,
    mrcal,
    nerfstudio,
    ocamcalib,
    opencv,
    opensfm,
    orbslam,
    ost,
    own,
    plain,
    realsense,
    sensor,
    stella,
    svo,
    vikit,
    zed,
)
from farpoint.camera.files.format import CalibrationFormat
from farpoint.camera.files.source import CalibrationFile
from farpoint.errors import InputError

__all__ = ["load_camera"]

# Tried in this order: formats with distinctive fields come before more general formats.
FORMATS: tuple[CalibrationFormat, ...] = (
    *(own, kalibr_report),
    *(ocamcalib, dso, plain, colmap, kitti),
    *(ost, zed, mrcal, realsense, depthai, gyroflow, opensfm, metashape),
    *(boofcv, bouguet, mc_calib, autoware, column_major, svo, vikit, stella),
    *(basalt, nerfstudio, camodocal, orbslam, sensor, kalibr, opencv),
)


# Pattern of the name of the left camera of a pair, and replacement for the right camera.
_STEREO = (
    (r"(.*)LEFT(.*)", r"\1RIGHT\2"),
    (r"(.*)left(.*)", r"\1right\2"),
    (r"(.*)Left(.*)", r"\1Right\2"),
    (r"(.*)l", r"\1r"),
    (r"(.*)L", r"\1R"),
    (r"((?:camera_?matrix|mtx|k|m)_?)1", r"\g<1>2"),
)


def load_camera(path: str | os.PathLike[str], name: str | None = None) -> Camera:
    """Read a camera calibration, whose format is recognised by the contents of the file.

    Parameters
    ----------
    path : str or path
        farpoint's ``camera.yaml``, KITTI ``calib.txt`` or ``calib_cam_to_cam.txt``, EuRoC
        ``sensor.yaml``, Kalibr camera chain or ``results-cam.txt``, ORB-SLAM settings, COLMAP
        ``cameras.txt`` or ``cameras.bin``, Basalt, CamOdoCal, DSO, OCamCalib or nerfstudio files, a
        camera matrix in a file of OpenCV's FileStorage, ROS or NumPy (``.npz``), or bare numbers
        ``fx fy cx cy [k1 k2 p1 p2 [k3 ...]]``. Files of the following programs are read, too:
        stella_vslam, SVO, rpg_vikit, RealSense, ZED, DepthAI, Open3D, ARKit, Metashape, OpenSfM,
        Gyroflow, mrcal, MC-Calib, Autoware, BoofCV and Bouguet's toolbox.
    name : str, optional
        Name of one of several cameras. The default is the first rectified camera of a KITTI file
        (``P0`` or ``P_rect_00``), and the left camera of a stereo pair. Other files with several
        cameras need a name.

    Returns
    -------
    Camera
        The camera of the file. ``size`` is None if the file has no image size, and ``uncertainty``
        is None if the file has no sigmas.

    Raises
    ------
    InputError
        If the file cannot be read or is no calibration, or if a field is missing or has an
        impossible value. The message names the file and the field.
    """
    file = CalibrationFile.open(Path(path))
    calibration = _recognise(file)
    chosen = _select(file, calibration, name)
    try:
        camera = calibration.read(file, chosen)
    except InputError as error:
        if error.file is not None:
            raise
        raise InputError(error.problem, file=file.path, field=error.field) from None
    return replace(camera, source=f"{calibration.TITLE}, {file.path}")


def _recognise(file: CalibrationFile) -> CalibrationFormat:
    for calibration in FORMATS:
        if calibration.matches(file):
            return calibration
    if file.fault is not None and (file.is_archive or _seems_structured(file.text)):
        raise file.fault
    known = ", ".join(calibration.TITLE for calibration in FORMATS)
    raise InputError(f"is not a camera calibration; expected one of: {known}", file=file.path)


def _seems_structured(text: str) -> bool:
    """Whether a text looks like YAML, JSON or XML, even if malformed."""
    return re.search(r"\A\s*([{<]|%YAML)|^\s*[\w.]+\s*:\s", text, re.MULTILINE) is not None


def _left_of(names: list[str]) -> str | None:
    """Name of the left camera if the names are those of a stereo pair; otherwise None."""
    if len(names) != 2:
        return None
    for left, right in _STEREO:
        for one, other in (names, names[::-1]):
            if re.fullmatch(left, one, re.I) and re.sub(left, right, one, flags=re.I) == other:
                return one
    return None


def _select(file: CalibrationFile, calibration: CalibrationFormat, name: str | None) -> str:
    names = calibration.names(file)
    if name is None:
        if len(names) == 1 or calibration.FIRST_IS_DEFAULT:
            return names[0]
        if left := _left_of(names):
            return left
        raise InputError(
            f"has several cameras; expected a name, one of {', '.join(names)}",
            file=file.path,
            field="name",
        )
    if name not in names:
        raise InputError(
            f"no camera {name!r}; expected one of {', '.join(names)}", file=file.path, field="name"
        )
    return name
