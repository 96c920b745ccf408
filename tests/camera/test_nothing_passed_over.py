"""Whatever a calibration says of its lens is read, or refused by name; never passed over."""

from __future__ import annotations

import json
import random
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from tool_files_kit import DEPTHAI, OPEN3D_TRAJECTORY, SAMPLES

from farpoint.camera import KannalaBrandt, Pinhole, describe, load_camera
from farpoint.errors import InputError
from fuzz import fuzz_count, mutant

MATRIX = [[800.0, 0.0, 640.0], [0.0, 801.0, 360.0], [0.0, 0.0, 1.0]]
DIST = [-0.3, 0.1, 0.001, 0.002, 0.05]
NAMED = dict(zip(("k1", "k2", "p1", "p2", "k3"), DIST, strict=True))
PINHOLE = Pinhole(fx=800.0, fy=801.0, cx=640.0, cy=360.0, distortion=tuple(DIST))
FISHEYE = KannalaBrandt(fx=800.0, fy=801.0, cx=640.0, cy=360.0, k1=-0.3, k2=0.1, k3=0.001, k4=0.002)


@pytest.fixture
def load(tmp_path: Path):
    def load(content: object, name: str | None = None):
        path = tmp_path / "calibration.json"
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return load_camera(path, name)

    return load


@pytest.mark.parametrize(
    "content",
    [
        {"camera_matrix": MATRIX, "distortion_vector": DIST, "distortion_type": 0},
        {"camera_matrix": MATRIX, "distortion_params": [DIST]},
        {"camera_matrix": MATRIX, "distortion_coefficient": DIST},
        {"cameraMatrix": MATRIX, "distCoeff": [[value] for value in DIST]},
        {"camera_matrix": MATRIX, "distortion": NAMED},
        {"camera_matrix": MATRIX, "dist": {"data": DIST, "rows": 1, "cols": 5}},
        {"K": MATRIX, **NAMED},
        {"K": MATRIX, "kc": DIST},
        {"K": MATRIX, "D": DIST, "distortion_model": "Plumb Bob", "binning_x": 1, "binning_y": 0},
        {"camera_matrix_left": MATRIX, "dist_coeffs_0": DIST},
        {"mtx": MATRIX, "dist": DIST, "camera_model": "IMX219"},
        {"camera matrix": MATRIX, "distortion-coefficients": DIST},
        {"leftCameraMatrix": MATRIX, "leftDistCoeffs": DIST},
        {"front": {"K": MATRIX, "dist": DIST}, "date": "2026-11-28"},
        {"mtx": MATRIX, "dist": DIST, "roi": {"x_offset": 0, "height": 0, "do_rectify": False}},
    ],
)
def test_spellings_of_a_distortion(load, content: dict):
    assert load(content).model == PINHOLE


CAMERA_INFO = """\
header: {{stamp: {{sec: 1, nanosec: 5}}, frame_id: left}}
height: 720
width: 1280
distortion_model: plumb_bob
d: [-0.3, 0.1, 0.001, 0.002, 0.05]
k: [800.0, 0.0, 640.0, 0.0, 801.0, 360.0, 0.0, 0.0, 1.0]
r: [0.999, 0.04, 0.0, -0.04, 0.999, 0.0, 0.0, 0.0, 1.0]
p: [700.0, 0.0, 655.0, -84.0, 0.0, 700.0, 365.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: {binning}
binning_y: {binning}
roi: {{x_offset: {x}, y_offset: 0, height: {height}, width: {width}, do_rectify: {rectify}}}
---
"""
WHOLE = {"binning": 0, "x": 0, "height": 0, "width": 0, "rectify": "false"}


@pytest.mark.parametrize("changes", [{}, {"binning": 1}, {"height": 720, "width": 1280}])
def test_the_lens_of_a_camera_info_is_that_of_the_raw_images(load, changes: dict):
    """Its K and D, whatever the rectified ones' rotation R and matrix P are."""
    camera = load(CAMERA_INFO.format(**{**WHOLE, **changes}))
    assert camera.model == PINHOLE
    assert camera.size == (1280, 720)


