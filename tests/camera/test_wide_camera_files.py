"""Files of COLMAP, Basalt, OCamCalib, nerfstudio, DSO, CamOdoCal, and wide lenses in the others."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest
from wide_files_kit import (
    BASALT,
    CAMODOCAL_FISHEYE,
    COLMAP,
    D4,
    DSO,
    EXPECTED,
    MEI,
    NERF,
    OCAM,
    OMNIDIR,
    kalibr,
    nerf,
)

from farpoint.camera import (
    Arctangent,
    CameraModel,
    Division,
    DoubleSphere,
    Equirectangular,
    ExtendedUnified,
    KannalaBrandt,
    Pinhole,
    Scaramuzza,
    Unified,
    load_camera,
)
from farpoint.errors import InputError

FISHEYE = KannalaBrandt(**EXPECTED, k1=-0.3, k2=0.1, k3=0.001, k4=-0.002)

MODELS: list[tuple[str, str | None, CameraModel]] = [
    (kalibr("omni", "1.25, ", "none", "[]"), None, Unified(**EXPECTED, xi=1.25)),
    (
        kalibr("omni", "1.25, ", "radtan", str(list(D4))),
        None,
        Unified(**EXPECTED, xi=1.25, distortion=D4),
    ),
    (kalibr("pinhole", "", "fov", "[0.93]"), None, Arctangent(**EXPECTED, omega=0.93)),
    (OMNIDIR, None, Unified(**EXPECTED, xi=1.25, distortion=D4, skew=0.4)),
    (
        OMNIDIR.replace("xi: 1.25", "xi: !!opencv-matrix {rows: 1, cols: 1, dt: d, data: [1.25]}"),
        None,
        Unified(**EXPECTED, xi=1.25, distortion=D4, skew=0.4),
    ),
    (COLMAP, "1", Pinhole(**EXPECTED, distortion=D4)),
    (
        COLMAP,
        "7",
        Pinhole(fx=700, fy=700, cx=399.5, cy=299.5, distortion=(-0.05, 0.0, 0.0, 0.0)),
    ),
    (json.dumps(BASALT), "cam0", DoubleSphere(**EXPECTED, xi=-0.2, alpha=0.6)),
    (json.dumps(BASALT), "cam1", KannalaBrandt(**EXPECTED)),
    (
        OCAM,
        None,
        Scaramuzza(
            coefficients=(-206.5, 0.0, 2.2e-3, -4.9e-6, 1.87e-8),
            **{"cx": 318.25, "cy": 241.75, "c": 1.002, "d": 0.003, "e": -0.002},
        ),
    ),
    (nerf(), None, Pinhole(**EXPECTED, distortion=(*D4, 0.0))),
    (nerf(k1=None, k2=None, p1=None, p2=None, camera_model=None), None, Pinhole(**EXPECTED)),
    (
        nerf(camera_model="OPENCV_FISHEYE", k3=0.001, k4=-0.002, p1=None, p2=None),
        None,
        FISHEYE,
    ),
    (nerf(camera_model="EQUIRECTANGULAR"), None, Equirectangular(width=640, height=480)),
    (
        json.dumps({"camera_angle_x": np.pi / 2, "w": 640, "h": 480, "frames": []}),
        None,
        Pinhole(fx=320, fy=320, cx=319.5, cy=239.5),
    ),
    (DSO, None, Arctangent(fx=320, fy=300, cx=159.5, cy=359.5, omega=0.93)),
    ("FOV 500.5 501.5 320.25 240.75 0\n640 480\nnone\n", None, Pinhole(**EXPECTED)),
    ("Pinhole 500.5 501.5 320.25 240.75 0\n640 480\n", None, Pinhole(**EXPECTED)),
    (
        "RadTan 500.5 501.5 320.25 240.75 -0.3 0.1 0.001 -0.002\n640 480\nfull\n512 512\n",
        None,
        Pinhole(**EXPECTED, distortion=D4),
    ),
    (
        "EquiDistant 500.5 501.5 320.25 240.75 -0.3 0.1 0.001 -0.002\n640 480\n",
        None,
        FISHEYE,
    ),
    (MEI, "image_02", Unified(**EXPECTED, xi=1.25, distortion=D4)),
    (CAMODOCAL_FISHEYE, None, FISHEYE),
    (
        MEI.replace("MEI", "PINHOLE").replace("gamma1", "fx").replace("gamma2", "fy")
        .replace("u0", "cx").replace("v0", "cy"),
        None,
        Pinhole(**EXPECTED, distortion=D4),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("text", "name", "model"), MODELS)
def test_every_lens_by_its_content(write, text: str, name: str | None, model: CameraModel) -> None:
    camera = load_camera(write(text), name)
    assert type(camera.model) is type(model)
    assert camera.model.parameters == pytest.approx(model.parameters, rel=1e-12, abs=0)
    assert camera.size == {"cam1": (512, 512), "7": (800, 600)}.get(name or "", (640, 480))


def test_reads_the_omnidir_file_that_opencv_writes(tmp_path: Path) -> None:
    path = tmp_path / "omni.xml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", np.array([[500.5, 0.4, 320.25], [0, 501.5, 240.75], [0, 0, 1]]))
    storage.write("distortion_coefficients", np.array([D4]))
    storage.write("xi", np.array([[1.25]]))
    storage.release()
    assert load_camera(path).model == Unified(**EXPECTED, xi=1.25, distortion=D4, skew=0.4)


COLMAP_LENSES = {
    "SIMPLE_PINHOLE": [500.5, 320.75, 241.25],
    "PINHOLE": [500.5, 501.5, 320.75, 241.25],
    "SIMPLE_RADIAL": [500.5, 320.75, 241.25, -0.05],
    "RADIAL": [500.5, 320.75, 241.25, -0.05, 0.01],
    "OPENCV": [500.5, 501.5, 320.75, 241.25, -0.05, 0.01, 1e-3, -2e-3],
    "FULL_OPENCV": [
        *(500.5, 501.5, 320.75, 241.25),
        *(0.9, 0.2, 1e-3, -5e-4, 0.02, 1.2, 0.4, 0.05),
    ],
    "SIMPLE_FISHEYE": [500.5, 320.75, 241.25],
    "FISHEYE": [500.5, 501.5, 320.75, 241.25],
    "SIMPLE_RADIAL_FISHEYE": [500.5, 320.75, 241.25, -0.05],
    "RADIAL_FISHEYE": [500.5, 320.75, 241.25, -0.05, 0.01],
    "OPENCV_FISHEYE": [500.5, 501.5, 320.75, 241.25, -0.05, 0.01, 1e-3, -2e-3],
    "FOV": [500.5, 501.5, 320.75, 241.25, 0.93],
    "SIMPLE_DIVISION": [500.5, 320.75, 241.25, -0.1],
    "DIVISION": [500.5, 501.5, 320.75, 241.25, -0.1],
    "EUCM": [500.5, 501.5, 320.75, 241.25, 0.6, 1.1],
    "EQUIRECTANGULAR": [640, 480],
}


@pytest.fixture
def reconstruction() -> pycolmap.Reconstruction:
    """One camera of each model that farpoint knows, numbered from 1."""
    found = pycolmap.Reconstruction()
    for index, (model, params) in enumerate(COLMAP_LENSES.items(), start=1):
        found.add_camera(
            pycolmap.Camera(camera_id=index, model=model, width=640, height=480, params=params)
        )
    return found


@pytest.mark.parametrize("form", ["txt", "bin"])
def test_cameras_that_colmap_wrote_see_what_colmap_sees(
    tmp_path: Path, reconstruction: pycolmap.Reconstruction, form: str
) -> None:
    """Pixels differ by the half that COLMAP's centre of the first pixel has."""
    if form == "txt":
        reconstruction.write_text(tmp_path)
    else:
        reconstruction.write_binary(tmp_path)
    points = np.random.default_rng(0).uniform([-0.6, -0.5, 1], [0.6, 0.5, 2], (50, 3))
    for index, peer in reconstruction.cameras.items():
        camera = load_camera(tmp_path / f"cameras.{form}", str(index))
        expected = np.array([peer.img_from_cam(point) for point in points]).reshape(-1, 2) - 0.5
        assert camera.size == (640, 480)
        np.testing.assert_allclose(camera.project(points), expected, rtol=0, atol=1e-7)
        rays = camera.unproject(expected)
        ahead = points / np.linalg.norm(points, axis=1, keepdims=True)
        np.testing.assert_allclose(rays, ahead, rtol=0, atol=1e-9)


