"""Reprojection residuals of a window, px: derivatives, likelihood and information.

Errors of a track accumulate from match to match. Each term of the cost is therefore a function of
the change of a track's residual between two keyframes. The change has Student's t distribution,
with the covariances of the matches in between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from farpoint.path.constants import PATCHES_PER_IMAGE
from farpoint.path.information import System
from farpoint.path.kernels.cholesky import eliminate_points
from farpoint.path.kernels.information import gather_information, robust_cost
from farpoint.path.kernels.projection import expected_rays, pixel_residuals
from farpoint.path.keyframe import Keyframe
from farpoint.path.landmarks import Landmarks
from farpoint.path.lens import LensEstimate

__all__ = [
    "NOISE",
    "Linear",
    "Normal",
    "Poses",
    "Residuals",
    "WindowNoise",
    "clear_unseen",
    "row_phase",
]


class WindowNoise(NamedTuple):
    """Model of the covariance of the change of a track's residual between two keyframes.

    Attributes
    ----------
    last, accumulated : float
        Weight of the covariance of the match before the later keyframe, and weight of the sum of
        the covariances of all matches between the two keyframes.
    floor_px2 : float
        Variance added to both coordinates, px^2. Matches between identical images would otherwise
        have almost no variance.
    """

    last: float = 0.5
    accumulated: float = 0.5
    floor_px2: float = 0.03**2

    def covariances(self, last: np.ndarray, accumulated: np.ndarray) -> np.ndarray:
        """Covariances (N, 3), as (uu, uv, vv) in px^2, of residual changes.

        ``last`` (N, 3) are the covariances of the last matches, and ``accumulated`` (N, 3) the sums
        of the covariances since the earlier keyframe.
        """
        floor = self.floor_px2 * np.array([1.0, 0.0, 1.0])
        return self.last * last + self.accumulated * accumulated + floor


NOISE = WindowNoise()


class Poses(NamedTuple):
    """Keyframes as arrays: rotations (K, 3, 3), positions (K, 3) and velocities (K, 6)."""

    R: np.ndarray
    p: np.ndarray
    twist: np.ndarray

    @classmethod
    def of(cls, frames: Sequence[Keyframe]) -> Poses:
        """Current poses of keyframes."""
        return cls(
            np.array([frame.R for frame in frames]).reshape(-1, 3, 3),
            np.array([frame.p for frame in frames]).reshape(-1, 3),
            np.array([frame.twist for frame in frames]).reshape(-1, 6),
        )


class Linear(NamedTuple):
    """Residuals of all observations, and derivatives of the residuals.

    The derivatives are by the pose of the observing keyframe, by lens and read-out time, and by the
    inverse distance. Residuals and derivatives of anchors are 0. For a point that is not in front
    of the camera, the residual is `UNSEEN_PX` and the derivatives are 0.
    """

    residuals: np.ndarray
    by_pose: np.ndarray
    by_common: np.ndarray
    by_s: np.ndarray


class Normal(NamedTuple):
    """Normal equations of the observations, with separate blocks for the points.

    ``H`` and ``g`` are the information and the gradient of poses, lens and read-out time.
    ``point_h`` and ``point_g`` are the information and the gradient of the inverse distances.
    ``coupling`` is the information between the two groups of unknowns. ``squares`` is the sum of
    weighted squared residuals, and ``residuals`` is the number of residual vectors (u, v).
    ``design_effect`` is the product of two ratios, one for image patches and one for tracks: the
    variance of the residual sums over a patch or a track, divided by this variance for independent
    residuals.
    """

    H: np.ndarray
    g: np.ndarray
    coupling: np.ndarray
    point_h: np.ndarray
    point_g: np.ndarray
    squares: float
    residuals: int
    design_effect: float

    def reduced(self, damping: float) -> System:
        """System of poses and common unknowns without the points (Schur complement)."""
        H, g = self.H.copy(), self.g.copy()
        eliminate_points(self.coupling, self.point_h, self.point_g, damping, H, g)
        return System(H, g)


def clear_unseen(*linearised: np.ndarray) -> None:
    """Set row i of all arrays (N, ...) to zero if a value in row i of any array is not finite."""
    if math.isfinite(sum(float(values.sum()) for values in linearised)):
        return  # the usual case: one test for all rows
    unseen = np.zeros(len(linearised[0]), bool)
    for values in linearised:
        unseen |= ~np.isfinite(values.reshape(len(unseen), -1)).all(axis=1)
    for values in linearised:
        values[unseen] = 0.0


def row_phase(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Times (N,) at which pixels (N, 2) are read, from -1/2 to 1/2 of the read-out time."""
    return pixels[:, 1] / max(size[1] - 1, 1) - 0.5


