"""Sigmas that calibration programs write beside what they found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from tool_files_kit import BOUGUET

from farpoint.camera import (
    Arctangent,
    CameraModel,
    DoubleSphere,
    ExtendedUnified,
    KannalaBrandt,
    Pinhole,
    Unified,
    load_camera,
)
from farpoint.errors import InputError

FOCAL = {"fx": 614.97, "fy": 615.27, "cx": 309.84, "cy": 239.98}
D4 = (0.1234, -0.2330, -0.0013, -0.0045)
# As `kalibr_calibrate_cameras` prints it: with tabs in older versions, with blanks in newer ones.
REPORT = """\
Calibration results {blank}
====================
Camera-system parameters:
{indent}cam0 (/camera/color/image_raw):
{indent} type: <class 'aslam_cv.libaslam_cv_python.{kind}CameraGeometry'>
{indent} distortion: [{d}] +- [{dd}]
{indent} projection: [{p}] +- [{dp}]
{indent} reprojection error: [-0.000000, 0.000000] +- [0.101194, 0.092962]

{indent}cam1 (/camera/mono/image_raw):
{indent} type: <class 'aslam_cv.libaslam_cv_python.DistortedPinholeCameraGeometry'>
{indent} distortion: [ 0.06143751 -0.13747218  0.00153052 -0.00356831] +- [0.005 0.013 0.0005 4e-4]
{indent} projection: [1155.1179 1154.4843  645.3725  365.7850] +- [0.80 0.76 0.14
 0.82]
{indent} reprojection error: [-0.000098, -0.000042] +- [0.416945, 0.325086]

{indent}baseline T_1_0:
{indent} q: [-0.00087935 -0.00270995 -0.0008824   0.99999555] +- [0.0015 0.0003 0.0001]
{indent} t: [-0.02997144 -0.00027389  0.00036353] +- [0.0001 0.0001 0.0003]



Target configuration
====================

  Type: checkerboard
  Rows
    Count: 8
    Distance: 0.03 [m]
