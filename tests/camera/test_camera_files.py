"""Calibration files: each format recognised by content, and every fault named."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from lens_checks import round_trip_px

from farpoint.camera import (
    Camera,
    CameraModel,
    DoubleSphere,
    ExtendedUnified,
    KannalaBrandt,
    Pinhole,
    load_camera,
)
from farpoint.errors import InputError

K = "500.5 0 320.25\n0 501.5 240.75\n0 0 1\n"
EXPECTED = {"fx": 500.5, "fy": 501.5, "cx": 320.25, "cy": 240.75}
D4 = {"k1": -0.3, "k2": 0.1, "p1": 0.001, "p2": -0.002}

SENSOR = """\
%YAML:1.0
# General sensor definitions.
sensor_type: camera
T_BS:
  cols: 4
  rows: 1
  data: [1.0, 0.0,
         0.0, 0.0]
rate_hz: 20
resolution: [640, 480]
camera_model: pinhole
intrinsics: [500.5, 501.5, 320.25, 240.75] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.3, 1e-1, 0.001, -2e-3]
"""
CHAIN = """\
cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.3, 0.1, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [500.5, 501.5, 320.25, 240.75]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  camera_model: pinhole
  distortion_coeffs: []
  distortion_model: none
  intrinsics: [400, 401, 300, 200]
  resolution: [640, 480]
"""
OPENCV = """\
%YAML:1.0
---
calibration_time: "Mon 01 Jan 2024 12:00:00"
image_width: 640
image_height: 480
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 5.005e+02, 0., 3.2025e+02, 0., 5.015e+02, 2.4075e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 4
   dt: d
   data: [ -3.0e-01, 1.0e-01, 1.0e-03, -2.0e-03 ]
"""
ROS = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0, 320.25, 0, 501.5, 240.75, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.3, 0.1, 0.001, -0.002, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [450, 0, 320, 0, 0, 450, 240, 0, 0, 0, 1, 0]
"""
ORBSLAM2 = """\
%YAML:1.0
Camera.fx: 500.5
Camera.fy: 501.5
Camera.cx: 320.25
Camera.cy: 240.75
Camera.k1: -0.3
Camera.k2: 0.1
Camera.p1: 0.001
Camera.p2: -0.002
Camera.width: 640
Camera.height: 480
Camera.fps:30.0
"""
ORBSLAM3 = """\
%YAML:1.0
File.version: "1.0"
Camera.type: "PinHole"
Camera1.fx: 500.5
Camera1.fy: 501.5
Camera1.cx: 320.25
Camera1.cy: 240.75
Camera1.k1: -0.3
Camera1.k2: 0.1
Camera1.p1: 0.001
Camera1.p2: -0.002
Camera2.fx: 400
Camera2.fy: 401
Camera2.cx: 300
Camera2.cy: 200
Camera.width: 640
Camera.height: 480
"""
ODOMETRY = """\
P0: 500.5 0 320.25 0 0 501.5 240.75 0 0 0 1 0
P1: 500.5 0 320.25 -386.1 0 501.5 240.75 0 0 0 1 0
P2: 400 0 300 40 0 401 200 2 0 0 1 0.003
Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0
"""
RAW = """\
calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.950000e-02
S_00: 1.392000e+03 5.120000e+02
K_00: 500.5 0 320.25 0 501.5 240.75 0 0 1
D_00: -0.3 0.1 0.001 -0.002 0
R_00: 1 0 0 0 1 0 0 0 1
S_rect_00: 1.242000e+03 3.750000e+02
P_rect_00: 721.5 0 609.5 0 0 721.5 172.8 0 0 0 1 0
S_rect_02: 1.242000e+03 3.750000e+02
P_rect_02: 720.5 0 608.5 44 0 720.5 171.8 0 0 0 1 0
"""
PLAIN = "# fx fy cx cy k1 k2 p1 p2\n500.5 501.5 320.25 240.75 -0.3 0.1 0.001 -0.002\n"


