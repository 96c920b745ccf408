"""The files that commands and programs of the documentation name, small, with exact truth."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import av
import numpy as np
from bags_kit import Sent, header, image_message, info_message, write_bag
from cli_kit import CALIBRATION, CAMERA, encoded, write_video
from PIL import Image
from scipy.spatial.transform import Rotation

from farpoint.fusion.models import GRAVITY
from farpoint.synthetic import InertialPath, RenderedSequence, render_drive
from farpoint.trajectory.files import Trajectory
from markdown_blocks import ROOT

FRAMES, FPS = 12, 10
START_NS = 1_400_000_000 * 10**9
K = [180.0, 0.0, 119.5, 0.0, 180.0, 71.5, 0.0, 0.0, 1.0]

_EXIF_IFD, _FOCAL_LENGTH_35MM, _FOCAL_MM = 0x8769, 0xA405, 27
_QUICKTIME_FOCAL = "com.apple.quicktime.camera.focal_length.35mm_equivalent"

# World of the rendered street: x right, y down, z ahead. The world of an IMU has z up.
_UP_FROM_STREET = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_IMU_HZ, _AT_REST = 200, 200

# Camera 0 of TUM-VI, as Kalibr wrote it.
CAMCHAIN = """\
cam0:
  camera_model: pinhole
  distortion_coeffs: [0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202,
    0.00020293673591811182]
  distortion_model: equidistant
  intrinsics: [190.97847715128717, 190.9733070521226, 254.93170605935475, 256.8974428996504]
  resolution: [512, 512]
  rostopic: /cam0/image_raw