"""
PINHOLE = "614.97  615.27  309.84  239.98"
LENSES: list[tuple[str, str, str, CameraModel]] = [
    ("Pinhole", "", PINHOLE, Pinhole(**FOCAL)),
    (
        "DistortedPinhole",
        " 0.1234 -0.2330 -0.0013 -0.0045",
        PINHOLE,
        Pinhole(**FOCAL, distortion=D4),
    ),
    (
        "DistortedPinholeRs",
        " 0.1234 -0.2330 -0.0013 -0.0045",
        PINHOLE,
        Pinhole(**FOCAL, distortion=D4),
    ),
    (
        "EquidistantDistortedPinhole",
        "0.1 0.02 -0.01 2.e-03",
        PINHOLE,
        KannalaBrandt(**FOCAL, k1=0.1, k2=0.02, k3=-0.01, k4=2e-3),
    ),
    ("FovDistortedPinhole", "0.93", PINHOLE, Arctangent(**FOCAL, omega=0.93)),
    ("Omni", "", f"1.3 {PINHOLE}", Unified(**FOCAL, xi=1.3)),
    (
        "DistortedOmni",
        "0.1234 -0.2330 -0.0013 -0.0045",
        f"1.3 {PINHOLE}",
        Unified(**FOCAL, xi=1.3, distortion=D4),
    ),
    ("ExtendedUnified", "", f"0.6 1.1 {PINHOLE}", ExtendedUnified(**FOCAL, alpha=0.6, beta=1.1)),
    ("DoubleSphere", "", f"-0.2 0.6\n {PINHOLE}", DoubleSphere(**FOCAL, xi=-0.2, alpha=0.6)),
]


def sigmas_of(numbers: str) -> str:
    """A hundredth of each number, positive."""
    return " ".join(f"{abs(float(number)) / 100:.8g}" for number in numbers.split())


def report(kind: str, d: str, p: str, indent: str = "\t") -> str:
    sigmas = {"dd": sigmas_of(d), "dp": sigmas_of(p)}
    return REPORT.format(kind=kind, d=d, p=p, **sigmas, indent=indent, blank="")


@pytest.mark.parametrize("indent", ["\t", "", "    "])
@pytest.mark.parametrize(("kind", "d", "p", "model"), LENSES)
def test_kalibrs_report(
    kind: str, d: str, p: str, model: CameraModel, indent: str, write: Callable[..., Path]
) -> None:
    camera = load_camera(write(report(kind, d, p, indent)), "cam0")
    assert camera.model == model
    assert camera.size is None
    assert camera.source is not None
    assert camera.source.startswith("Kalibr results-cam.txt, ")
    sigmas = camera.parameter_sigmas()
    expected = {name: abs(value) / 100 for name, value in model.parameters.items()}
    assert {name: sigmas[name] for name in expected} == pytest.approx(expected, rel=1e-7)
    correlated = camera.parameter_covariance() - np.diag(np.diag(camera.parameter_covariance()))
    assert not correlated.any()


def test_kalibrs_report_has_several_cameras(write: Callable[..., Path]) -> None:
    path = write(report(*LENSES[1][:3]))
    with pytest.raises(InputError, match="expected a name, one of cam0, cam1"):
        load_camera(path)
    camera = load_camera(path, "cam1")
    assert camera.model.parameters["fx"] == 1155.1179
    assert camera.parameter_sigmas()["fx"] == pytest.approx(0.8)
    assert camera.parameter_sigmas()["cy"] == pytest.approx(0.82)
    assert camera.parameter_sigmas()["k2"] == pytest.approx(0.013)


@pytest.mark.parametrize(
    ("old", "new", "field", "problem"),
    [
        (".DistortedPinholeC", ".MirrorC", "cam0.type", "'Mirror' is not supported"),
        (" type:", " kind:", "cam0.type", "not supported"),
        ("+- [6.1497", "+ [6.1497", "cam0.intrinsics", "missing"),
        ("projection: [614.97 ", "projection: [", "cam0.intrinsics", "expected 4 numbers, got 3"),
        ("[614.97", "[-614.97", "cam0.intrinsics (fx)", "positive"),
        ("[614.97", "[wide", "cam0.intrinsics", "expected a number"),
        ("+- [6.1497 ", "+- [", "cam0.sigma of intrinsics", "expected 4 numbers, got 3"),
        ("+- [6.1497 ", "+- [nan ", "cam0.sigma of intrinsics", "finite"),
        ("+- [6.1497 ", "+- [-6.1 ", "cam0.sigma of intrinsics (fx)", "negative"),
        ("+- [0.001234 ", "+- [-1 ", "cam0.sigma of distortion_coeffs (k1)", "negative"),
    ],
)
def test_faults_in_kalibrs_report(
    write: Callable[..., Path], old: str, new: str, field: str, problem: str
) -> None:
    text = report(*LENSES[1][:3])
    assert old in text
    with pytest.raises(InputError) as caught:
        load_camera(write(text.replace(old, new)), "cam0")
    assert caught.value.field == field
    assert problem in caught.value.problem


# OpenCV's interactive-calibration, from its documentation: the aspect ratio and the tangential
# coefficients were not estimated.
INTERACTIVE = """\
<?xml version="1.0"?>
<opencv_storage>
<framesCount>21</framesCount>
<cameraResolution>
  1280 720</cameraResolution>
<cameraMatrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    1.25e+03 0. 6.7e+02 0.
    1.0e+03 3.6e+02 0. 0. 1.</data></cameraMatrix>
<cameraMatrix_std_dev type_id="opencv-matrix">
  <rows>4</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    0. 1.2e+01 2.9
    2.8</data></cameraMatrix_std_dev>
<dist_coeffs type_id="opencv-matrix">
  <rows>1</rows>
  <cols>5</cols>
  <dt>d</dt>
  <data>
    1.3e-01 -8.2e-01 0. 0.
    1.6</data></dist_coeffs>
<dist_coeffs_std_dev type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    1.5e-02 8.7e-02 0. 0.
    1.8e-01</data></dist_coeffs_std_dev>
