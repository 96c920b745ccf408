"""What may be wrong with another tool's file, the field named for it, and hostile contents."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from tool_files_kit import (
    ARKIT,
    AUTOWARE,
    BOOFCV,
    BOUGUET,
    BROWN,
    BY_NAME,
    DEPTHAI,
    EXPECTED,
    GYROFLOW,
    K4,
    LISTED,
    MATRIX,
    MC_CALIB,
    METASHAPE,
    METASHAPE_FISHEYE,
    METASHAPE_SPHERE,
    MRCAL,
    OPEN3D,
    OPENVSLAM_FISHEYE,
    OST,
    REALSENSE,
    REALSENSE_LISTING,
    SAMPLES,
    STELLA,
    STELLA_DIVISION,
    STELLA_SPHERE,
    SVO,
    SVO_OMNI,
    VIKIT,
    VIKIT_ATAN,
    VIKIT_EQUIDISTANT,
    VIKIT_ROS2,
    ZED,
    ZED_X,
    changed,
    npz,
)

from farpoint.camera import load_camera
from farpoint.errors import InputError


def depthai(**changes: object) -> str:
    return json.dumps({"cameraData": [[0, DEPTHAI["cameraData"][0][1] | changes]]})


def opensfm(**changes: object) -> str:
    return json.dumps({"a": BROWN | changes})


def gyroflow_lens(**changes: object) -> str:
    return changed(GYROFLOW, fisheye_params=GYROFLOW["fisheye_params"] | changes)


UNKNOWN = "is not understood"
NONE = "expected zeros or no numbers beside"
FAULTS = [
    (BOUGUET.replace("alpha_c = 0.0", "alpha_c = 0.1"), None, "alpha_c", "skew"),
    (BOUGUET.replace(" ; 0.020000000 ]", " ]", 1), None, "kc", "expected 5 numbers, got 4"),
    (BOUGUET.replace("fc = [ 500", "fc = [ -500"), None, "fc (fx)", "positive"),
    (BOOFCV.replace("pinhole_radial_tangential", "kannala_brandt"), None, "model", "not supported"),
    (BOOFCV.replace("skew: 0.0", "skew: 0.5"), None, "pinhole.skew", "skew is not supported"),
    (
        BOOFCV.replace("pinhole_radial_tangential", "pinhole"),
        *(None, "radial_tangential", "looks like"),
    ),
    (
        BOOFCV.replace("  - 0.1\n", "  - 0.1\n  - 0.2\n  - 0.3\n"),
        *(None, "radial_tangential.radial", "at most 3 numbers, got 4"),
    ),
    (changed(BY_NAME, xi=1.2), None, "xi", "looks like"),
    (changed(BY_NAME, skew=0.2), None, "skew", "looks like"),
    (changed(BY_NAME, width=None, height=None, w=0.93), None, "w", "looks like"),
    (changed(BY_NAME, fx=0.7, fy=0.9, cx=0.5, cy=0.5), None, "fx", "shares of the image"),
    (changed(BY_NAME, distortion_model="none"), None, "dist", NONE),
    (json.dumps({**EXPECTED, **K4}), None, "k4", "may be of a fisheye"),
    (json.dumps({"K": MATRIX, **K4}), None, "k4", "may be of a fisheye"),
    (
        json.dumps({**EXPECTED, **K4, "p1": 0.1, "model": "fisheye"}),
        *(None, "p1", "alone of a fisheye"),
    ),
    (json.dumps(LISTED), None, "name", "one of front, cam1"),
    (
        json.dumps({"cameras": [{**BY_NAME, "binning": 2}]}),
        *(None, "cameras[0].binning", "looks like"),
    ),
    (
        SVO.replace("radial-tangential", "none"),
        *("cam0", "cameras[0].camera.distortion.parameters", NONE),
    ),
    (
        f"K: {MATRIX}\nD: [0.1, 0, 0, 0]\ndistortion_model: none\n",
        *(None, "D", NONE),
    ),
    (
        "Camera.type: Rectified\nCamera.fx: 5\nCamera.fy: 5\nCamera.cx: 3\nCamera.cy: 2\n"
        "Camera.k2: 0.1\n",
        *(None, "Camera.k2", NONE),
    ),
    (STELLA.replace("perspective", "lattice"), None, "Camera.model", "'lattice' is not supported"),
    (STELLA.replace("  k3: 0.02\n", ""), None, "Camera.k3", "missing"),
    (STELLA.replace("  k3", "  k6: 0.5\n  k3"), None, "Camera.k6", UNKNOWN),
    (STELLA.replace("500.5", "-1"), None, "Camera.fx (fx)", "positive"),
    (STELLA_SPHERE.replace("320", "1e300"), None, "Camera.rows", "at most 1000000 pixels"),
    (STELLA.replace("  cols: 640\n  rows: 480\n", ""), None, "Camera.cols", "missing"),
    (STELLA_DIVISION.replace("-0.1", "wide"), None, "Camera.distortion", "number, got 'wide'"),
    (OPENVSLAM_FISHEYE + "Camera.p1: 0.1\n", None, "Camera.p1", UNKNOWN),
    (
        SVO.replace("radial-tangential", "lattice"),
        "cam0",
        "cameras[0].camera.distortion.type",
        "'lattice' is not supported; expected none or radial-tangential",
    ),
    (
        SVO.replace("    type: pinhole", "    type: lattice", 1),
        "cam0",
        "cameras[0].camera.type",
        "expected pinhole or omni",
    ),
    (
        SVO.replace("    label: cam0", "    label: cam0\n    xi: 0.5"),
        "cam0",
        "cameras[0].camera.xi",
        UNKNOWN,
    ),
    (SVO, None, "name", "one of cam0, right"),
    (SVO_OMNI.replace("294.2, ", ""), None, "intrinsics", "expected 22 or 24 numbers, got 23"),
    (SVO_OMNI.replace("type: none", "type: fisheye"), None, "distortion.type", "expected none"),
    (VIKIT + "cam_d5: 0.1\n", None, "cam_d5", UNKNOWN),
    (VIKIT_ROS2 + "      d7: 0.1\n", None, "/**.ros__parameters.camera.d7", UNKNOWN),
    (VIKIT_EQUIDISTANT + "cam_d0: 0.1\n", None, "cam_d0", UNKNOWN),
    (VIKIT + "xi: 1.1\n", None, "xi", UNKNOWN),
    (VIKIT.replace("Pinhole", "Ocam"), None, "cam_model", "'Ocam' is not supported"),
    (VIKIT.replace("500.5", "0.78"), None, "cam_fx", "expected pixels"),
    (VIKIT_ATAN.replace("0.93", "4"), None, "cam_d0 (omega)", "from 1e-06"),
    (VIKIT_ATAN.replace("cam_width: 640\n", ""), None, "cam_width", "missing"),
    (changed(REALSENSE, model="lattice"), None, "model", "'lattice' is not supported"),
    (changed(REALSENSE, model=None), None, "model", "missing"),
    (changed(REALSENSE, model="none"), None, "coeffs", "expected zeros"),
    (
        changed(REALSENSE, model="inverse brown conrady"),
        None,
        "coeffs",
        "expected zeros for p1 and p2",
    ),
    (changed(REALSENSE, model=1), None, "coeffs", "expected zeros for p1 and p2"),
    (changed(REALSENSE, coeffs=[1, 2]), None, "coeffs", "expected 4 or 5 numbers, got 2"),
    (changed(REALSENSE, k6=0.1), None, "k6", UNKNOWN),
    (changed(REALSENSE, fx=-1), None, "fx (fx)", "positive"),
    (
        REALSENSE_LISTING.replace("\t500.5", "\twide"),
        "Color 640x480",
        "Color 640x480 fx",
        "'wide'",
    ),
    (REALSENSE_LISTING, None, "name", "one of Depth 848x480, Color 640x480"),
    (ZED, "MIDDLE_CAM_HD", "name", "LEFT_CAM_HD, RIGHT_CAM_HD"),
    (ZED.replace("k3=0.02", "s1=0.02"), "LEFT_CAM_HD", "[LEFT_CAM_HD] s1", UNKNOWN),
    (ZED.replace("500.5", "x"), "LEFT_CAM_HD", "[LEFT_CAM_HD] fx", "'x'"),
    (ZED_X.replace("cx = 320.25\n", ""), None, "[LEFT_CAM_FHD1200] cx", "missing"),
    (ZED_X.replace("k6 =", "k7 ="), None, "[LEFT_DISTO] k7", UNKNOWN),
    (depthai(cameraType=3), None, "cameraData[0].cameraType", "3 is not supported; expected 0"),
    (depthai(distortionCoeff=[1]), None, "cameraData[0].distortionCoeff", "or 14 numbers, got 1"),
    (depthai(cameraType=1), None, "cameraData[0].distortionCoeff", "zeros after the four"),
    (depthai(skew=1), None, "cameraData[0].skew", UNKNOWN),
    (depthai(intrinsicMatrix=[[0]]), None, "cameraData[0].intrinsicMatrix", "expected 9 numbers"),
    (json.dumps({"cameraData": []}), None, "cameraData", "at least one camera"),
    (json.dumps({"cameraData": [7]}), None, "cameraData[0]", "a socket and a camera"),
    (changed(OPEN3D, distortion=[0.1]), None, "distortion", UNKNOWN),
    (changed(OPEN3D, width=0.5), None, "width", "whole number"),
    (changed(ARKIT, lens_model="fisheye"), None, "lens_model", UNKNOWN),
    (METASHAPE.replace("frame", "cylindrical"), None, "projection", "'cylindrical'"),
    (METASHAPE.replace("<k3>0.02</k3>", "<k4>0.1</k4>"), None, "k4", "for a frame camera"),
    (METASHAPE.replace("b1>", "b2>"), None, "b2", "for a frame camera; expected 0, got -1"),
    (METASHAPE.replace("k3>", "p3>"), None, "p3", UNKNOWN),
    (METASHAPE.replace("f>", "fx>"), None, "fx", UNKNOWN),
    (METASHAPE.replace("<f>501.5</f>", ""), None, "f", "missing"),
    (METASHAPE_FISHEYE.replace("k4>", "p1>"), None, "p1", "for a fisheye"),
    (METASHAPE_SPHERE.replace("320", "300"), None, "height", "expected 320"),
    (METASHAPE_SPHERE.replace("101.8", "90.8"), None, "f", "of a whole sphere"),
    (opensfm(projection_type="lattice"), None, "a.projection_type", "'lattice'"),
    (opensfm(k6=0.1), None, "a.k6", UNKNOWN),
    (opensfm(projection_type="fisheye62"), None, "a.p1", UNKNOWN),
    (
        json.dumps({"a": {"projection_type": "dual", "focal": 1, "width": 6, "height": 4}}),
        None,
        "a.transition",
        "expected 0 or 1, got 0.5",
    ),
    (opensfm(focal_x=-1), None, "a.focal_x (fx)", "positive"),
    (
        json.dumps({"a": {"projection_type": "spherical", "width": 6, "height": 4}}),
        None,
        "a.height",
        "half of the width",
    ),
    (changed(GYROFLOW, distortion_model="poly5"), None, "distortion_model", "'poly5'"),
    (changed(GYROFLOW, digital_lens="gopro_superview"), None, "digital_lens", "expected none"),
    (changed(GYROFLOW, crop=1.5), None, "crop", "expected 1, got 1.5"),
    (
        changed(GYROFLOW, input_horizontal_stretch=1.33),
        None,
        "input_horizontal_stretch",
        "expected 1, got 1.33",
    ),
    (changed(GYROFLOW, interpolations={"24": {}}), None, "interpolations", "expected none"),
    (changed(GYROFLOW, calib_dimension={"h": 4}), None, "calib_dimension.w", "missing"),
    (
        gyroflow_lens(distortion_coeffs=[1, 2]),
        None,
        "fisheye_params.distortion_coeffs",
        "expected 4 numbers, got 2",
    ),
    (gyroflow_lens(camera_matrix=[]), None, "fisheye_params.camera_matrix", "expected 9 numbers"),
    (gyroflow_lens(xi=1), None, "fisheye_params.xi", UNKNOWN),
    (MRCAL.replace("OPENCV8", "CAHVOR"), None, "lensmodel", "'LENSMODEL_CAHVOR'"),
    (
        MRCAL.replace("OPENCV8", "SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=18_fov_x_deg=150"),
        None,
        "lensmodel",
        "is not supported; expected LENSMODEL_PINHOLE or",
    ),
    (MRCAL.replace("0.05,", ""), None, "intrinsics", "expected 12 numbers, got 11"),
    (MRCAL.replace("500.5", "x"), None, "intrinsics", "'x'"),
    (MRCAL.replace("imagersize", "size"), None, "imagersize", "missing"),
    (MRCAL.replace("valid_intrinsics_region", "distortion"), None, "distortion", UNKNOWN),
    (
        MRCAL.replace("OPENCV8", "LONLAT").replace("0.9, 0.2, 1e-3, -5e-4, 0.02", "")
        .replace(", 1.2, 0.4, 0.05,", ""),
        None,
        "intrinsics",
        "of the whole sphere",
    ),
    (MC_CALIB.replace("type: 0", "type: 2"), "camera_0", "camera_0.distortion_type", "2 is not"),
    (MC_CALIB.replace("type: 0", "type: 1"), "camera_0", "camera_0.distortion_vector", "got 5"),
    (MC_CALIB.replace("_group: 0", "_xi: 2"), "camera_0", "camera_0.camera_xi", UNKNOWN),
    (AUTOWARE.replace("plumb_bob", "lattice"), None, "DistModel", "'lattice'"),
    (AUTOWARE.replace("DistCoeff", "DistCoeffs"), None, "DistCoeffs", UNKNOWN),
    (AUTOWARE.replace("500.5", "-1"), None, "CameraMat (fx)", "positive"),
    (OST.replace(" 0.020000", ""), None, "[narrow_stereo] distortion", "four numbers"),
    (OST.replace("240.750000", "x"), None, "[narrow_stereo] camera matrix", "'x'"),
    (OST.replace("rectification", "fisheye"), None, "[narrow_stereo] fisheye", UNKNOWN),
    (OST.replace("640", "640.5"), None, "[image] width", "whole number"),
    (npz(mtx=MATRIX, dist=[1.0]), None, "dist (distortion)", "4, 5, 8, 12 or 14 coefficients"),
    (npz(mtx=np.eye(4)), None, "mtx", "expected 9 numbers, got 16"),
    (npz(mtx=np.full((3, 3), np.nan)), None, "mtx", "finite"),
    (
        npz(mtx=np.array([[object()] * 3] * 3, dtype=object)),
        None,
        "mtx",
        "expected a number, got '<pickled-objects>'",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("content", "name", "field", "words"), FAULTS)
def test_every_fault_names_file_and_field(write, content, name, field, words) -> None:
    path = write(content)
    with pytest.raises(InputError) as caught:
        load_camera(path, name)
    assert caught.value.file == str(path)
    assert caught.value.field == field
    assert words in caught.value.problem
    assert "\n" not in str(caught.value)


def zipped(**members: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


def array_that_promises(shape: str) -> bytes:
    """A NumPy file of eight bytes whose header says more."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(8)


