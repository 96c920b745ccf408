"""A real pair of fisheye images, matched like photographs, against the rig's calibration."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from farpoint import PoseStatus, estimate_relative_pose, load_camera
from farpoint.geometry import so3, sphere


def sift_matches(image0: np.ndarray, image1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) of mutual nearest neighbours that pass Lowe's test."""
    sift = cv2.SIFT.create(3000)
    (keys0, found0), (keys1, found1) = (
        sift.detectAndCompute(image, None) for image in (image0, image1)
    )
    forth = cv2.BFMatcher().knnMatch(found0, found1, k=2)
    back = {match.queryIdx: match.trainIdx for match in cv2.BFMatcher().match(found1, found0)}
    good = [
        first
        for first, second in forth
        if first.distance < 0.8 * second.distance and back[first.trainIdx] == first.queryIdx
    ]
    return (
        np.array([keys0[match.queryIdx].pt for match in good]),
        np.array([keys1[match.trainIdx].pt for match in good]),
    )


def body_from_cam(calibration: Path) -> np.ndarray:
    text = calibration.read_text().split("\n", 1)[1]
    return np.array(yaml.safe_load(text)["T_BS"]["data"], float).reshape(4, 4)


@pytest.mark.parametrize("reverse", [False, True], ids=["left to right", "right to left"])
def test_a_fisheye_rig_is_found_as_it_was_calibrated(shared_data: Path, reverse: bool):
    folder = shared_data / "kimera_fisheye_pair"
    sides = ("right", "left") if reverse else ("left", "right")
    files = [folder / "calib" / f"{side}_sensor_fisheye.yaml" for side in sides]
    cameras = [load_camera(file) for file in files]
    images = [
        cv2.imread(str(folder / "images" / f"{side}_fisheye_img_0.png"), cv2.IMREAD_GRAYSCALE)
        for side in sides
    ]
    points0, points1 = sift_matches(*images)
    assert len(points0) > 500
    pose = estimate_relative_pose(points0, points1, *cameras)
    poses = [body_from_cam(file) for file in files]
    truth = np.linalg.inv(poses[1]) @ poses[0]
    assert pose.status is PoseStatus.OK
    turn = so3.angle_between(pose.rotation_cam1_from_cam0, truth[:3, :3])
    off = sphere.angle_between(pose.direction_cam1_from_cam0, sphere.normalize(truth[:3, 3]))
    assert math.degrees(turn) < 0.1
    assert math.degrees(off) < 1.0