@pytest.mark.parametrize(
    ("text", "name", "parameters", "size"),
    [
        (SENSOR, None, EXPECTED | D4, (640, 480)),
        (CHAIN, "cam0", EXPECTED | D4, (640, 480)),
        (CHAIN, "cam1", {"fx": 400, "fy": 401, "cx": 300, "cy": 200}, (640, 480)),
        (OPENCV, None, EXPECTED | D4, (640, 480)),
        (OPENCV.removeprefix("%YAML:1.0\n---\n"), None, EXPECTED | D4, (640, 480)),
        (ROS, None, EXPECTED | D4 | {"k3": 0}, (640, 480)),
        (ROS, "narrow_stereo", EXPECTED | D4 | {"k3": 0}, (640, 480)),
        (ORBSLAM2, None, EXPECTED | D4, (640, 480)),
        (ORBSLAM3, "Camera1", EXPECTED | D4, (640, 480)),
        (ORBSLAM3, "Camera2", {"fx": 400, "fy": 401, "cx": 300, "cy": 200}, (640, 480)),
        (ODOMETRY, None, EXPECTED, None),
        (ODOMETRY, "P2", {"fx": 400, "fy": 401, "cx": 300, "cy": 200}, None),
        (RAW, None, {"fx": 721.5, "fy": 721.5, "cx": 609.5, "cy": 172.8}, (1242, 375)),
        (RAW, "P_rect_02", {"fx": 720.5, "fy": 720.5, "cx": 608.5, "cy": 171.8}, (1242, 375)),
        (RAW, "K_00", EXPECTED | D4 | {"k3": 0}, (1392, 512)),
        (PLAIN, None, EXPECTED | D4, None),
        (PLAIN.replace(" ", ", "), None, EXPECTED | D4, None),
        ("500.5 501.5 320.25 240.75", None, EXPECTED, None),
        (K, None, EXPECTED, None),
        (K.replace("\n", " "), None, EXPECTED, None),
        (f"\ufeff{SENSOR}".replace("\n", "\r\n"), None, EXPECTED | D4, (640, 480)),
    ],
)
def test_every_format_by_its_content(write, text, name, parameters, size) -> None:
    camera = load_camera(write(text), name)
    assert camera.model.parameters == parameters
    assert camera.size == size
    if name is not None:
        assert camera.name == name