cam1:
  camera_model: pinhole
  distortion_coeffs: [0.0034003170790442797, 0.001766278153469831, -0.00266312569781606,
    0.0003299517423931039]
  distortion_model: equidistant
  intrinsics: [190.44236969414825, 190.4344384721956, 252.59949716835982, 254.91723064636983]
  resolution: [512, 512]
  rostopic: /cam1/image_raw
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """A rendered drive and its pictures."""

    sequence: RenderedSequence
    images: list[np.ndarray]

    @property
    def stamps_ns(self) -> list[int]:
        return [START_NS + 10**9 // FPS * number for number in range(len(self.images))]


def render() -> Drive:
    sequence = render_drive(CAMERA, frames=FRAMES, fps=FPS, seed=3)
    return Drive(sequence=sequence, images=[f.image for f in sequence if f.image is not None])


def write_page_files(folder: Path) -> Path:
    """All files, under the names that pages use."""
    drive = render()
    for name in ("camera.yaml", "calib.yaml"):
        (folder / name).write_text(CALIBRATION)
    (folder / "camchain.yaml").write_text(CAMCHAIN)
    for name in ("poses.txt", "groundtruth.txt"):
        drive.sequence.write_truth(folder / name)
    write_video(folder / "drive.mp4", drive.images, FPS)
    _write_phone_video(folder / "phone.mov", folder / "drive.mp4")
    _write_shots(folder / "shots", drive.images)
    _write_kitti(folder, drive)
    _write_euroc(folder / "mav0", drive)
    shutil.copytree(folder / "mav0", folder / "V1_01_easy" / "mav0")
    _write_speeds(folder / "wheels.csv", drive)
    _write_bag(folder, drive)
    shutil.copytree(ROOT / "examples", folder / "examples")
    return folder


def _write_phone_video(path: Path, source: Path) -> None:
    """The same video with the focal length among its metadata, as phones write it."""
    options = {"movflags": "use_metadata_tags"}
    with av.open(str(source)) as video, av.open(str(path), "w", options=options) as container:
        container.metadata.update({_QUICKTIME_FOCAL: str(_FOCAL_MM)})
        stream = video.streams.video[0]
        copied = container.add_stream_from_template(stream)
        for packet in video.demux(stream):
            if packet.dts is not None:
                packet.stream = copied
                container.mux(packet)


def _write_shots(folder: Path, images: list[np.ndarray]) -> None:
    """PNG files with the focal length in their EXIF."""
    folder.mkdir()
    exif = Image.Exif()
    exif.get_ifd(_EXIF_IFD)[_FOCAL_LENGTH_35MM] = _FOCAL_MM
    for number, image in enumerate(images):
        Image.fromarray(image).save(folder / f"{number:06d}.png", exif=exif.tobytes())


def _write_kitti(folder: Path, drive: Drive) -> None:
    sequence = folder / "sequences" / "00"
    (sequence / "image_0").mkdir(parents=True)
    for number, image in enumerate(drive.images):
        (sequence / "image_0" / f"{number:06d}.png").write_bytes(encoded(image))
    times = "".join(f"{time:.6e}\n" for time in drive.sequence.timestamps)
    (sequence / "times.txt").write_text(times)
    rows = "P0: 180 0 119.5 0 0 180 71.5 0 0 0 1 0\n"
    (sequence / "calib.txt").write_text(rows)
    (folder / "poses").mkdir()
    poses = drive.sequence.world_from_cam[:, :3].reshape(-1, 12)
    np.savetxt(folder / "poses" / "00.txt", poses, fmt="%.9e")


def _write_euroc(folder: Path, drive: Drive) -> None:
    """A camera, and an IMU whose axes are those of the camera."""
    (folder / "cam0" / "data").mkdir(parents=True)
    rows = ["#timestamp [ns],filename"]
    for stamp, image in zip(drive.stamps_ns, drive.images, strict=True):
        (folder / "cam0" / "data" / f"{stamp}.png").write_bytes(encoded(image))
        rows.append(f"{stamp},{stamp}.png")
    (folder / "cam0" / "data.csv").write_text("\n".join(rows) + "\n")
    mounting = ", ".join(f"{value}.0" for value in np.eye(4, dtype=int).ravel())
    t_bs = f"T_BS:\n  cols: 4\n  rows: 4\n  data: [{mounting}]\n"
    (folder / "cam0" / "sensor.yaml").write_text(CALIBRATION + t_bs)
    rows = ["#timestamp,p_RS_R_x,y,z,q_RS_w,x,y,z"]
    for stamp, pose in zip(drive.stamps_ns, drive.sequence.world_from_cam, strict=True):
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
        rows.append(",".join(map(str, (stamp, *pose[:3, 3], w, x, y, z))))
    (folder / "truth.csv").write_text("\n".join(rows) + "\n")
    (folder / "imu0").mkdir()
    gyro, accel = _measured_by_imu(drive)
    rows = ["#timestamp [ns],w_RS_S_x [rad s^-1],y,z,a_RS_S_x [m s^-2],y,z"]
    for number, values in enumerate(np.hstack([gyro, accel])):
        stamp = START_NS + 10**9 // _IMU_HZ * (number - _AT_REST)
        rows.append(",".join([str(stamp), *(f"{value:.9f}" for value in values)]))
    (folder / "imu0" / "data.csv").write_text("\n".join(rows) + "\n")


def _measured_by_imu(drive: Drive) -> tuple[np.ndarray, np.ndarray]:
    """Angular rates and specific forces: a second at rest, then those of the drive."""
    poses = drive.sequence.world_from_cam.copy()
    poses[:, :3] = _UP_FROM_STREET @ poses[:, :3]
    path = InertialPath(
        Trajectory(timestamps=drive.sequence.timestamps, world_from_body=poses), 1.0 / FPS
    )
    times = np.arange(round(path.duration_s * _IMU_HZ) + 1) / _IMU_HZ
    felt = path.measured(times)
    until_the_end = np.ones((2 * _IMU_HZ // FPS, 1))
    at_rest = np.tile(-(poses[0, :3, :3].T @ GRAVITY), (_AT_REST, 1))
    gyro = np.vstack([np.zeros((_AT_REST, 3)), felt.gyro, until_the_end * felt.gyro[-1]])
    return gyro, np.vstack([at_rest, felt.accel, until_the_end * felt.accel[-1]])


def _speeds(drive: Drive) -> np.ndarray:
    positions = drive.sequence.world_from_cam[:, :3, 3]
    return FPS * np.linalg.norm(np.diff(positions, axis=0), axis=1)


def _write_speeds(path: Path, drive: Drive) -> None:
    times = 0.5 * (drive.sequence.timestamps[:-1] + drive.sequence.timestamps[1:])
    rows = [f"{time:.3f},{speed:.6f}" for time, speed in zip(times, _speeds(drive), strict=True)]
    path.write_text("\n".join(["timestamp,speed", *rows]) + "\n")


def _write_bag(folder: Path, drive: Drive) -> None:
    """Images with their calibration, speeds of the wheels, and an IMU."""
    size = (drive.images[0].shape[1], drive.images[0].shape[0])
    sent = [info_message("/front/camera_info", size=size, k=K, d=[0.0] * 4)]
    for stamp, image in zip(drive.stamps_ns, drive.images, strict=True):
        sent.append(image_message(image, "mono8", stamp, topic="/front/image_raw"))
    half = 10**9 // FPS // 2
    for stamp, speed in zip(drive.stamps_ns, _speeds(drive), strict=False):
        sent.append(_odometry(stamp + half, speed))
    for number, (gyro, accel) in enumerate(zip(*_measured_by_imu(drive), strict=True)):
        sent.append(_imu(START_NS + 10**9 // _IMU_HZ * (number - _AT_REST), gyro, accel))
    sent = [replace(message, recorded_ns=_stamp_of(message)) for message in sent]
    write_bag(folder, "ros1", sorted(sent, key=lambda message: message.recorded_ns))


def _stamp_of(message: Sent) -> int:
    stamp = message.fields["header"]["stamp"]
    return stamp if stamp > START_NS // 2 else START_NS - 10**9


def _vector(values: np.ndarray | tuple[float, ...]) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))


def _odometry(stamp: int, speed: float) -> Sent:
    variances = np.zeros(36)
    variances[[0, 7, 14]] = 1e-4
    twist = {"linear": _vector((speed, 0.0, 0.0)), "angular": _vector((0.0, 0.0, 0.0))}
    pose = {"position": dict.fromkeys("xyz", 0.0), "orientation": dict.fromkeys("xyzw", 0.0)}
    fields: dict[str, Any] = {
        "header": header(stamp, "odom"),
        "child_frame_id": "base_link",
        "pose": {"pose": pose, "covariance": np.zeros(36)},
        "twist": {"twist": twist, "covariance": variances},
    }
    return Sent("/wheel_odometry", "nav_msgs/msg/Odometry", stamp, fields)


def _imu(stamp: int, gyro: np.ndarray, accel: np.ndarray) -> Sent:
    fields: dict[str, Any] = {
        "header": header(stamp, "imu"),
        "orientation": dict.fromkeys("xyzw", 0.0),
        "orientation_covariance": np.zeros(9),
        "angular_velocity": _vector(gyro),
        "angular_velocity_covariance": np.zeros(9),
        "linear_acceleration": _vector(accel),
        "linear_acceleration_covariance": np.zeros(9),
    }
    return Sent("/imu", "sensor_msgs/msg/Imu", stamp, fields)