def test_damaged_cameras_bin_says_where(
    tmp_path: Path, reconstruction: pycolmap.Reconstruction
) -> None:
    reconstruction.write_binary(tmp_path)
    path = tmp_path / "cameras.bin"
    data = path.read_bytes()
    path.write_bytes(data[:100])
    with pytest.raises(InputError, match="cut short or damaged; expected 16 cameras") as caught:
        load_camera(path, "1")
    assert caught.value.field == "camera number 2"
    path.write_bytes(data[:10])
    with pytest.raises(InputError, match="is not a camera calibration"):
        load_camera(path, "1")


def test_numbered_parameters_of_old_basalt_files(write) -> None:
    def text(kind: str, **p: float) -> str:
        camera = {"cam_type": kind, **EXPECTED, **p, "width": 640, "height": 480}
        return json.dumps({"value0": {"cam.T_i_c": [], "cam.intrinsics": [camera]}})

    for kind, numbers, model in (
        ("ds", {"p1": -0.2, "p2": 0.6}, DoubleSphere(**EXPECTED, xi=-0.2, alpha=0.6)),
        ("eucm", {"p1": 0.6, "p2": 1.1}, ExtendedUnified(**EXPECTED, alpha=0.6, beta=1.1)),
        ("ucm", {"p1": 0.6}, ExtendedUnified(**EXPECTED, alpha=0.6, beta=1.0)),
        ("kb4", {"p1": -0.3, "p2": 0.1, "p3": 0.001, "p4": -0.002}, FISHEYE),
        ("pinhole", {}, Pinhole(**EXPECTED)),
    ):
        camera = load_camera(write(text(kind, **numbers)))
        assert (camera.model, camera.name, camera.size) == (model, "cam0", (640, 480))


