"""Small calibration files as SVO, RealSense, Metashape, mrcal and other tools lay them out."""

from __future__ import annotations

import io
import json

import numpy as np

from farpoint.camera import (
    Arctangent,
    CameraModel,
    Division,
    Equirectangular,
    KannalaBrandt,
    Pinhole,
    Scaramuzza,
    Unified,
)

EXPECTED = {"fx": 500.5, "fy": 501.5, "cx": 320.25, "cy": 240.75}
MATRIX = [[500.5, 0.0, 320.25], [0.0, 501.5, 240.75], [0.0, 0.0, 1.0]]
D4 = (-0.3, 0.1, 0.001, -0.002)
D5 = (*D4, 0.02)
D8 = (0.9, 0.2, 1e-3, -5e-4, 0.02, 1.2, 0.4, 0.05)
K4 = {"k1": -0.3, "k2": 0.1, "k3": 0.001, "k4": -0.002}
FISHEYE = KannalaBrandt(**EXPECTED, **K4)

STELLA = """\
Camera:
  name: "a hand-held camera"
  setup: "monocular"
  model: "perspective"
  fx: 500.5
  fy: 501.5
  cx: 320.25
  cy: 240.75
  k1: -0.3
  k2: 0.1
  p1: 0.001
  p2: -0.002
  k3: 0.02
  fps: 30.0
  cols: 640
  rows: 480
  color_order: "RGB"
Feature:
  scale_factor: 1.2
  num_levels: 8
"""
OPENVSLAM_FISHEYE = """\
# Camera
Camera.name: "a fisheye"
Camera.setup: "monocular"
Camera.model: "fisheye"
Camera.fx: 500.5
Camera.fy: 501.5
Camera.cx: 320.25
Camera.cy: 240.75
Camera.k1: -0.3
Camera.k2: 0.1
Camera.k3: 0.001
Camera.k4: -0.002
Camera.fps: 30.0
Camera.cols: 640
Camera.rows: 480
Camera.color_order: "RGB"
Feature.max_num_keypoints: 1000
"""
STELLA_SPHERE = """\
Camera:
  name: "a 360-degree camera"
  setup: "monocular"
  model: "equirectangular"
  fps: 30.0
  cols: 640
  rows: 320
  color_order: "RGB"
"""
STELLA_DIVISION = STELLA.replace("perspective", "radial_division").replace(
    "  k1: -0.3\n  k2: 0.1\n  p1: 0.001\n  p2: -0.002\n  k3: 0.02\n", "  distortion: -0.1\n"
)
SVO = """\
label: "a rig"
id: 412eab8e40
cameras:
- camera:
    label: cam0
    id: 54812562fa
    line-delay-nanoseconds: 0
    image_height: 480
    image_width: 640
    type: pinhole
    intrinsics:
      cols: 1
      rows: 4
      data: [500.5, 501.5, 320.25, 240.75]
    distortion:
      type: radial-tangential
      parameters:
        cols: 1
        rows: 4
        data: [-0.3, 0.1, 0.001, -0.002]
  T_B_C:
    cols: 4
    rows: 4
    data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
- camera:
    label: right
    image_height: 480
    image_width: 640
    type: pinhole
    intrinsics: {cols: 1, rows: 4, data: [500.5, 501.5, 320.25, 240.75]}
    distortion:
      type: fisheye
      parameters: {cols: 1, rows: 1, data: [0.93]}
imu_params:
  omega_max: 17
"""
SVO_EQUIDISTANT = SVO.replace("radial-tangential", "equidistant")
SVO_OMNI = """\
label: cam0
image_height: 480
image_width: 640
type: omni
intrinsics:
  cols: 1
  rows: 24
  data: [-206.5, 0.0, 2.2e-3, -4.9e-6, 1.87e-8, 318.25, 241.75, 1.002, 0.003, -0.002,
         294.2, 152.3, -12.2, 28.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
distortion:
  type: none
  parameters: {cols: 1, rows: 0, data: []}
mask: test_mask.png
"""
VIKIT = """\
cam_model: Pinhole
cam_width: 640
cam_height: 480
scale: 0.5
cam_fx: 500.5
cam_fy: 501.5
cam_cx: 320.25
cam_cy: 240.75
cam_d0: -0.3
cam_d1: 0.1
cam_d2: 0.001
cam_d3: -0.002
"""
VIKIT_ATAN = """\
cam_model: ATAN
cam_width: 640
cam_height: 480
cam_fx: 0.5
cam_fy: 0.625
cam_cx: 0.25
cam_cy: 0.75
cam_d0: 0.93
"""
VIKIT_GROUP = """\
cam0:
  cam_model: PinholeEquidistant
  cam_width: 640
  cam_height: 480
  cam_fx: 500.5
  cam_fy: 501.5
  cam_cx: 320.25
  cam_cy: 240.75
  cam_d0: -0.3
  cam_d1: 0.1
  cam_d2: 0.001
  cam_d3: -0.002
  T_cam_body: {tx: 0.0, ty: 0.0, tz: 0.0, qx: 0.0, qy: 0.0, qz: 0.0, qw: 1.0}
"""
VIKIT_ROS2 = """\
/**:
  ros__parameters:
    camera:
      model: Pinhole
      width: 640
      height: 480
      scale: 0.5
      fx: 500.5
      fy: 501.5
      cx: 320.25
      cy: 240.75
      d0: -0.3
      d1: 0.1
      d2: 0.001
      d3: -0.002
"""
VIKIT_EQUIDISTANT = """\
cam_model: EquidistantCamera
cam_width: 640
cam_height: 480
scale: 1.0
cam_fx: 500.5
cam_fy: 501.5
cam_cx: 320.25
cam_cy: 240.75
k1: -0.3
k2: 0.1
k3: 0.001
k4: -0.002
"""
REALSENSE_LISTING = """\
Device info:
    Name                          :     Intel RealSense D435I
    Serial Number                 :     000000000000

 Intrinsic of "Depth" / 848x480 / {Z16}
  Width:      \t848
  Height:     \t480
  PPX:        \t420.5
  PPY:        \t238.25
  Fx:         \t424.5
  Fy:         \t424.5
  Distortion: \tBrown Conrady
  Coeffs:     \t0  \t0  \t0  \t0  \t0
  FOV (deg):  \t90.1 x 59

 Intrinsic of "Color" / 640x480 / {YUYV/RGB8/BGR8/RGBA8/BGRA8/Y8}
  Width:      \t640
  Height:     \t480
  PPX:        \t320.25
  PPY:        \t240.75
  Fx:         \t500.5
  Fy:         \t501.5
  Distortion: \tBrown Conrady
  Coeffs:     \t-0.3  \t0.1  \t0.001  \t-0.002  \t0.02
  FOV (deg):  \t65.2 x 51.2

Motion Intrinsic Parameters:
Bias Variances:   0.0  0.0  0.0

Extrinsic from "Depth"\t  To\t  "Color" :
 Rotation Matrix:
   0.999749        -0.021599        -0.00590855
"""
REALSENSE_PRINTED = (
    "[ 640x480  p[320.25 240.75]  f[500.5 501.5]  Brown Conrady [-0.3 0.1 0.001 -0.002 0.02] ]\n"
)
REALSENSE_PRINTED_OLD = (
    "width: 640, height: 480, ppx: 320.25, ppy: 240.75, fx: 500.5, fy: 501.5, "
    "model: Brown Conrady, coeffs: [-0.3, 0.1, 0.001, -0.002, 0.02]\n"
)
REALSENSE = {
    **{"width": 640, "height": 480, "ppx": 320.25, "ppy": 240.75, "fx": 500.5, "fy": 501.5},
    "model": "distortion.brown_conrady",
    "coeffs": list(D5),
}
ZED = """\
[LEFT_CAM_HD]
fx=500.5
fy=501.5
cx=320.25
cy=240.75
k1=-0.3
k2=0.1
p1=0.001
p2=-0.002
k3=0.02

[RIGHT_CAM_HD]
fx=600
fy=601
cx=300
cy=200
k1=0
k2=0

[STEREO]
Baseline=120.009
CV_HD=0.01
RX_HD=0.002
"""
ZED_X = """\
[LEFT_CAM_FHD1200]
fx = 500.5
fy = 501.5
cx = 320.25
cy = 240.75

[LEFT_DISTO]
k1 = 0.9
k2 = 0.2
p1 = 0.001
p2 = -0.0005
k3 = 0.02
k4 = 1.2
k5 = 0.4
k6 = 0.05

[MISC]
Sensor_ID = 1
"""
ZED_FISHEYE = """\
[CAM_4k]
fx = 500.5
fy = 501.5
cx = 320.25
cy = 240.75

[DISTO]
k1 = -0.3
k2 = 0.1
k3 = 0.001
k4 = -0.002
k5 = 0
k6 = 0
p1 = 0
p2 = 0
"""
DEPTHAI = {
    "batchName": "",
    "boardName": "DM9098",
    "cameraData": [
        [
            0,
            {
                "cameraType": 0,
                "distortionCoeff": [*D8, 0.0, 0.0, 0.0, 0.0, 0.001, 0.002],
                "extrinsics": {"rotationMatrix": [], "toCameraSocket": 1},
                "height": 480,
                "intrinsicMatrix": MATRIX,
                "lensPosition": 135,
                "specHfovDeg": 68.7,
                "width": 640,
            },
        ],
        [
            1,
            {
                "cameraType": 1,
                "distortionCoeff": [*K4.values(), *[0.0] * 10],
                "height": 480,
                "intrinsicMatrix": MATRIX,
                "width": 640,
            },
        ],
    ],
    "imuExtrinsics": {"toCameraSocket": -1},
    "stereoRectificationData": {"leftCameraSocket": 1},
    "version": 7,
}
COLUMNS = [500.5, 0.0, 0.0, 0.0, 501.5, 0.0, 320.25, 240.75, 1.0]
CORNER_COLUMNS = [500.5, 0.0, 0.0, 0.0, 501.5, 0.0, 320.75, 241.25, 1.0]
OPEN3D = {"height": 480, "intrinsic_matrix": COLUMNS, "width": 640}
OPEN3D_PARAMETERS = {
    "class_name": "PinholeCameraParameters",
    "extrinsic": [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
    "intrinsic": OPEN3D,
    "version_major": 1,
    "version_minor": 0,
}
OPEN3D_TRAJECTORY = {
    "class_name": "PinholeCameraTrajectory",
    "parameters": [OPEN3D_PARAMETERS, OPEN3D_PARAMETERS],
}
RECORD3D = {
    **{"K": CORNER_COLUMNS, "w": 640, "h": 480, "fps": 30, "dw": 192, "dh": 256},
    "poses": [[0, 0, 0, 1, 0, 0, 0]],
    "perFrameIntrinsicCoeffs": [[500.5, 501.5, 320.75, 241.25]],
    "cameraType": 1,
}
ARKIT = {
    "intrinsics": [CORNER_COLUMNS[:3], CORNER_COLUMNS[3:6], CORNER_COLUMNS[6:]],
    "imageResolution": [640, 480],
    "transform": [1.0] * 16,
}
METASHAPE = """\
<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>frame</projection>
  <width>640</width>
  <height>480</height>
  <f>501.5</f>
  <cx>0.75</cx>
  <cy>1.25</cy>
  <b1>-1</b1>
  <k1>-0.3</k1>
  <k2>0.1</k2>
  <k3>0.02</k3>
  <p1>-0.002</p1>
  <p2>0.001</p2>
  <date>2026-01-02T03:04:05Z</date>
</calibration>
"""
METASHAPE_FISHEYE = (
    METASHAPE.replace("frame", "fisheye")
    .replace("  <p1>-0.002</p1>\n  <p2>0.001</p2>\n", "  <k4>-0.002</k4>\n")
    .replace("<k3>0.02", "<k3>0.001")
)
METASHAPE_SPHERE = """\
<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>spherical</projection>
  <width>640</width>
  <height>320</height>
  <f>101.859163579</f>
</calibration>
"""
BROWN = {
    **{"projection_type": "brown", "width": 640, "height": 480},
    **{"focal_x": 500.5 / 640, "focal_y": 501.5 / 640},
    **{"c_x": (320.25 - 319.5) / 640, "c_y": (240.75 - 239.5) / 640},
    **{"k1": -0.3, "k2": 0.1, "p1": 0.001, "p2": -0.002, "k3": 0.02},
}
OPENSFM = {
    "v2 maker model 640 480 brown 0.78": BROWN,
    "perspective": {
        **{"projection_type": "perspective", "width": 480, "height": 640},
        **{"focal": 0.75, "k1": -0.3, "k2": 0.1},
    },
    "fisheye": {
        **{"projection_type": "fisheye", "width": 640, "height": 480},
        **{"focal": 0.75, "k1": -0.3, "k2": 0.1},
    },
    "fisheye_opencv": {
        **{key: value for key, value in BROWN.items() if key[0] != "p" and key[0] != "k"},
        **{"projection_type": "fisheye_opencv", **K4},
    },
    "sphere": {"projection_type": "spherical", "width": 640, "height": 320},
}
GYROFLOW = {
    "name": "A maker_A camera_wide",
    "camera_brand": "A maker",
    "camera_model": "A camera",
    "lens_model": "wide",
    "calib_dimension": {"w": 640, "h": 480},
    "orig_dimension": {"w": 640, "h": 480},
    "output_dimension": None,
    "frame_readout_time": 12.5,
    "input_horizontal_stretch": 1.0,
    "input_vertical_stretch": 1.0,
    "num_images": 15,
    "fps": 29.97,
    "crop": None,
    "official": False,
    "asymmetrical": False,
    "fisheye_params": {
        "RMS_error": 0.8,
        "camera_matrix": MATRIX,
        "distortion_coeffs": list(K4.values()),
        "radial_distortion_limit": None,
    },
    "identifier": "a-b-c",
    "calibrator_version": "1.5.4",
    "distortion_model": "opencv_fisheye",
    "digital_lens": None,
    "digital_lens_params": None,
    "interpolations": None,
    "compatible_settings": [],
}
MRCAL = """\
# generated on 2026-01-02 with mrcal-convert-lensmodel # and a note
{
    'lensmodel':  'LENSMODEL_OPENCV8',

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ 500.5, 501.5, 320.25, 240.75,
                    0.9, 0.2, 1e-3, -5e-4, 0.02, 1.2, 0.4, 0.05,],
    'valid_intrinsics_region': [
    [ 0, 0 ],
    [ 639, 479 ], ],

    # extrinsics are rt_fromref
    'extrinsics': [ 0., 0, 0, 0, 0, 0, ],
    'imagersize': [ 640, 480 ],
    'icam_intrinsics': 0,
    'optimization_inputs': b'P)h>@6aWAK2mnm{4RL#pLKy%G0ssI200{s9002TtO>#qW',
}
"""
MC_CALIB = """\
%YAML:1.0
---
nb_camera: 2
camera_0:
   camera_matrix: !!opencv-matrix
      rows: 3
      cols: 3
      dt: d
      data: [ 500.5, 0., 320.25, 0., 501.5, 240.75, 0., 0., 1. ]
   distortion_vector: !!opencv-matrix
      rows: 1
      cols: 5
      dt: d
      data: [ -0.3, 0.1, 0.001, -0.002, 0.02 ]
   distortion_type: 0
   camera_group: 0
   img_width: 640
   img_height: 480
   camera_pose_matrix: !!opencv-matrix
      rows: 1
      cols: 1
      dt: d
      data: [ 1. ]
camera_1:
   camera_matrix: !!opencv-matrix
      rows: 3
      cols: 3
      dt: d
      data: [ 500.5, 0., 320.25, 0., 501.5, 240.75, 0., 0., 1. ]
   distortion_vector: !!opencv-matrix
      rows: 1
      cols: 4
      dt: d
      data: [ -0.3, 0.1, 0.001, -0.002 ]
   distortion_type: 1
   camera_group: 0
   img_width: 640
   img_height: 480
"""
AUTOWARE = """\
%YAML:1.0
---
CameraExtrinsicMat: !!opencv-matrix
   rows: 1
   cols: 1
   dt: d
   data: [ 1. ]
CameraMat: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500.5, 0., 320.25, 0., 501.5, 240.75, 0., 0., 1. ]
DistCoeff: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.3, 0.1, 0.001, -0.002, 0.02 ]
ImageSize: [640, 480]
Reprojection Error: 0.0
DistModel: plumb_bob
"""
OST = """\
# oST version 5.0 parameters


[image]

width
640

height
480

[narrow_stereo]

camera matrix
500.500000 0.000000 320.250000
0.000000 501.500000 240.750000
0.000000 0.000000 1.000000

distortion
-0.300000 0.100000 0.001000 -0.002000 0.020000

rectification
1.000000 0.000000 0.000000
0.000000 1.000000 0.000000
0.000000 0.000000 1.000000

projection
480.000000 0.000000 321.000000 0.000000
0.000000 480.000000 241.000000 0.000000
0.000000 0.000000 1.000000 0.000000

"""


def npz(**arrays: object) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # pyright: ignore[reportArgumentType]
    return stream.getvalue()


NPZ = npz(
    ret=0.31,
    mtx=np.array(MATRIX),
    dist=np.array([D5]),
    rvecs=np.zeros((2, 3, 1)),
    tvecs=np.zeros((2, 3, 1)),
    image_size=np.array([640, 480]),
)
BOUGUET = """\
%-- Focal length:
fc = [ 500.500000000000000 ; 501.500000000000000 ];

%-- Principal point:
cc = [ 320.250000000000000 ; 240.750000000000000 ];

%-- Skew coefficient:
alpha_c = 0.000000000000000;

%-- Distortion coefficients:
kc = [ -0.300000000 ; 0.100000000 ; 0.001000000 ; -0.002000000 ; 0.020000000 ];

%-- Focal length uncertainty:
fc_error = [ 0.300000000000000 ; 0.600000000000000 ];
cc_error = [ 0.900000000000000 ; 1.200000000000000 ];
alpha_c_error = 0.000000000000000;
kc_error = [ 0.003000000 ; 0.030000000 ; 0.000300000 ; 0.000600000 ; 0.000000000000000 ];

%-- Image size:
nx = 640;
ny = 480;

%-- Various other variables (may be ignored if you do not use the Matlab Calibration Toolbox):
n_ima = 2;						% Number of calibration images
est_dist = [ 1 ; 1 ; 1 ; 1 ; 0 ];

%-- Image #1:
omc_1 = [ 2.007e+00 ; 1.98e+00 ; -2.0e-01 ];
Tc_1  = [ -1.43e+02 ; -1.23e+02 ; 5.86e+02 ];
"""
BOUGUET_STEREO = """\
%-- Intrinsic parameters of left camera:
fc_left = [ 500.5 ; 501.5 ]; cc_left = [ 1 ; 2 ];
cc_left = [ 320.25 ; 240.75 ];
alpha_c_left = [ 0.0 ];
kc_left = [ -0.3 ; 0.1 ; 0.001 ; -0.002 ; 0.02 ];

%-- Intrinsic parameters of right camera:
fc_right = [ 600 ; 600 ];
cc_right = [ 320 ; 240 ];
kc_right = [ -0.29 ; 0.1 ; 0 ; 0 ; 0 ];
om = [ 0.007 ; 0.005 ; -0.003 ];
""".replace(" cc_left = [ 1 ; 2 ];", "")
BOOFCV = """\
# Pinhole camera model with radial and tangential distortion
model: pinhole_radial_tangential
version: 0
pinhole:
  width: 640
  height: 480
  fx: 500.5
  fy: 501.5
  skew: 0.0
  cx: 320.25
  cy: 240.75
radial_tangential:
  radial:
  - -0.3
  - 0.1
  t1: 0.001
  t2: -0.002
"""
BOOFCV_OMNI = (
    BOOFCV.replace("pinhole_radial_tangential", "omnidirectional_universal")
    + "mirror_offset: 1.5\n"
)
BOOFCV_STEREO = {
    "model": "stereo_camera",
    "left": {
        "model": "pinhole_radial_tangential",
        "pinhole": {**EXPECTED, "skew": 0.0, "width": 640, "height": 480},
        "radial_tangential": {"radial": [-0.3, 0.1, 0.02], "t1": 0.001, "t2": -0.002},
    },
    "right": {
        "model": "pinhole",
        "pinhole": {**EXPECTED, "fx": 600.0, "skew": 0.0, "width": 640, "height": 480},
    },
}
BY_NAME = {**EXPECTED, "width": 640, "height": 480, "dist": D5}
LISTED = {"cameras": [{"name": "front", "K": MATRIX, "D": D4}, BY_NAME]}
RADTAN4 = Pinhole(**EXPECTED, distortion=D4)
RADTAN5 = Pinhole(**EXPECTED, distortion=D5)
RADTAN8 = Pinhole(**EXPECTED, distortion=D8)
OMNI = Scaramuzza(
    coefficients=(-206.5, 0.0, 2.2e-3, -4.9e-6, 1.87e-8),
    **{"cx": 318.25, "cy": 241.75, "c": 1.002, "d": 0.003, "e": -0.002},
)
SPHERE = Equirectangular(width=640, height=320)
SQUARE = {"fx": 480, "fy": 480, "cx": 319.5, "cy": 239.5}

# For each: text or bytes, the camera's name, the format's title, its lens and size.
SAMPLES: dict[str, tuple[str | bytes, str | None, str, CameraModel, tuple[int, int] | None]] = {
    "stella": (STELLA, None, "stella_vslam settings", RADTAN5, (640, 480)),
    "openvslam": (OPENVSLAM_FISHEYE, None, "stella_vslam settings", FISHEYE, (640, 480)),
    "stella sphere": (STELLA_SPHERE, None, "stella_vslam settings", SPHERE, (640, 320)),
    "stella division": (
        *(STELLA_DIVISION, None, "stella_vslam settings"),
        *(Division(**EXPECTED, k=-0.1), (640, 480)),
    ),
    "svo": (SVO, "cam0", "SVO Pro cameras", RADTAN4, (640, 480)),
    "svo atan": (
        *(SVO, "right", "SVO Pro cameras"),
        *(Arctangent(**EXPECTED, omega=0.93), (640, 480)),
    ),
    "svo equidistant": (SVO_EQUIDISTANT, "cam0", "SVO Pro cameras", FISHEYE, (640, 480)),
    "svo omni": (SVO_OMNI, None, "SVO Pro cameras", OMNI, (640, 480)),
    "vikit": (
        *(VIKIT, None, "rpg_vikit camera"),
        *(Pinhole(**EXPECTED, distortion=(*D4, 0.0)), (640, 480)),
    ),
    "vikit atan": (
        *(VIKIT_ATAN, None, "rpg_vikit camera"),
        *(Arctangent(fx=320, fy=300, cx=159.5, cy=359.5, omega=0.93), (640, 480)),
    ),
    "vikit ros 2": (
        *(VIKIT_ROS2, "camera", "rpg_vikit camera"),
        *(Pinhole(**EXPECTED, distortion=(*D4, 0.0)), (640, 480)),
    ),
    "vikit equidistant": (VIKIT_EQUIDISTANT, None, "rpg_vikit camera", FISHEYE, (640, 480)),
    "vikit group": (VIKIT_GROUP, "cam0", "rpg_vikit camera", FISHEYE, (640, 480)),
    "realsense listing": (
        *(REALSENSE_LISTING, "Color 640x480", "RealSense intrinsics", RADTAN5, (640, 480)),
    ),
    "realsense depth": (
        *(REALSENSE_LISTING, "Depth 848x480", "RealSense intrinsics"),
        *(Pinhole(fx=424.5, fy=424.5, cx=420.5, cy=238.25), (848, 480)),
    ),
    "realsense printed": (*(REALSENSE_PRINTED, None, "RealSense intrinsics", RADTAN5, (640, 480)),),
    "realsense printed twice": (
        *(f"depth {REALSENSE_PRINTED.replace('500.5', '400')}\ncolor {REALSENSE_PRINTED}", "2"),
        *("RealSense intrinsics", RADTAN5, (640, 480)),
    ),
    "realsense printed, old": (
        *(REALSENSE_PRINTED_OLD, None, "RealSense intrinsics", RADTAN5, (640, 480)),
    ),
    "realsense json": (
        *(json.dumps(REALSENSE), None, "RealSense intrinsics", RADTAN5, (640, 480)),
    ),
    "realsense two": (
        *(json.dumps({"color": REALSENSE, "depth": REALSENSE}), "depth"),
        *("RealSense intrinsics", RADTAN5, (640, 480)),
    ),
    "zed": (ZED, "LEFT_CAM_HD", "ZED configuration", RADTAN5, (1280, 720)),
    "zed x": (ZED_X, "LEFT_CAM_FHD1200", "ZED configuration", RADTAN8, (1920, 1200)),
    "zed fisheye": (ZED_FISHEYE, None, "ZED configuration", FISHEYE, (3840, 2160)),
    "depthai": (
        *(json.dumps(DEPTHAI), "CAM_A", "DepthAI calibration"),
        *(Pinhole(**EXPECTED, distortion=(*D8, 0, 0, 0, 0, 0.001, 0.002)), (640, 480)),
    ),
    "depthai fisheye": (
        *(json.dumps(DEPTHAI), "CAM_B", "DepthAI calibration", FISHEYE, (640, 480)),
    ),
    **{
        name: (
            *(json.dumps(values), None, "Open3D or ARKit intrinsics"),
            *(Pinhole(**EXPECTED), (640, 480)),
        )
        for name, values in {
            "open3d": OPEN3D,
            "open3d parameters": OPEN3D_PARAMETERS,
            "open3d trajectory": OPEN3D_TRAJECTORY,
            "record3d": RECORD3D,
            "arkit": ARKIT,
        }.items()
    },
    "metashape": (METASHAPE, None, "Metashape calibration", RADTAN5, (640, 480)),
    "metashape fisheye": (
        *(METASHAPE_FISHEYE, None, "Metashape calibration", FISHEYE, (640, 480)),
    ),
    "metashape sphere": (METASHAPE_SPHERE, None, "Metashape calibration", SPHERE, (640, 320)),
    "opensfm": (
        *(json.dumps(OPENSFM), "v2 maker model 640 480 brown 0.78", "OpenSfM camera models"),
        *(RADTAN5, (640, 480)),
    ),
    "opensfm perspective": (
        *(json.dumps(OPENSFM), "perspective", "OpenSfM camera models"),
        Pinhole(fx=480, fy=480, cx=239.5, cy=319.5, distortion=(-0.3, 0.1, 0, 0, 0)),
        (480, 640),
    ),
    "opensfm fisheye": (
        *(json.dumps(OPENSFM), "fisheye", "OpenSfM camera models"),
        *(KannalaBrandt(**SQUARE, k1=-0.3, k2=0.1), (640, 480)),
    ),
    "opensfm fisheye_opencv": (
        *(json.dumps(OPENSFM), "fisheye_opencv", "OpenSfM camera models"),
        *(FISHEYE, (640, 480)),
    ),
    "opensfm sphere": (
        *(json.dumps(OPENSFM), "sphere", "OpenSfM camera models", SPHERE, (640, 320)),
    ),
    "gyroflow": (json.dumps(GYROFLOW), None, "Gyroflow lens profile", FISHEYE, (640, 480)),
    "mrcal": (MRCAL, None, "mrcal camera model", RADTAN8, (640, 480)),
    "mrcal stereographic": (
        MRCAL.replace("OPENCV8", "STEREOGRAPHIC").replace(
            "0.9, 0.2, 1e-3, -5e-4, 0.02, 1.2, 0.4, 0.05,", ""
        ),
        *(None, "mrcal camera model"),
        *(Unified(fx=1001, fy=1003, cx=320.25, cy=240.75, xi=1.0), (640, 480)),
    ),
    "mc-calib": (MC_CALIB, "camera_0", "MC-Calib cameras", RADTAN5, (640, 480)),
    "mc-calib fisheye": (MC_CALIB, "camera_1", "MC-Calib cameras", FISHEYE, (640, 480)),
    "autoware": (AUTOWARE, None, "Autoware calibration", RADTAN5, (640, 480)),
    "ost": (OST, None, "ROS ost.txt", RADTAN5, (640, 480)),
    "bouguet": (BOUGUET, None, "Bouguet's calibration toolbox", RADTAN5, (640, 480)),
    "bouguet stereo": (BOUGUET_STEREO, None, "Bouguet's calibration toolbox", RADTAN5, None),
    "bouguet json": (
        json.dumps({"fc": [500.5, 501.5], "cc": [320.25, 240.75], "kc": [[k] for k in D5]}),
        *(None, "Bouguet's calibration toolbox", RADTAN5, None),
    ),
    "boofcv": (BOOFCV, None, "BoofCV calibration", RADTAN4, (640, 480)),
    "boofcv omni": (
        *(BOOFCV_OMNI, None, "BoofCV calibration"),
        *(Unified(**EXPECTED, xi=1.5, distortion=D4), (640, 480)),
    ),
    "boofcv stereo": (
        *(json.dumps(BOOFCV_STEREO), None, "BoofCV calibration", RADTAN5, (640, 480)),
    ),
    "boofcv depth": (
        json.dumps({"model": "visual_depth", "max_depth": 9, "intrinsic": BOOFCV_STEREO["left"]}),
        *(None, "BoofCV calibration", RADTAN5, (640, 480)),
    ),
    "by name": (json.dumps(BY_NAME), None, "OpenCV camera matrix", RADTAN5, (640, 480)),
    "by name, in a group": (
        json.dumps({"intrinsics": EXPECTED, "distortion": D5, "resolution": [640, 480]}),
        *(None, "OpenCV camera matrix", RADTAN5, (640, 480)),
    ),
    "by name, all in a group": (
        json.dumps(
            {"intrinsics": {**EXPECTED, **dict(zip(("k1", "k2", "p1", "p2"), D4, strict=True))}}
        ),
        *(None, "OpenCV camera matrix", RADTAN4, None),
    ),
    "by name, fisheye": (
        json.dumps({**EXPECTED, **K4, "distortion_model": "equidistant"}),
        *(None, "OpenCV camera matrix", FISHEYE, None),
    ),
    "listed": (json.dumps(LISTED), "front", "OpenCV camera matrix", RADTAN4, None),
    "listed, unnamed": (
        *(json.dumps(LISTED), "cam1", "OpenCV camera matrix", RADTAN5, (640, 480)),
    ),
    "npz": (NPZ, None, "OpenCV camera matrix", RADTAN5, (640, 480)),
}


def changed(values: dict[str, object], **changes: object) -> str:
    """JSON of a sample with other values for some keys; None takes a key out."""
    merged = values | changes
    return json.dumps({key: value for key, value in merged.items() if value is not None})