@pytest.mark.parametrize(
    ("changes", "centre", "size"),
    [
        ({"height": 720, "width": 1280, "rectify": "true"}, (640.0, 360.0), (1280, 720)),
        ({"binning": 2}, (320.0, 180.0), (640, 360)),
        ({"x": 100, "height": 360, "width": 640}, (540.0, 360.0), (640, 360)),
        ({"x": 100, "height": 360, "width": 640, "binning": 4}, (135.0, 90.0), (160, 90)),
    ],
)
def test_a_camera_info_of_a_part_of_the_sensor_is_that_of_the_images(
    load, changes: dict, centre: tuple[float, float], size: tuple[int, int]
):
    camera = load(CAMERA_INFO.format(**{**WHOLE, **changes}))
    by = max(changes.get("binning", 0), 1)
    assert (camera.model.fx, camera.model.fy) == (800.0 / by, 801.0 / by)
    assert (camera.model.cx, camera.model.cy) == centre
    assert camera.size == size
    assert camera.model.distortion == PINHOLE.distortion


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"binning": -2}, "binning_x"),
        ({"binning": 1.5}, "binning_x"),
        ({"x": 100}, "roi"),
        ({"x": 100, "height": 720, "width": 1280}, "roi"),
        ({"height": 5, "width": -5}, "roi"),
    ],
)
def test_a_part_that_makes_no_sense_is_refused(load, changes: dict, field: str):
    with pytest.raises(InputError, match=rf"{field}\b"):
        load(CAMERA_INFO.format(**{**WHOLE, **changes}))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("distortion_curve", [1.0, 2.0]),
        ("distortion_model_parameters", {"a": 1}),
        ("k7", 0.2),
        ("xi_left", None),
        ("skewness", 0.3),
        ("fisheye_polynomial", [1, 2]),
        ("lens_model", "scaramuzza"),
        ("model", "double_sphere"),
        ("camera_model", "omni"),
        ("binning_x", 2),
        ("roi", {"x_offset": 100, "y_offset": 0}),
        ("rotation", 90),
        ("setup", "telecentric"),
        ("is_fisheye", "perhaps"),
        ("image_rotation", 180),
        ("flip_horizontal", True),
        ("mirrored", "yes"),
        ("crop", [100, 100, 800, 600]),
        ("downsample_factor", 2),
        ("resize", 0.5),
        ("scale", 0.5),
        ("digital_zoom", 2),
        ("pixel_aspect_ratio", 1.33),
        ("squeeze", 1.33),
        ("water_refraction", 1.33),
        ("lens_profile", {"a": 0.01, "b": -0.02}),
        ("lambda", -0.2),
        ("a", 0.01),
        ("t1", 0.001),
        ("d0", -0.3),
        ("poly", [1, 2, 3]),
        ("radial", [-0.3, 0.1]),
        ("omnidir", True),
        ("model", 1),
        ("order", "k1, k2, k3, p1, p2"),
        ("optics", "a fisheye of 190 degrees"),
        ("calibrated_with", ["ocamcalib", "Scaramuzza"]),
        ("coeffs2", [0.1]),
    ],
)
def test_what_is_not_understood_is_named(load, key: str, value: object):
    content = {"camera_matrix": MATRIX, "dist_coeffs": DIST, key: value}
    if value is None:
        assert load(content).model == PINHOLE
        return
    with pytest.raises(InputError, match=key):
        load(content)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("avg_reprojection_error", 0.21),
        ("calibration_time", "Fri Nov 27 2026"),
        ("flags", 4),
        ("square_size", 0.025),
        ("board_width", 9),
        ("per_view_reprojection_errors", [0.1, 0.2]),
        ("R", MATRIX),
        ("P", [[800.0, 0, 640.0, 0], [0, 801.0, 360.0, 0], [0, 0, 1, 0]]),
        ("T_cam_imu", MATRIX),
        ("distance_to_board", 1.5),
        ("dist_coeffs_sigma", [0.1] * 5),
        ("fisheye", False),
        ("fisheye_model", 0),
        ("scale", 1.0),
        ("zoom", "1"),
        ("flip", False),
        ("fix_aspect_ratio", 1),
        ("camera_name", "beside the fisheye"),
        ("frame_id", "fisheye_front"),
        ("lens", "Sigma 24 mm"),
        ("t", 12.5),
    ],
)
def test_what_is_no_property_of_the_lens_is_left_alone(load, key: str, value: object):
    assert load({"camera_matrix": MATRIX, "dist_coeffs": DIST, key: value}).model == PINHOLE


@pytest.mark.parametrize(
    "flag",
    [
        {"fisheye_model": 1},
        {"is_fisheye": True},
        {"fisheye": "yes"},
        {"model": "fisheye"},
        {"camera_model": "opencv_fisheye"},
        {"lens_model": "Kannala-Brandt"},
        {"distortion_type": "equidistant"},
        {"projection": "fisheye"},
        {"lens": "fisheye"},
        {"model_type": "OPENCV_FISHEYE"},
        {"calibration_method": "cv2.fisheye.calibrate"},
        {"flags": ["CALIB_FISHEYE_RECOMPUTE_EXTRINSIC", "CALIB_FIX_SKEW"]},
    ],
)
def test_flags_that_make_a_fisheye(load, flag: dict):
    assert load({"K": MATRIX, "D": DIST[:4], **flag}).model == FISHEYE