def test_basalts_pinhole_has_opencvs_eight(write) -> None:
    keys = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    values = dict(zip(keys, (0.9, 0.2, 1e-3, -5e-4, 0.02, 1.2, 0.4, 0.05), strict=True))
    camera = {"camera_type": "pinhole-radtan8", "intrinsics": EXPECTED | values | {"rpmax": 2.7}}
    text = json.dumps({"value0": {"intrinsics": [camera]}})
    loaded = load_camera(write(text))
    assert loaded.model == Pinhole(**EXPECTED, distortion=tuple(values.values()))
    assert loaded.size is None


def test_frames_with_cameras_of_their_own(write) -> None:
    intrinsics = {key: NERF[key] for key in ("fl_x", "fl_y", "cx", "cy", "w", "h")}
    frames = [
        {"file_path": "a.png", **intrinsics},
        {"file_path": "b.png", **intrinsics, "fl_x": 700, "k1": 0.1},
    ]
    path = write(json.dumps({"camera_model": "OPENCV", "frames": frames}))
    assert load_camera(path, "a.png").model == Pinhole(**EXPECTED)
    second = load_camera(path, "b.png").model
    assert second == Pinhole(**(EXPECTED | {"fx": 700}), distortion=(0.1, 0, 0, 0, 0))
    with pytest.raises(InputError, match=r"several cameras; expected a name, one of a.png, b.png"):
        load_camera(path)


def test_ocamcalib_is_known_without_its_comments(write) -> None:
    bare = "\n".join(line for line in OCAM.splitlines() if line and not line.startswith("#"))
    assert load_camera(write(bare)).model == load_camera(write(OCAM)).model


def test_division_of_colmap_has_its_sign(write) -> None:
    camera = load_camera(write("1 DIVISION 640 480 500.5 501.5 320.75 241.25 -0.1\n"))
    assert camera.model == Division(**EXPECTED, k=-0.1)
