"""Small calibration files of one camera, as each tool would write it."""

from __future__ import annotations

import json

EXPECTED = {"fx": 500.5, "fy": 501.5, "cx": 320.25, "cy": 240.75}
D4 = (-0.3, 0.1, 0.001, -0.002)
KALIBR = """\
cam0:
  camera_model: {model}
  intrinsics: [{first}500.5, 501.5, 320.25, 240.75]
  distortion_model: {distortion}
  distortion_coeffs: {coefficients}
  resolution: [640, 480]
"""
OMNIDIR = """\
%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500.5, 0.4, 320.25, 0., 501.5, 240.75, 0., 0., 1. ]
distortion_coefficients: [-0.3, 0.1, 0.001, -0.002]
xi: 1.25
"""
COLMAP = """\
# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 2
1 OPENCV 640 480 500.5 501.5 320.75 241.25 -0.3 0.1 0.001 -0.002
7 SIMPLE_RADIAL 800 600 700 400 300 -0.05
"""
BASALT = {
    "value0": {
        "T_imu_cam": [],
        "intrinsics": [
            {"camera_type": "ds", "intrinsics": EXPECTED | {"xi": -0.2, "alpha": 0.6}},
            {"camera_type": "kb4", "intrinsics": EXPECTED | {"k1": 0, "k2": 0, "k3": 0, "k4": 0}},
        ],
        "resolution": [[640, 480], [512, 512]],
    }
}
OCAM = """\
#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). \
These are used by cam2world

5 -2.065e+02 0.000000e+00 2.2e-03 -4.9e-06 1.87e-08

#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). \
These are used by world2cam

4 294.2 152.3 -12.2 28.0

#center: "row" and "column", starting from 0 (C convention)

241.75 318.25

#affine parameters "c", "d", "e"

1.002 0.003 -0.002

#image size: "height" and "width"

480 640

"""
NERF = {
    "camera_model": "OPENCV",
    "fl_x": 500.5,
    "fl_y": 501.5,
    "cx": 320.75,
    "cy": 241.25,
    "w": 640,
    "h": 480,
    "k1": -0.3,
    "k2": 0.1,
    "p1": 0.001,
    "p2": -0.002,
    "frames": [{"file_path": "images/0.png", "transform_matrix": []}],
}
DSO = "0.5 0.625 0.25 0.75 0.93\n640 480\ncrop\n640 480\n"
MEI = """\
%YAML:1.0
---
model_type: MEI
camera_name: image_02
image_width: 640
image_height: 480
mirror_parameters:
   xi: 1.25
distortion_parameters:
   k1: -0.3
   k2: 0.1
   p1: 0.001
   p2: -0.002
projection_parameters:
   gamma1: 500.5
   gamma2: 501.5
   u0: 320.25
   v0: 240.75
"""
CAMODOCAL_FISHEYE = """\
model_type: KANNALA_BRANDT
image_width: 640
image_height: 480
projection_parameters: {k2: -0.3, k3: 0.1, k4: 0.001, k5: -0.002,
  mu: 500.5, mv: 501.5, u0: 320.25, v0: 240.75}
"""


def kalibr(model: str, first: str, distortion: str, coefficients: str) -> str:
    return KALIBR.format(model=model, first=first, distortion=distortion, coefficients=coefficients)


def nerf(**changes: object) -> str:
    values = NERF | changes
    return json.dumps({key: value for key, value in values.items() if value is not None})


def basalt(**changes: object) -> str:
    return json.dumps({"value0": BASALT["value0"] | changes})