def test_a_fisheye_by_the_name_of_its_coefficients(load):
    assert load({"K_LEFT": MATRIX, "D_LEFT_FE": DIST[:4]}).model == FISHEYE


def test_the_left_camera_of_a_pair_is_meant_and_each_can_be_named(load):
    other = [[700.0, 0.0, 640.0], [0.0, 701.0, 360.0], [0.0, 0.0, 1.0]]
    for left, right in (("K1", "K2"), ("K_left", "K_right"), ("M_l", "M_r")):
        d = (left.replace(left[0], "D", 1), right.replace(right[0], "D", 1))
        content = {right: other, d[1]: [0.0] * 5, left: MATRIX, d[0]: DIST}
        assert load(content).model == PINHOLE
        assert load(content, left).model == PINHOLE
        assert load(content, right).model.parameters["fx"] == 700.0
    groups = {"right": {"K": other}, "left": {"K": MATRIX, "dist": DIST}}
    assert load(groups).model == PINHOLE
    assert load(groups, "right").model.parameters["fx"] == 700.0
    flat = {"mtxL": MATRIX, "distL": DIST, "mtxR": other, "distR": DIST}
    assert load(flat).model == PINHOLE
    for content in ({"K3": MATRIX, "K5": other}, {"front": {"K": MATRIX}, "rear": {"K": other}}):
        with pytest.raises(InputError, match="has several cameras"):
            load(content)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ({"left": {"K": MATRIX}, "distortion": DIST}, "distortion: looks like"),
        ({"left": {"K": MATRIX, "crop": [0, 0, 9, 9]}}, r"left\.crop: looks like"),
        ({"K": [[0.6, 0, 0.5], [0, 1.1, 0.5], [0, 0, 1]]}, "K: is in shares of the image"),
        ({"K": MATRIX, "D": [{"name": "k1", "value": -0.3}]}, "D: expected numbers"),
        ({"K": [800, 0, 0, 0, 801, 0, 640, 360, 1], "D": DIST}, "D: is not understood"),
    ],
)
def test_distortions_in_places_where_none_is_looked_for(load, content: dict, problem: str):
    with pytest.raises(InputError, match=problem):
        load(content)


@pytest.mark.parametrize(
    "text",
    [
        "K: [800, 0, 640, 0, 801, 360, 0, 0, 1]\nD: [-0.3, 0.1, 0, 0]\nD: [0, 0, 0, 0]\n",
        '{"K": [[800, 0, 640], [0, 801, 360], [0, 0, 1]], "D": [-0.3, 0, 0, 0], "D": [0, 0, 0, 0]}',
        "<opencv_storage><K>800 0 640 0 801 360 0 0 1</K><D>0 0 0 0</D><D>1 0 0 0</D>"
        "</opencv_storage>",
    ],
    ids=["YAML", "JSON", "XML"],
)
def test_a_key_that_stands_twice(load, text: str):
    with pytest.raises(InputError, match="has D twice, with different values"):
        load(text)


@pytest.mark.parametrize("extra", ["camera_model: radical\n", "skew: 0.1\n", "k9: 3\n"])
def test_other_formats_pass_nothing_over(tmp_path: Path, extra: str):
    path = tmp_path / "sensor.yaml"
    text = (
        "sensor_type: camera\nresolution: [640, 480]\nintrinsics: [500, 500, 320, 240]\n"
        "distortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n"
    )
    if "camera_model" not in extra:
        text += "camera_model: pinhole\n"
        path.write_text(text)
        load_camera(path)
    path.write_text(text + extra)
    with pytest.raises(InputError, match=extra.split(":")[0]):
        load_camera(path)


def test_a_second_yaml_document(tmp_path: Path):
    path = tmp_path / "info.yaml"
    text = f"camera_matrix: {MATRIX}\ndist_coeffs: {DIST}\n"
    path.write_text(text + "---\n")
    assert load_camera(path).model == PINHOLE
    path.write_text(f"{text}---\n{text}---\n")
    assert load_camera(path).model == PINHOLE
    path.write_text(f"{text}---\n{text.replace('800', '700')}")
    with pytest.raises(InputError, match="several YAML documents"):
        load_camera(path)


