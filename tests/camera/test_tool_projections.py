"""Cameras of other tools' files against those tools' own formulas, transcribed here, or numbers.

A transcription gives pixels in the tool's own convention; where its first pixel has its corner at
(0, 0), the half is taken off here.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from tool_files_kit import (
    BROWN,
    DEPTHAI,
    EXPECTED,
    GYROFLOW,
    K4,
    METASHAPE,
    METASHAPE_FISHEYE,
    MRCAL,
    OPENSFM,
    REALSENSE,
    STELLA_DIVISION,
    SVO_OMNI,
    VIKIT_ATAN,
    changed,
)

from farpoint.camera import load_camera

Projection = Callable[[float, float, float], tuple[float, float]]
POINTS = np.random.default_rng(3).uniform([-0.45, -0.4, 1.0], [0.45, 0.4, 1.5], (40, 3))


def assert_equal_projections(camera, project: Projection, points: np.ndarray = POINTS) -> None:
    expected = np.array([project(*point) for point in points])
    np.testing.assert_allclose(camera.project(points), expected, rtol=0, atol=1e-8)


def realsense(model: str, c: list[float]) -> Projection:
    """librealsense, rsutil.h: ``rs2_project_point_to_pixel``."""

    def project(X: float, Y: float, Z: float) -> tuple[float, float]:
        x, y = X / Z, Y / Z
        r2 = x * x + y * y
        f = 1 + c[0] * r2 + c[1] * r2 * r2 + c[4] * r2 * r2 * r2
        if model in ("modified", "inverse"):
            x, y = x * f, y * f
            x, y = (
                x + 2 * c[2] * x * y + c[3] * (r2 + 2 * x * x),
                y + 2 * c[3] * x * y + c[2] * (r2 + 2 * y * y),
            )
        elif model == "brown":
            x, y = (
                x * f + 2 * c[2] * x * y + c[3] * (r2 + 2 * x * x),
                y * f + 2 * c[3] * x * y + c[2] * (r2 + 2 * y * y),
            )
        elif model == "ftheta":
            r = np.sqrt(r2)
            rd = 1.0 / c[0] * np.arctan(2 * r * np.tan(c[0] / 2.0))
            x, y = x * rd / r, y * rd / r
        elif model == "kb4":
            r = np.sqrt(r2)
            t = np.arctan(r)
            t2 = t * t
            rd = t * (1 + t2 * (c[0] + t2 * (c[1] + t2 * (c[2] + t2 * c[3]))))
            x, y = x * rd / r, y * rd / r
        return x * EXPECTED["fx"] + EXPECTED["cx"], y * EXPECTED["fy"] + EXPECTED["cy"]

    return project


@pytest.mark.parametrize(
    ("number", "name", "model", "coefficients"),
    [
        (0, "None", "none", [0.0] * 5),
        (1, "Modified Brown Conrady", "modified", [-0.3, 0.1, 0, 0, 0.02]),
        (2, "Inverse Brown Conrady", "inverse", [-0.055, 0.061, 0, 0, -0.02]),
        (2, "distortion.inverse_brown_conrady", "inverse", [0.0] * 5),
        (3, "F-Theta", "ftheta", [0.93, 0, 0, 0, 0]),
        (4, "RS2_DISTORTION_BROWN_CONRADY", "brown", [-0.3, 0.1, 1e-3, -2e-3, 0.02]),
        (5, "Kannala Brandt4", "kb4", [-0.05, 0.02, 0.001, -0.002, 0]),
    ],
)
def test_realsense(write, number: int, name: str, model: str, coefficients: list[float]) -> None:
    for kind in (number, name):
        camera = load_camera(write(changed(REALSENSE, model=kind, coeffs=coefficients)))
        assert_equal_projections(camera, realsense(model, coefficients))


def metashape(*, fisheye: bool, k4: float = 0.0, k3: float, p: tuple[float, float]) -> Projection:
    """The manual's appendix on camera models, pixels from the corner of the picture."""

    def project(X: float, Y: float, Z: float) -> tuple[float, float]:
        x, y = X / Z, Y / Z
        if fisheye:
            r0 = np.sqrt(x * x + y * y)
            x, y = x * np.arctan(r0) / r0, y * np.arctan(r0) / r0
        r = np.sqrt(x * x + y * y)
        radial = 1 + -0.3 * r**2 + 0.1 * r**4 + k3 * r**6 + k4 * r**8
        xd = x * radial + (p[0] * (r**2 + 2 * x**2) + 2 * p[1] * x * y)
        yd = y * radial + (p[1] * (r**2 + 2 * y**2) + 2 * p[0] * x * y)
        u = 640 * 0.5 + 0.75 + xd * 501.5 + xd * -1.0
        v = 480 * 0.5 + 1.25 + yd * 501.5
        return u - 0.5, v - 0.5

    return project


def test_metashape(write) -> None:
    frame = metashape(fisheye=False, k3=0.02, p=(-0.002, 0.001))
    assert_equal_projections(load_camera(write(METASHAPE)), frame)
    fisheye = metashape(fisheye=True, k3=0.001, k4=-0.002, p=(0.0, 0.0))
    assert_equal_projections(load_camera(write(METASHAPE_FISHEYE)), fisheye)


