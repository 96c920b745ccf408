"""What may be wrong with a file of a wide camera, and the field that is named for it."""

from __future__ import annotations

import pytest
from wide_files_kit import COLMAP, DSO, EXPECTED, MEI, OCAM, OMNIDIR, basalt, kalibr, nerf

from farpoint.camera import load_camera
from farpoint.errors import InputError

FAULTS = [
    *(
        (kalibr(model, first, "none", "[0.1, 0, 0, 0]"), None, "cam0.distortion_coeffs", "none")
        for model, first in (("pinhole", ""), ("omni", "1, "), ("ds", "0.1, 0.5, "))
    ),
    (kalibr("omni", "", "none", "[]"), None, "cam0.intrinsics", "expected 5 numbers, got 4"),
    (kalibr("omni", "-1, ", "none", "[]"), None, "cam0.intrinsics (xi)", "from 0"),
    (kalibr("omni", "1, ", "equidistant", "[]"), None, "cam0.distortion_model", "radtan or none"),
    (
        kalibr("pinhole", "", "fov", "[4]"),
        None,
        "cam0.distortion_coeffs (omega)",
        "from 1e-06 to 3.14159",
    ),
    (OMNIDIR.replace("0., 501.5", "2., 501.5"), None, "camera_matrix", "0 fy cy"),
    (OMNIDIR.replace("xi: 1.25", "xi: wide"), None, "xi", "'wide'"),
    (COLMAP, None, "name", "one of 1, 7"),
    (COLMAP.replace(" -0.002", ""), "1", "camera 1", "expected 8 numbers, got 7"),
    (COLMAP.replace("500.5", "x"), "1", "camera 1", "number, got 'x'"),
    (COLMAP.replace("500.5", "-1"), "1", "camera 1 (fx)", "positive"),
    (COLMAP.replace("1 OPENCV 640", "1 OPENCV -640"), "1", "camera 1 size", "got -640"),
    (COLMAP.replace("7 SIMPLE", "seven SIMPLE"), "1", "camera", "expected CAMERA_ID MODEL"),
    (
        COLMAP.replace("OPENCV", "THIN_PRISM_FISHEYE"),
        "1",
        "camera 1",
        "'THIN_PRISM_FISHEYE' is not supported; expected SIMPLE_PINHOLE",
    ),
    (basalt(intrinsics=[]), None, "value0.intrinsics", "at least one"),
    (basalt(intrinsics=[{}]), None, "value0.intrinsics[0].camera_type", "missing"),
    (
        basalt(intrinsics=[{"camera_type": "lattice"}]),
        None,
        "value0.intrinsics[0].camera_type",
        "'lattice' is not supported; expected pinhole or",
    ),
    (
        basalt(intrinsics=[{"camera_type": "ds", "intrinsics": EXPECTED | {"xi": 0}}]),
        None,
        "value0.intrinsics[0].intrinsics.alpha",
        "missing",
    ),
    (
        basalt(intrinsics=[{"camera_type": "ds", "intrinsics": EXPECTED | {"xi": 9, "alpha": 0}}]),
        None,
        "value0.intrinsics[0].intrinsics.xi (xi)",
        "from -1 to 1",
    ),
    (basalt(resolution=[[640, 480]]), "cam0", "value0.resolution", "expected 4 numbers, got 2"),
    (
        basalt(resolution=[[640, 480], [5, 0]]),
        "cam1",
        "value0.resolution[1]",
        "positive whole number",
    ),
    (OCAM.replace("5 -2.065", "4 -2.065"), None, "polynomial coefficients (direct)", "expected 4"),
    (
        OCAM.replace("-2.065e+02", "2.065e+02"),
        None,
        "polynomial coefficients (direct) (a0)",
        "negative",
    ),
    (OCAM.replace("1.002", "-1"), None, "affine parameters (c)", "greater than"),
    (OCAM.replace("241.75 318.25", "241.75"), None, "center", "expected 2 numbers, got 1"),
    (OCAM.replace("480 640\n", ""), None, "image size", "missing"),
    (OCAM.replace("480 640", "480 0"), None, "image size", "got 0"),
    (nerf(cx=None, w=None, h=None), None, "cx", "missing"),
    (nerf(fl_x=None), None, "fl_x", "missing"),
    (nerf(fl_x=-5), None, "fl_x (fx)", "positive"),
    (nerf(k4=0.1), None, "k4", "expected 0 for a pinhole"),
    (nerf(camera_model="LATTICE"), None, "camera_model", "'LATTICE'"),
    (nerf(h=None), None, "h", "missing"),
    (nerf(fl_x=None, camera_angle_x=1.0, w=None, h=None), None, "w", "camera_angle_x"),
    (DSO.replace("0.93", "-0.93"), None, "line 1 (omega)", "from 1e-06"),
    (DSO.replace("0.93", "0.93 1"), None, "line 1", "expected 5 numbers, got 6"),
    ("Lattice " + DSO, None, "line 1", "'lattice' is not supported; expected fov or"),
    (MEI.replace("MEI", "LATTICE"), None, "model_type", "'LATTICE'"),
    (MEI.replace("   xi: 1.25\n", "   chi: 1\n"), None, "mirror_parameters.xi", "missing"),
    (MEI.replace("gamma1: 500.5", "gamma1: 0"), None, "projection_parameters (fx)", "positive"),
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