@pytest.mark.parametrize("value", ["1e300", "-1e300", "9" * 400, "1e-300", "nan", "1e13"])
@pytest.mark.parametrize("key", range(5))
def test_numbers_that_no_lens_has(tmp_path: Path, value: str, key: int):
    numbers = ["800", "801", "640", "360", "0.1", "0", "0", "0"]
    numbers[key] = value
    path = tmp_path / "camera.txt"
    path.write_text(" ".join(numbers))
    if value == "1e-300" and key > 1:
        describe(load_camera(path))
        return
    with pytest.raises(InputError, match=r"camera\.txt"):
        load_camera(path)


def test_a_large_file_of_keys_is_refused_at_once(tmp_path: Path):
    path = tmp_path / "keys.yaml"
    path.write_text("".join(f"key{k}: 1\n" for k in range(1_000_000)))
    start = time.process_time()
    with pytest.raises(InputError, match="too large for a calibration"):
        load_camera(path)
    assert time.process_time() - start < 5.0


@pytest.mark.skipif(sys.platform == "win32", reason="needs FIFOs and devices")
@pytest.mark.parametrize("kind", ["fifo", "device", "link", "endless"])
def test_only_regular_files_are_opened(tmp_path: Path, kind: str):
    path = tmp_path / "camera.yaml"
    if kind == "fifo":
        subprocess.run(["mkfifo", path], check=True)
    else:
        path.symlink_to("/dev/zero" if kind != "link" else tmp_path / "fifo")
        if kind == "link":
            subprocess.run(["mkfifo", tmp_path / "fifo"], check=True)
    with pytest.raises(InputError, match="is no regular file; expected a calibration"):
        load_camera(path)


ODD = (
    "1e300",
    "-1e308",
    "1e400",
    "nan",
    "inf",
    "0",
    "-1",
    "9" * 400,
    "[]",
    "{}",
    "null",
    '"x"',
    "",
)


USUAL = (
    json.dumps({"camera_matrix": MATRIX, "dist_coeffs": DIST, "image_size": [1280, 720]}),
    "cam0:\n  camera_model: omni\n  intrinsics: [1.2, 800, 801, 640, 360]\n"
    "  distortion_model: radtan\n  distortion_coeffs: [-0.1, 0.1, 0, 0]\n"
    "  resolution: [1280, 720]\n",
    "Camera.type: KannalaBrandt8\nCamera.fx: 190\nCamera.fy: 190\nCamera.cx: 254\n"
    "Camera.cy: 256\nCamera.k1: 3e-3\nCamera.k2: 7e-4\nCamera.k3: -2e-3\nCamera.k4: 2e-4\n",
    "Pinhole 500 501 320 240 0\n640 480\nnone\n640 480\n",
    "500 501 320 240 -0.2 0.1 0 0\n",
)
OF_TOOLS = tuple(SAMPLES.values())


@pytest.mark.parametrize("kind", ["usual", "tools"])
def test_mutants_are_read_or_refused_in_one_line(tmp_path: Path, kind: str):
    """Files of every kind with odd numbers, cuts, lines out of place and bytes of noise."""
    rng = random.Random(0)
    path = tmp_path / "mutant"
    for _ in range(fuzz_count(300)):
        if kind == "usual":
            content, name = rng.choice(USUAL), None
        else:
            content, name = rng.choice(OF_TOOLS)[:2]
        if isinstance(content, bytes):
            noise = bytearray(content)
            noise[rng.randrange(len(noise))] = rng.randrange(256)
            data = bytes(noise)
        else:
            data = mutant(content, rng, ODD)
        path.write_bytes(data or b" ")
        said = _outcome(path, name)
        assert said.isprintable(), data
        assert said == "read" or "mutant" in said, data


@pytest.mark.parametrize("content", [OPEN3D_TRAJECTORY, DEPTHAI])
def test_a_huge_whole_number_is_no_traceback(tmp_path: Path, content: dict):
    path = tmp_path / "mutant"
    text = json.dumps(content)
    for number in set(re.findall(r"[ \[](\d+\.?\d*)", text)):
        path.write_text(re.sub(rf"(?<=[ \[]){re.escape(number)}(?=[,\]])", "9" * 400, text))
        assert _outcome(path, None).isprintable()


def _outcome(path: Path, name: str | None) -> str:
    try:
        camera = load_camera(path, name)
        describe(camera)
    except InputError as error:
        return str(error)
    camera.unproject(np.array([[0.0, 0.0], [1e4, -1e4]]))
    return "read"