<avg_reprojection_error>4.2e-01</avg_reprojection_error>
</opencv_storage>
"""


def test_opencvs_interactive_calibration(write: Callable[..., Path]) -> None:
    camera = load_camera(write(INTERACTIVE))
    assert camera.size == (1280, 720)
    sigmas = {"fx": 15.0, "fy": 12.0, "cx": 2.9, "cy": 2.8}
    sigmas |= {"k1": 0.015, "k2": 0.087, "p1": 0.0, "p2": 0.0, "k3": 0.18}
    assert camera.parameter_sigmas() == pytest.approx(sigmas, rel=1e-12)
    covariance = camera.parameter_covariance()
    # With a fixed aspect ratio fx is off with fy.
    assert covariance[0, 1] == pytest.approx(15.0 * 12.0, rel=1e-12)
    covariance[0, 1] = covariance[1, 0] = 0.0
    assert not (covariance - np.diag(np.diag(covariance))).any()


def test_deviations_of_fx_by_itself_are_its_own(write: Callable[..., Path]) -> None:
    camera = load_camera(write(INTERACTIVE.replace("0. 1.2e+01", "7. 1.2e+01")))
    assert camera.parameter_sigmas()["fx"] == 7.0
    assert camera.parameter_covariance()[0, 1] == 0.0


def test_deviations_of_nothing_tell_nothing(write: Callable[..., Path]) -> None:
    text = INTERACTIVE.replace("0. 1.2e+01 2.9\n    2.8", "0. 0. 0. 0.")
    assert load_camera(write(text)).uncertainty is not None
    text = text.replace("1.5e-02 8.7e-02 0. 0.\n    1.8e-01", "0. 0. 0. 0. 0.")
    assert load_camera(write(text)).uncertainty is None


@pytest.mark.parametrize(
    ("old", "new", "field", "problem"),
    [
        ("1.2e+01 2.9", "2.9", "cameraMatrix_std_dev", "expected 4 numbers, got 3"),
        ("1.2e+01 2.9", "-1.2e+01 2.9", "cameraMatrix_std_dev (fy)", "negative"),
        ("1.5e-02", "large", "dist_coeffs_std_dev", "expected a number"),
    ],
)
def test_faults_in_deviations(
    write: Callable[..., Path], old: str, new: str, field: str, problem: str
) -> None:
    with pytest.raises(InputError) as caught:
        load_camera(write(INTERACTIVE.replace(old, new)))
    assert caught.value.field == field
    assert problem in caught.value.problem


@pytest.mark.parametrize("key", ["std_intrinsics", "stdDeviationsIntrinsics", "std_dev_intrinsics"])
def test_the_vector_of_calibrate_camera_extended(key: str, tmp_path: Path) -> None:
    """As a script writes it with FileStorage: eighteen rows, zeros for what was not estimated."""
    deviations = np.zeros((18, 1))
    deviations[:9, 0] = 3.0, 2.5, 1.0, 0.9, 0.01, 0.02, 1e-4, 2e-4, 0.05
    path = tmp_path / "calibration.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]]))
    storage.write("dist_coeff", np.array([[-0.2, 0.1, 1e-3, -1e-3, 0.02]]))
    storage.write(key, deviations)
    storage.release()
    found = load_camera(path).parameter_sigmas()
    assert list(found.values()) == pytest.approx(deviations[:9, 0].tolist(), rel=1e-12)
    path.write_text(path.read_text().replace("dist_coeff", "else"))
    assert list(load_camera(path).parameter_sigmas().values()) == pytest.approx(
        [3, 2.5, 1, 0.9] + 4 * [0]
    )
    short = path.read_text().split(key)[0] + f"{key}: [ 1., 2. ]\n"
    path.write_text(short)
    with pytest.raises(InputError, match=f"{key}: expected at least 4 numbers, got 2"):
        load_camera(path)


def test_deviations_of_a_fisheye_are_nobodys(write: Callable[..., Path]) -> None:
    text = INTERACTIVE.replace("<cols>5</cols>", "<cols>4</cols>").replace(
        "\n    1.6</data>", "</data>"
    )
    text = text.replace("<framesCount>", "<fisheye_model>1</fisheye_model><framesCount>")
    assert load_camera(write(text)).uncertainty is None


def test_a_third_of_bouguets_errors_is_one_sigma(tmp_path: Path) -> None:
    path = tmp_path / "Calib_Results.m"
    path.write_text(BOUGUET)
    expected = {"fx": 0.1, "fy": 0.2, "cx": 0.3, "cy": 0.4, "k1": 0.001, "k2": 0.01}
    expected |= {"p1": 0.0001, "p2": 0.0002, "k3": 0.0}
    assert load_camera(path).parameter_sigmas() == pytest.approx(expected)