def opensfm(kind: str, v: dict[str, float]) -> Projection:
    """OpenSfM's projections, distortions and ``denormalized_image_coordinates``."""

    def get(key: str) -> float:
        return v.get(key, 0.0)

    def project(X: float, Y: float, Z: float) -> tuple[float, float]:
        if kind in ("fisheye", "fisheye_opencv"):
            r = np.hypot(X, Y)
            theta = np.arctan2(r, Z)
            x, y = theta / r * X, theta / r * Y
        elif kind == "spherical":
            longitude = np.arctan2(X, Z)
            latitude = np.arctan2(-Y, np.sqrt(X * X + Z * Z))
            x, y = longitude / (2 * np.pi), -latitude / (2 * np.pi)
        else:
            x, y = X / Z, Y / Z
        r2 = x * x + y * y
        radial = 1 + r2 * (get("k1") + r2 * (get("k2") + r2 * (get("k3") + r2 * get("k4"))))
        p1, p2 = get("p1"), get("p2")
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
        fx = 1.0 if kind == "spherical" else v.get("focal_x", v.get("focal", 0.0))
        fy = 1.0 if kind == "spherical" else v.get("focal_y", fx)
        width, height = v["width"], v["height"]
        size = max(width, height)
        return (
            (xd * fx + get("c_x")) * size - 0.5 + width / 2.0,
            (yd * fy + get("c_y")) * size - 0.5 + height / 2.0,
        )

    return project


@pytest.mark.parametrize("name", OPENSFM)
def test_opensfm(write, name: str) -> None:
    values = OPENSFM[name]
    camera = load_camera(write(json.dumps(OPENSFM)), name)
    assert_equal_projections(camera, opensfm(values["projection_type"], values))


@pytest.mark.parametrize(("transition", "kind"), [(1.0, "perspective"), (0.0, "fisheye")])
def test_opensfms_dual_at_its_two_ends(write, transition: float, kind: str) -> None:
    values = {"width": 640, "height": 480, "focal": 0.75, "k1": -0.1, "k2": 0.02}
    dual = {"a": values | {"projection_type": "dual", "transition": transition}}
    assert_equal_projections(load_camera(write(json.dumps(dual))), opensfm(kind, values))


def test_fisheye62_without_the_rest_of_its_coefficients(write) -> None:
    values = {key: value for key, value in BROWN.items() if key[0] not in "pk"} | K4
    model = {"a": values | {"projection_type": "fisheye62", "k5": 0, "k6": 0, "p1": 0, "p2": 0}}
    assert_equal_projections(
        load_camera(write(json.dumps(model))), opensfm("fisheye_opencv", values)
    )


def test_vikits_arctangent(write) -> None:
    """rpg_vikit, atan_camera.cpp: ``world2cam``."""
    width, height, s = 640, 480, 0.93

    def project(X: float, Y: float, Z: float) -> tuple[float, float]:
        x, y = X / Z, Y / Z
        r = np.sqrt(x * x + y * y)
        factor = np.arctan(r * 2.0 * np.tan(s / 2.0)) / s / r
        return (
            (0.25 * width - 0.5) + width * 0.5 * factor * x,
            (0.75 * height - 0.5) + height * 0.625 * factor * y,
        )

    assert_equal_projections(load_camera(write(VIKIT_ATAN)), project)


def test_stellas_radial_division(write) -> None:
    """stella_vslam, radial_division.cc: ``undistort_point``, then ``convert_point_to_bearing``."""
    camera = load_camera(write(STELLA_DIVISION))
    for u, v in np.random.default_rng(5).uniform([0, 0], [639, 479], (20, 2)):
        x, y = (u - EXPECTED["cx"]) / EXPECTED["fx"], (v - EXPECTED["cy"]) / EXPECTED["fy"]
        undistortion = 1.0 + -0.1 * (x * x + y * y)
        bearing = np.array([x / undistortion, y / undistortion, 1.0])
        bearing /= np.linalg.norm(bearing)
        np.testing.assert_allclose(camera.unproject([[u, v]])[0], bearing, rtol=0, atol=1e-12)


def test_svos_omnidirectional_camera(write) -> None:
    """SVO Pro's vikit, omni_projection.cpp: ``backProject3``."""
    camera = load_camera(write(SVO_OMNI))
    polynomial, distortion = [-206.5, 0.0, 2.2e-3, -4.9e-6, 1.87e-8], [1.002, 0.003, -0.002]
    affine = np.array([[1.0, distortion[2]], [distortion[1], distortion[0]]])
    for pixel in np.random.default_rng(6).uniform([100, 50], [540, 430], (20, 2)):
        x, y = np.linalg.inv(affine) @ (pixel - [318.25, 241.75])
        rho = np.hypot(x, y)
        bearing = np.array([x, y, -sum(a * rho**n for n, a in enumerate(polynomial))])
        bearing /= np.linalg.norm(bearing)
        np.testing.assert_allclose(camera.unproject([pixel])[0], bearing, rtol=0, atol=1e-12)