class Residuals:
    """Residuals of a window. The lens is linearised once, at the pixels expected for ``poses``.

    Parameters
    ----------
    landmarks : Landmarks
    lens : LensEstimate
    size : (int, int)
        Width and height of the images, px.
    poses : Poses
        Poses at which the lens is linearised.
    variance_factor, design_effect : float
        Factor on the variances of residuals, and divisor of information and cost; see `Window`.
    """

    def __init__(
        self,
        landmarks: Landmarks,
        lens: LensEstimate,
        size: tuple[int, int],
        poses: Poses,
        variance_factor: float,
        design_effect: float,
    ) -> None:
        self._marks, self._lens, self._size = landmarks, lens, size
        self._noise, self._design_effect = np.array([*NOISE, variance_factor]), design_effect
        self._keyframes = len(poses.R)
        self._row_phase = row_phase(landmarks.pixels, size)
        self._scratch = np.empty(len(landmarks.ids), np.int64)
        self._first = poses

    @cached_property
    def _lens_linearisation(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Expected rays, expected minus observed pixels, and derivatives of the expected pixels."""
        marks, lens = self._marks, self._lens
        rays = np.empty((len(marks.point), 3))
        expected_rays(
            *self._first, lens.readout_s, lens.change, marks.slot, marks.point, self._row_phase,
            marks.rays, marks.ray_by_lens, marks.anchor, marks.s, rays,
        )  # fmt: skip
        pixels, by_ray, by_lens = lens.pixels_of(rays)
        offsets = pixels - marks.pixels
        clear_unseen(rays, offsets, by_ray, by_lens)
        return rays, offsets, by_ray, by_lens

    def linear(self, poses: Poses) -> Linear:
        """Residuals and derivatives at the given poses, with the current lens and points."""
        marks, lens, count = self._marks, self._lens, len(self._marks.point)
        linear = Linear(
            np.empty((count, 2)), np.zeros((count, 2, 6)), np.zeros((count, 2, lens.size + 1)),
            np.zeros((count, 2)),
        )  # fmt: skip
        pixel_residuals(
            *poses, lens.readout_s, lens.change, marks.slot, marks.point, self._row_phase,
            marks.rays, marks.ray_by_lens, *self._lens_linearisation, marks.anchor, marks.s,
            marks.has_depth, *linear,
        )  # fmt: skip
        return linear

    def cost(self, linear: Linear) -> float:
        """Negative log likelihood up to a constant."""
        marks = self._marks
        cost = robust_cost(
            marks.point, marks.last, marks.accumulated, marks.anchor, marks.has_depth, self._noise,
            linear.residuals, self._scratch,
        )  # fmt: skip
        return cost / self._design_effect

    def normal(self, linear: Linear, used: np.ndarray) -> Normal:
        """Normal equations of the observations of the points selected by a mask (M,)."""
        marks, points = self._marks, len(self._marks.ids)
        count = 6 * self._keyframes + self._lens.size + 1
        H, g, coupling = np.zeros((count, count)), np.zeros(count), np.zeros((points, count))
        point_h, point_g = np.zeros(points), np.zeros(points)
        patches, patch = self._patches()
        patch_sums, point_sums = np.zeros((patches, 2)), np.zeros((points, 2))
        squares, influence, observed = gather_information(
            marks.slot, marks.point, marks.last, marks.accumulated, marks.anchor, used, self._noise,
            *linear, patch, self._scratch, H, g, coupling, point_h, point_g, patch_sums, point_sums,
        )  # fmt: skip
        for array in (H, g, coupling, point_h, point_g):
            array *= 1.0 / self._design_effect
        design_effect = 1.0
        if influence > 0.0:
            along = max(float(np.vdot(point_sums, point_sums)) / influence, 1.0)
            design_effect = along * max(float(np.vdot(patch_sums, patch_sums)) / influence, 1.0)
        return Normal(H, g, coupling, point_h, point_g, squares, observed, design_effect)

    def _patches(self) -> tuple[int, np.ndarray]:
        """Number of patches in all images, and the patch (N,) of each observation."""
        width, height = self._size
        side = max(width, height) / PATCHES_PER_IMAGE
        across, down = math.ceil(width / side), math.ceil(height / side)
        column, row = (self._marks.pixels / side).astype(np.int64).T
        place = np.clip(row, 0, down - 1) * across + np.clip(column, 0, across - 1)
        return self._keyframes * across * down, self._marks.slot * (across * down) + place
