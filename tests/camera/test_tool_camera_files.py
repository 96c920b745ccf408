"""Files of SVO, RealSense, Metashape, mrcal and other tools: each known by what is in it."""

from __future__ import annotations

import json

import pytest
import test_camera_files as first_kit
import wide_files_kit as wide_kit
from tool_files_kit import OPEN3D_PARAMETERS, REALSENSE_LISTING, SAMPLES, SVO, npz

from farpoint.camera import Pinhole, load_camera
from farpoint.camera.files.load import FORMATS
from farpoint.camera.files.source import CalibrationFile

# Files of the formats that were there before, by the title of theirs.
OLDER = {
    "KITTI calibration": "P0: 7e2 0 6e2 0 0 7e2 1.8e2 0 0 0 1 0\n",
    "EuRoC sensor.yaml": first_kit.SENSOR,
    "Kalibr camera chain": first_kit.CHAIN,
    "OpenCV camera matrix": first_kit.OPENCV,
    "COLMAP cameras": wide_kit.COLMAP,
    "Basalt calibration": json.dumps(wide_kit.BASALT),
    "OCamCalib results": wide_kit.OCAM,
    "nerfstudio transforms.json": wide_kit.nerf(),
    "DSO camera.txt": wide_kit.DSO,
    "CamOdoCal camera": wide_kit.MEI,
    "ORB-SLAM settings": "Camera.fx: 5\nCamera.fy: 5\nCamera.cx: 3\nCamera.cy: 2\n",
    "bare numbers": "500 500 320 240\n",
}


@pytest.mark.parametrize("sample", SAMPLES)
def test_every_lens_by_its_content(write, sample: str) -> None:
    content, name, title, model, size = SAMPLES[sample]
    camera = load_camera(write(content), name)
    assert type(camera.model) is type(model)
    assert camera.model.parameters == pytest.approx(model.parameters, rel=1e-9, abs=1e-12)
    assert camera.size == size
    assert camera.source is not None
    assert camera.source.startswith(f"{title}, ")


@pytest.mark.parametrize("sample", [*SAMPLES, *OLDER])
def test_no_format_takes_the_file_of_another(write, sample: str) -> None:
    content, title = (
        (SAMPLES[sample][0], SAMPLES[sample][2]) if sample in SAMPLES else (OLDER[sample], sample)
    )
    file = CalibrationFile.open(write(content))
    takers = [calibration.TITLE for calibration in FORMATS if calibration.matches(file)]
    assert takers[0] == title
    assert set(takers) - {title} <= set(OLDER)


@pytest.mark.parametrize("names", [("mtx", "dist"), ("camera_matrix", "dist_coeffs"), ("K", "D")])
def test_names_of_numpy_archives(write, names: tuple[str, str]) -> None:
    matrix, distortion = names
    path = write(
        npz(**{matrix: [[500, 0, 320], [0, 500, 240], [0, 0, 1]], distortion: [-0.3, 0.1, 0, 0]})
    )
    model = load_camera(path).model
    assert model == Pinhole(fx=500, fy=500, cx=320, cy=240, distortion=(-0.3, 0.1, 0, 0))


def test_two_cameras_of_a_trajectory_have_numbers(write) -> None:
    other = json.loads(json.dumps(OPEN3D_PARAMETERS))
    other["intrinsic"]["intrinsic_matrix"][0] = 700.0
    path = write(json.dumps({"parameters": [OPEN3D_PARAMETERS, other]}))
    assert load_camera(path, "0").model.parameters["fx"] == 500.5
    assert load_camera(path, "1").model.parameters["fx"] == 700.0


def test_labels_that_are_given_twice(write) -> None:
    path = write(SVO.replace("label: right", "label: cam0"))
    assert load_camera(path, "cam0").model == SAMPLES["svo"][3]
    assert load_camera(path, "cam1").model == SAMPLES["svo atan"][3]


def test_streams_of_one_size_are_distinguished(write) -> None:
    color = REALSENSE_LISTING[REALSENSE_LISTING.index(' Intrinsic of "Color"') :]
    other = color.replace("YUYV/RGB8/BGR8/RGBA8/BGRA8/Y8", "Y16").replace("500.5", "700")
    path = write(f"{REALSENSE_LISTING}\n{other}\n{other.replace('700', '800')}")
    for name, fx in (
        ("Color 640x480", 500.5),
        ("Color 640x480 Y16", 700),
        ("Color 640x480 4", 800),
    ):
        assert load_camera(path, name).model.parameters["fx"] == fx
