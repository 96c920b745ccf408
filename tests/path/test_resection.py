"""The pose of a frame from landmarks, and what the window's errors do to it."""

from __future__ import annotations

import numpy as np
import pytest
from drive_kit import CAMERA, Drive
from hand_kit import FPS, tracks_of

import farpoint.path.path as path_module
from farpoint.geometry import so3
from farpoint.path.information import inverse
from farpoint.path.options import LensRefinementOptions, PathOptions
from farpoint.path.resection import Located, locate_frame
from farpoint.path.residuals import Poses
from farpoint.path.window import Window


def last_resection(monkeypatch: pytest.MonkeyPatch) -> tuple[tuple, Located]:
    """Arguments and result of the last resection of a recording that ends between keyframes."""
    calls = []

    def noted(*arguments: object) -> Located | None:
        calls.append((arguments, locate_frame(*arguments)))
        return calls[-1][1]

    monkeypatch.setattr(path_module, "locate_frame", noted)
    drive = Drive(PathOptions(keyframe_flow_px=12.0), LensRefinementOptions(), CAMERA, fps=FPS)
    for tracks in tracks_of(CAMERA, 24, seed=3, readout_s=0.02, noise_px=0.05):
        drive.add(tracks)
    arguments, located = calls[-1]
    assert located is not None
    assert arguments[0].frames[-1].frame < 23
    return arguments, located


def moved(window: Window, step: np.ndarray, arguments: tuple) -> tuple[np.ndarray, np.ndarray]:
    """The frame's pose where the window's unknowns are others, and its points follow them."""
    marks, state, before = window.landmarks, window._state(), window.landmarks.residuals
    residuals = window._residuals(Poses.of(window.frames))
    linear = residuals.linear(Poses.of(window.frames))
    normal = residuals.normal(linear, marks.has_depth)
    window._move(step, normal._replace(point_g=np.zeros_like(normal.point_g)))
    # The change, with the lens linearised where it was.
    change = residuals.linear(Poses.of(window.frames)).residuals - linear.residuals
    marks.residuals = before + change
    located = locate_frame(*arguments)
    window._restore(state)
    marks.residuals = before
    assert located is not None
    return located.R, located.p


def test_the_pose_follows_the_errors_of_the_window(monkeypatch):
    arguments, located = last_resection(monkeypatch)
    window, D = arguments[0], located.by_state.shape[1]
    scales = np.sqrt(np.diag(window.covariance))
    own, largest = inverse(located.covariance), []
    for index in range(D):
        size = 0.02 * scales[index]
        expected = size * located.by_state[:, index]
        step, ends = np.zeros(D), []
        for sign in (1.0, -1.0):
            step[index] = sign * size
            ends.append(moved(window, step, arguments))
        (R1, p1), (R0, p0) = ends
        off = 0.5 * np.concatenate([so3.log(R1 @ R0.T), p1 - p0]) - expected
        # In sigmas of the pose. The weights of the residuals, which change with them, are left out.
        largest.append(np.sqrt(expected @ own @ expected))
        assert np.sqrt(off @ own @ off) < 0.15 * largest[-1] + 0.008, index
    assert max(largest[-window.lens.size - 1 :]) > 0.02
    assert np.count_nonzero(np.array(largest) > 0.2) >= 5  # of the newest keyframe