NPY = npz(mtx=np.array(MATRIX), dist=np.zeros(5))
ENTITIES = METASHAPE.replace(
    "<calibration>",
    '<!DOCTYPE calibration [<!ENTITY a "1">\n<!ENTITY b "&a;&a;&a;&a;">]>\n<calibration>',
).replace("501.5", "&b;")
ALIASES = "a0: &a0 [1, 1]\n" + "".join(
    f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 9)}]\n" for level in range(1, 30)
)

HOSTILE = {
    "bomb": zipped(**{"mtx.npy": bytes(1 << 26)}),
    "many members": zipped(**{f"a{index}.npy": b"" for index in range(1001)}),
    "promise": zipped(**{"mtx.npy": array_that_promises("(1000000000, 9)")}),
    "short": zipped(**{"mtx.npy": array_that_promises("(3, 3)")}),
    "negative": zipped(**{"mtx.npy": array_that_promises("(-3, 3)")}),
    "no header": zipped(**{"mtx.npy": b"\x93NUMPY"}),
    "cut archive": NPY[:200],
    "damaged": NPY[:60] + b"\xff\x00\xff" + NPY[63:],
    "entities": ENTITIES,
    "encoding": METASHAPE.replace("UTF-8", "UTF-16"),
    "unknown encoding": METASHAPE.replace("UTF-8", "lattice"),
    "no section": ZED.replace("[LEFT_CAM_HD]", "k = 1\n[LEFT_CAM_HD]", 1),
    "section twice": ZED.replace("RIGHT", "LEFT"),
    "key twice": ZED.replace("k2=0.1", "k1=0.1"),
    "no key": ZED.replace("fx=500.5", "no key here"),
    "long integer": json.dumps(OPEN3D).replace("480", "4" * 5000),
    "aliases": ALIASES + "K: *a29\n",
    "alias of itself": "K: &k [*k]\n",
    "name with a line break": changed(GYROFLOW, **{"a\nb": 1}),
    "deep": "{" + '"cameraData": ' + "[" * 100_000,
    "deep mrcal": MRCAL.replace("[ 500.5", "[" * 100_000),
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_contents_are_one_line(write, kind: str) -> None:
    path = write(HOSTILE[kind])
    with pytest.raises(InputError) as caught:
        load_camera(path, "LEFT_CAM_HD" if "CAM_HD" in str(HOSTILE[kind]) else None)
    assert caught.value.file == str(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_large_arrays_of_an_archive_are_passed_over(write) -> None:
    """Pictures and corners beside the matrix; as many members as no calibration has are refused."""
    path = write(npz(mtx=np.array(MATRIX), dist=np.zeros(5), corners=np.zeros((40, 2000))))
    assert load_camera(path).model.parameters["fx"] == 500.5
    with pytest.raises(InputError, match="expected at most 1000 arrays, got 1001"):
        load_camera(write(HOSTILE["many members"]))


def test_nothing_is_unpickled(write, tmp_path) -> None:
    class Trap:
        def __reduce__(self):
            return (open, (str(tmp_path / "sprung"), "w"))

    path = write(npz(mtx=np.array([[Trap()]], dtype=object), dist=np.zeros(5)))
    with pytest.raises(InputError):
        load_camera(path)
    assert not (tmp_path / "sprung").exists()


def fault_of(path: Path, name: str | None) -> InputError | None:
    try:
        load_camera(path, name)
    except InputError as error:
        return error
    return None


@pytest.mark.parametrize("sample", SAMPLES)
def test_a_file_cut_anywhere_is_read_or_named(write, sample: str) -> None:
    content, name, *_ = SAMPLES[sample]
    faults = 0
    for end in np.linspace(1, len(content) - 1, 25).astype(int):
        path = write(content[:end])
        fault = fault_of(path, name)
        if fault is not None:
            faults += 1
            assert "\n" not in str(fault)
            assert fault.file == str(path)
    assert faults > 0