# The first of the points, and what mrcal's own test of its projections expects for it.
MRCAL_POINT = [[1.0, 2.0, 10.0]]
MRCAL_NUMBERS = {
    "OPENCV4": ("-0.012, 0.035, -0.001, 0.002", [651.27371, 555.23042]),
    "OPENCV5": ("-0.012, 0.035, -0.001, 0.002, 0.019", [651.2740691, 555.2309482]),
    "OPENCV8": (
        "-0.012, 0.035, -0.001, 0.002, 0.019, 0.014, -0.056, 0.050",
        [651.1885442, 555.10514968],
    ),
}
CORE = "1512., 1112, 500., 333."


def mrcal_text(model: str, numbers: str) -> str:
    return (
        f"{{ 'lensmodel': 'LENSMODEL_{model}', 'intrinsics': [ {numbers} ], "
        "'extrinsics': [0,0,0,0,0,0], 'imagersize': [ 4000, 2200 ] }"
    )


@pytest.mark.parametrize("model", MRCAL_NUMBERS)
def test_numbers_of_mrcals_own_test(write, model: str) -> None:
    coefficients, expected = MRCAL_NUMBERS[model]
    camera = load_camera(write(mrcal_text(model, f"{CORE}, {coefficients}")))
    np.testing.assert_allclose(camera.project(MRCAL_POINT), [expected], rtol=0, atol=1e-5)


def test_mrcals_stereographic(write) -> None:
    """mrcal: ``q = xy / |xy| tan(angle / 2) 2 f + c``, behind the camera, too."""
    camera = load_camera(write(mrcal_text("STEREOGRAPHIC", CORE)))

    def project(X: float, Y: float, Z: float) -> tuple[float, float]:
        r = np.hypot(X, Y)
        height = 2 * np.tan(np.arctan2(r, Z) / 2)
        return X / r * height * 1512.0 + 500.0, Y / r * height * 1112.0 + 333.0

    assert_equal_projections(camera, project)
    assert_equal_projections(camera, project, np.array([[1.0, 0.5, -0.2], [-0.3, 0.8, -0.1]]))


def test_mrcals_longitude_and_latitude(write) -> None:
    """mrcal: ``lon = atan2(x, z)``, ``lat = asin(y / |p|)``, times f, plus c."""
    f = 4000 / (2 * np.pi), 2200 / np.pi
    text = mrcal_text("LONLAT", f"{f[0]}, {f[1]}, 1999.5, 1099.5")

    def project(X: float, Y: float, Z: float) -> tuple[float, float]:
        latitude = np.arcsin(Y / np.sqrt(X * X + Y * Y + Z * Z))
        return np.arctan2(X, Z) * f[0] + 1999.5, latitude * f[1] + 1099.5

    assert_equal_projections(load_camera(write(text)), project)


def with_opencv(matrix: list[list[float]], coefficients: list[float], *, fisheye: bool):
    no_turn = np.zeros(3)
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    arguments = (np.array(matrix), np.array(coefficients))
    if fisheye:
        return project(POINTS.reshape(-1, 1, 3), no_turn, no_turn, *arguments)[0].reshape(-1, 2)
    return project(POINTS, no_turn, no_turn, *arguments)[0].reshape(-1, 2)


def test_lenses_that_are_opencvs_by_name(write) -> None:
    """DepthAI's fourteen and fisheye, Gyroflow's fisheye and standard lens, mrcal's OPENCV8."""
    (_, pinhole), (_, fisheye) = DEPTHAI["cameraData"]
    lens = GYROFLOW["fisheye_params"]
    matrix = lens["camera_matrix"]
    standard = json.loads(json.dumps(GYROFLOW)) | {"distortion_model": "opencv_standard"}
    standard["fisheye_params"]["distortion_coeffs"] = list(pinhole["distortionCoeff"][:12])
    depthai = json.dumps(DEPTHAI)
    for text, name, coefficients, is_fisheye in (
        (depthai, "CAM_A", pinhole["distortionCoeff"], False),
        (depthai, "CAM_B", fisheye["distortionCoeff"][:4], True),
        (json.dumps(GYROFLOW), None, lens["distortion_coeffs"], True),
        (json.dumps(standard), None, standard["fisheye_params"]["distortion_coeffs"], False),
        (MRCAL, None, pinhole["distortionCoeff"][:8], False),
    ):
        expected = with_opencv(matrix, coefficients, fisheye=is_fisheye)
        seen = load_camera(write(text), name).project(POINTS)
        np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("told", "readout_s"),
    [
        ({}, 0.0125),
        ({"frame_readout_direction": "TopToBottom"}, 0.0125),
        ({"frame_readout_direction": "LeftToRight"}, None),
        ({"frame_readout_time": None}, None),
        ({"frame_readout_time": -12.5}, None),
        ({"global_shutter": True}, 0.0),
    ],
)
def test_gyroflow_profiles_tell_the_shutter(tmp_path, told, readout_s):
    path = tmp_path / "profile.json"
    path.write_text(json.dumps(GYROFLOW | told))
    assert load_camera(path).readout_s == readout_s