@pytest.mark.parametrize("extension", ["yml", "xml", "json"])
def test_reads_what_opencv_writes(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"stereo.{extension}"
    matrices = np.array([[500.5, 0, 320.25], [0, 501.5, 240.75], [0, 0, 1]]), np.eye(3) * 7 + 1e-9
    matrices[1][:] = [[400, 0, 300], [0, 401, 200], [0, 0, 1]]
    coefficients = np.array([[-0.3, 0.1, 0.001, -0.002, 1e-5]])
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for number, matrix in enumerate(matrices, start=1):
        storage.write(f"M{number}", matrix)
        storage.write(f"D{number}", coefficients * number)
    storage.write("P1", np.eye(3, 4))
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.release()
    first, second = load_camera(path, "M1"), load_camera(path, "M2")
    assert first.model == Pinhole(**EXPECTED, distortion=tuple(coefficients[0]))
    assert second.model == Pinhole(
        fx=400, fy=401, cx=300, cy=200, distortion=tuple(coefficients[0] * 2)
    )
    assert first.size == second.size == (640, 480)


@pytest.mark.parametrize(
    ("matrix", "distortion", "size"),
    [
        ("camera_matrix", "distortion_coefficients", "image_size: [640, 480]"),
        ("cameraMatrix", "distCoeffs", "imageSize: [640, 480]"),
        ("Camera_Matrix", "Distortion_Coefficients", "width: 640\nheight: 480"),
        ("K", "D", "resolution: [640, 480]"),
        ("K_left", "D_left", "image_Width: 640\nimage_Height: 480"),
        ("intrinsic_matrix", "dist_coeffs", "image_width: 640\nimage_height: 480"),
    ],
)
def test_common_names_of_the_camera_matrix(write, matrix: str, distortion: str, size: str) -> None:
    camera = load_camera(
        write(
            f"{matrix}: [[500.5, 0, 320.25], [0, 501.5, 240.75], [0, 0, 1]]\n"
            f"{distortion}: [-0.3, 0.1, 0.001, -0.002]\n{size}\n"
        )
    )
    assert camera.model.parameters == EXPECTED | D4
    assert camera.size == (640, 480)


def test_name_and_source_say_where_it_came_from(write) -> None:
    path = write(SENSOR, "left.yaml")
    camera = load_camera(str(path))
    assert camera.name == "left"
    assert camera.source == f"EuRoC sensor.yaml, {path}"


def test_orbslam_coefficients_left_out_are_zero(write) -> None:
    text = ORBSLAM2.replace("Camera.p1: 0.001\nCamera.p2: -0.002\n", "Camera.k3: 0.5\n")
    model = load_camera(write(text)).model
    assert isinstance(model, Pinhole)
    assert model.distortion == (-0.3, 0.1, 0.0, 0.0, 0.5)
    text = "\n".join(f"Camera.{key}: {value}" for key, value in EXPECTED.items())
    assert load_camera(write(text)).model == Pinhole(**EXPECTED)


FISHEYE = KannalaBrandt(**EXPECTED, k1=-0.3, k2=0.1, k3=0.001, k4=-0.002)


@pytest.mark.parametrize(
    "text",
    [
        SENSOR.replace(": radial-tangential", ": equidistant"),
        ORBSLAM2.replace(".p1", ".k3").replace(".p2", ".k4") + 'Camera.type: "KannalaBrandt8"\n',
        OPENCV + "fisheye_model: 1\n",
        ROS.replace("plumb_bob", "equidistant").replace("-0.002, 0]", "-0.002]"),
    ],
)
def test_fisheyes_by_the_name_of_their_model(write, text: str) -> None:
    camera = load_camera(write(text))
    assert camera.model == FISHEYE
    assert camera.size == (640, 480)


@pytest.mark.parametrize(
    ("kind", "first", "model"),
    [
        ("ds", "-0.2, 0.6", DoubleSphere(**EXPECTED, xi=-0.2, alpha=0.6)),
        ("eucm", "0.6, 1.1", ExtendedUnified(**EXPECTED, alpha=0.6, beta=1.1)),
    ],
)
def test_kalibrs_wide_lenses(write, kind: str, first: str, model: CameraModel) -> None:
    text = CHAIN.replace(": pinhole", f": {kind}", 1).replace(": radtan", ": none", 1)
    text = text.replace("[500.5,", f"[{first}, 500.5,").replace("0.3, 0.1, 0.001, -0.002]", "0.0]")
    assert load_camera(write(text), "cam0").model == model
    with pytest.raises(InputError, match=r"cam0.intrinsics: expected 6 numbers, got 5"):
        load_camera(write(text.replace(first, "0.6")), "cam0")


FAULTS = [
    (
        SENSOR.replace(": radial-tangential", ": equidistant").replace(", -2e-3", ""),
        None,
        "distortion_coefficients",
        "expected 4 numbers, got 3",
    ),
    (OPENCV + "xi: -1.2\n", None, "xi (xi)", "from 0"),
    (SENSOR.replace("intrinsics", "intrinsic"), None, "intrinsics", "missing"),
    (SENSOR.replace("camera_model", "model"), None, "camera_model", "missing"),
    (
        SENSOR.replace("distortion_coefficients", "coefficients"),
        None,
        "distortion_coefficients",
        "missing",
    ),
    (SENSOR.replace("[500.5", "[-500.5"), None, "intrinsics (fx)", "positive number, got -500.5"),
    (SENSOR.replace("[500.5", "[.nan"), None, "intrinsics", "finite number"),
    (SENSOR.replace("[500.5, ", "["), None, "intrinsics", "expected 4 numbers, got 3"),
    (SENSOR.replace("[500.5", "[wide"), None, "intrinsics", "number, got 'wide'"),
    (SENSOR.replace("[-0.3, 1e-1", "[-0.3"), None, "distortion_coefficients (distortion)", "got 3"),
    (SENSOR.replace("[640, 480]", "[640, -480]"), None, "resolution", "got -480"),
    (SENSOR.replace("[640, 480]", "640"), None, "resolution", "expected 2 numbers, got 1"),
    (SENSOR.replace("sensor_type: camera", "sensor_type: imu"), None, "sensor_type", "got imu"),
    (SENSOR.replace(": radial-tangential", ": lattice"), None, "distortion_model", "'lattice'"),
    (SENSOR.replace(": pinhole", ": catadioptric"), None, "camera_model", "'catadioptric'"),
    (SENSOR.replace("[640, 480]", "[640, 480"), None, "line 11", "malformed YAML"),
    (CHAIN, None, "name", "several cameras; expected a name, one of cam0, cam1"),
    (CHAIN, "cam2", "name", "no camera 'cam2'; expected one of cam0, cam1"),
    (
        CHAIN.replace("intrinsics: [400,", "intrinsics: [0,"),
        "cam1",
        "cam1.intrinsics (fx)",
        "positive",
    ),
    (ORBSLAM3, None, "name", "Camera1, Camera2"),
    (ORBSLAM2.replace("Camera.fy: 501.5\n", ""), None, "Camera.fy", "missing"),
    (ORBSLAM2.replace("501.5", "-501.5"), None, "Camera (fy)", "positive"),
    (ORBSLAM2.replace("0.001", "nan"), None, "Camera.p1", "finite"),
    (ORBSLAM2.replace("480", "480.5"), None, "Camera.height", "whole number"),
    (ORBSLAM2.replace("Camera.height: 480\n", ""), None, "Camera.height", "missing"),
    (ORBSLAM3.replace("PinHole", "Periscope"), "Camera1", "Camera.type", "'Periscope'"),
    (
        OPENCV.replace(" 5.005e+02, 0.,", " 5.005e+02,"),
        None,
        "camera_matrix",
        "expected 9 numbers, got 8",
    ),
    (OPENCV.replace("5.005e+02, 0.", "5.005e+02, 2."), None, "camera_matrix", "500.5 2 320.25"),
    (OPENCV.replace("5.005e+02", ".Nan"), None, "camera_matrix", "finite"),
    (OPENCV.replace(" -3.0e-01,", ""), None, "distortion_coefficients (distortion)", "got 3"),
    (OPENCV.replace("image_width: 640", "image_width: 0"), None, "image_width", "got 0"),
    (ROS.replace("plumb_bob", "thin_air"), None, "distortion_model", "'thin_air'"),
    (ODOMETRY.replace("P0: 500.5", "P0: -500.5"), None, "P0 (fx)", "positive"),
    (ODOMETRY.replace("P0: 500.5", "P0:"), None, "P0", "expected 12 numbers, got 11"),
    (ODOMETRY.replace("P0: 500.5", "P0: x"), None, "P0", "number, got 'x'"),
    (ODOMETRY, "P7", "name", "no camera 'P7'; expected one of P0, P1, P2"),
    (RAW.replace("D_00", "E_00"), "K_00", "D_00", "missing"),
    (PLAIN.replace("500.5", "0"), None, "numbers (fx)", "positive"),
    (PLAIN.replace("500.5", "nan"), None, "numbers", "finite"),
    (PLAIN.replace("500.5 ", ""), None, "numbers", "one line fx fy cx cy"),
    (PLAIN + PLAIN, None, "numbers", "got 2 lines, the first of 8"),
    ("cam: [\n  1, 2\n  }", None, "line 3", "malformed YAML"),
    ('{"a": 1,\n "b" 2}', None, "line 2", "malformed JSON"),
    ("<opencv_storage>\n<K>\n</opencv_storage>", None, "line 3", "malformed XML"),
    ("[" * 5000, None, None, "expected"),
    ("Dear diary, today was fine.", None, None, "is not a camera calibration; expected one of"),
    ("greeting: hello\n", None, None, "is not a camera calibration"),
    (b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR\xff\xfe", None, None, "is not a camera calibration"),
    ("", None, None, "the file is empty"),
    (" \n\n", None, None, "the file is empty"),
]


@pytest.mark.parametrize(("text", "name", "field", "words"), FAULTS)
def test_every_fault_names_file_and_field(write, text, name, field, words) -> None:
    path = write(text)
    with pytest.raises(InputError) as caught:
        load_camera(path, name)
    assert caught.value.file == str(path)
    assert caught.value.field == field
    assert words in caught.value.problem
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


def test_paths_that_hold_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file") as caught:
        load_camera(tmp_path / "absent.yaml")
    assert caught.value.file == str(tmp_path / "absent.yaml")
    with pytest.raises(InputError, match="is a folder; expected a calibration"):
        load_camera(tmp_path)


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="needs a user without all rights")
def test_file_without_permission(write) -> None:
    path = write(SENSOR)
    path.chmod(0)
    with pytest.raises(InputError, match="cannot be read: Permission denied"):
        load_camera(path)


def test_video_given_for_a_calibration(tmp_path: Path) -> None:
    path = tmp_path / "drive.mp4"
    with path.open("wb") as file:
        file.truncate((1 << 24) + 1)
    with pytest.raises(InputError, match="too large for a calibration"):
        load_camera(path)


def test_tags_are_never_executed(write) -> None:
    text = SENSOR + 'bomb: !!python/object/apply:os.putenv ["FARPOINT_TEST", "executed"]\n'
    assert load_camera(write(text)).size == (640, 480)
    assert "FARPOINT_TEST" not in os.environ


REAL = [
    ("calibrations/euroc_cam0_sensor.yaml", None, (752, 480)),
    ("calibrations/kalibr_euroc.yaml", "cam0", (752, 480)),
    ("calibrations/kalibr_euroc.yaml", "cam1", (752, 480)),
    ("calibrations/kitti_calib.txt", None, (1226, 370)),
    ("calibrations/opencv_tum1.yaml", None, (640, 480)),
    ("kitti_00/calib.txt", None, (1241, 376)),
    ("kitti_a/calib.txt", None, (1226, 370)),
    ("euroc_v101_micro/calib/cam0_sensor.yaml", None, (752, 480)),
    ("tum_fr1_rpy/calib_TUM1_orbslam2.yaml", None, (640, 480)),
    ("calibrations/kalibr_tumvi.yaml", "cam0", (512, 512)),
    ("calibrations/kalibr_tumvi.yaml", "cam1", (512, 512)),
    ("calibrations/kalibr_uzhfpv.yaml", "cam0", (640, 480)),
    ("calibrations/kalibr_uzhfpv.yaml", "cam1", (640, 480)),
    *(
        (f"calibrations/basalt_{kind}_calib.json", name, size)
        for kind, size in (
            *(("euroc_ds", (752, 480)), ("euroc_eucm", (752, 480))),
            *(("tumvi_512_ds", (512, 512)), ("tumvi_512_eucm", (512, 512))),
        )
        for name in ("cam0", "cam1")
    ),
    *(
        (f"calibrations/gt_calib_{kind}.json", name, (752, 480))
        for kind in ("ds", "eucm", "kb4", "pinhole")
        for name in ("cam0", "cam1")
    ),
    ("calibrations/left_sensor_fisheye.yaml", None, (752, 480)),
    ("calibrations/right_sensor_fisheye.yaml", None, (752, 480)),
    ("davis_slider_depth/calib.txt", None, (240, 180)),
    ("hololens/K.txt", None, (540, 360)),
]


@pytest.mark.parametrize(("path", "name", "size"), REAL)
def test_real_calibrations_round_trip(shared_data: Path, path, name, size) -> None:
    camera = load_camera(shared_data / path, name).with_size(*size)
    error_px, share_seen = round_trip_px(camera)
    assert share_seen == 1.0
    assert error_px < 1e-8


def test_two_files_of_one_camera_agree(shared_data: Path) -> None:
    sensor = load_camera(shared_data / "calibrations/euroc_cam0_sensor.yaml")
    chain = load_camera(shared_data / "calibrations/kalibr_euroc.yaml", "cam0")
    assert sensor.model == chain.model
    assert (
        sensor.model
        == Camera.pinhole(
            *(752, 480, 458.654, 457.296, 367.215, 248.375),
            distortion=(-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05),
        ).model
    )
