"""Rendered streets through a video codec: regions of poses hold the truth there, too."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest

from farpoint import Camera, Odometry, OdometryOptions, PoseStatus, RelativePoseOptions
from farpoint.metrics.statistics import chi2_quantile
from farpoint.synthetic import RenderedSequence, render_drive

av = pytest.importorskip("av")

# With a known shutter, of which the covariances contain nothing.
CAMERA = Camera.pinhole(480, 360, 300, 300, 239.5, 179.5).with_readout(0.0)
FRAMES, FPS = 16, 30


def through_h264(images: list[np.ndarray], crf: int) -> list[np.ndarray]:
    height, width = images[0].shape
    memory = io.BytesIO()
    with av.open(memory, "w", format="mp4") as out:
        stream = out.add_stream("libx264", rate=FPS)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        # Deterministic: with its assembler, x264 makes other films of the same pictures.
        exact = "threads=1:lookahead-threads=1:asm=0"
        stream.options = {"crf": str(crf), "x264-params": exact}
        for image in images:
            frame = av.VideoFrame.from_ndarray(image, format="gray")
            out.mux(stream.encode(frame.reformat(format="yuv420p")))
        out.mux(stream.encode())
    memory.seek(0)
    with av.open(memory) as video:
        return [frame.to_ndarray(format="gray") for frame in video.decode(video=0)]


def squared_errors_and_sigmas(
    drive: RenderedSequence, images: list[np.ndarray], options: OdometryOptions
) -> tuple[list[float], list[float]]:
    """Normalised squared errors of the poses, of 5 degrees of freedom, and their first sigmas."""
    odometry = Odometry(CAMERA, options)
    squares, sigmas = [], []
    for k, image in enumerate(images):
        pose = odometry.process(image, k / FPS).pose
        if pose is None or pose.status is not PoseStatus.OK:
            continue
        true = drive.cam1_from_cam0(k - 1, k)
        turn = true[:3, :3] @ pose.rotation_cam1_from_cam0.T
        dtheta = 0.5 * np.array(
            [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
        dbeta = pose.direction_basis.T @ true[:3, 3] / (true[:3, 3] @ pose.direction_cam1_from_cam0)
        error = np.r_[dtheta, dbeta]
        squares.append(float(error @ np.linalg.solve(pose.covariance, error)))
        sigmas.append(float(np.sqrt(pose.covariance[0, 0])))
    return squares, sigmas


def test_regions_hold_the_truth_of_h264_and_are_as_narrow_as_before_without_it():
    given = OdometryOptions()
    without = replace(given, pose=replace(given.pose, common_error_slope=0.0))
    within: dict[str, list[bool]] = {"given": [], "without": []}
    ratios: list[float] = []
    bound = chi2_quantile(0.95, 5)
    for seed in (61, 62, 63):
        drive = render_drive(CAMERA, frames=FRAMES, fps=FPS, seed=seed)
        images = [frame.image for frame in drive]
        compressed = through_h264(images, 23)
        for name, options in (("given", given), ("without", without)):
            squares, _ = squared_errors_and_sigmas(drive, compressed, options)
            within[name] += [square < bound for square in squares]
        wide, narrow = (squared_errors_and_sigmas(drive, images, o)[1] for o in (given, without))
        ratios.append(float(np.mean(wide) / np.mean(narrow)))
    assert len(within["given"]) > 40
    assert np.mean(within["without"]) < 0.7
    assert np.mean(within["given"]) > 0.8
    assert np.mean(ratios) < 1.1


def test_a_slope_below_zero_is_refused():
    with pytest.raises(ValueError, match="common_error_slope"):
        RelativePoseOptions(common_error_slope=-1.0)
