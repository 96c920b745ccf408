"""Epipole and antipode of the epipole in the image, with 95 % regions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.camera import Camera, project_path
from farpoint.geometry.sphere import tangent_basis
from farpoint.pose import RelativePose

__all__ = ["EpipoleView", "meridians", "view_epipole"]

_STEP_PX = 2.0
_MERIDIANS = 16
_POLE_GAP_RAD = np.deg2rad(9.0)  # meridians end at this angle from a pole, where they would merge


@dataclass(frozen=True, kw_only=True, eq=False)
class EpipoleView:
    """The epipole and its antipode as an image shows them.

    Attributes
    ----------
    heading : ndarray, shape (3,)
        Direction of travel in camera 0.
    ahead_px, behind_px : ndarray, shape (2,), or None
        Pixels of the epipole (direction of travel) and of its antipode in image 0; None if outside
        of the image. A wide lens may see the epipole and the antipode.
    ring_px : ndarray, shape (K, 2)
        Boundary of the heading's 95 % region and of the opposite region around the antipode, as far
        as the lens sees these boundaries. A row of NaN begins a new piece.
    """

    heading: np.ndarray
    ahead_px: np.ndarray | None
    behind_px: np.ndarray | None
    ring_px: np.ndarray


def view_epipole(pose: RelativePose, camera: Camera, size: tuple[int, int]) -> EpipoleView | None:
    """The epipole in an image of size (width, height); None if the direction is unknown."""
    heading, ring = pose.heading_cam0, pose.heading_region(0.95)
    if heading is None or ring is None:
        return None
    ends_px = camera.project(np.stack([heading, -heading]))
    beyond = np.abs(ends_px - (np.array(size) - 1) / 2.0) - np.array(size) / 2.0
    ahead, behind = np.all(beyond <= 0.0, axis=1)  # NaN compares as outside
    outlines = [line for line in (_outline(camera, ring), _outline(camera, -ring)) if len(line)]
    if len(outlines) == 2:
        outlines.insert(1, np.full((1, 2), np.nan))
    return EpipoleView(
        heading=heading,
        ahead_px=ends_px[0] if ahead else None,
        behind_px=ends_px[1] if behind else None,
        ring_px=np.concatenate([np.empty((0, 2)), *outlines]),
    )


def _outline(camera: Camera, ring: np.ndarray) -> np.ndarray:
    """Image (M, 2), px, of a closed ring of rays (K, 3)."""
    pixels = camera.project(ring)
    steps = np.linalg.norm(np.diff(pixels, axis=0), axis=1)
    # A ring with short steps is drawn through its own points, without further points.
    return pixels if np.all(steps < _STEP_PX) else project_path(camera, ring)


def meridians(heading: np.ndarray) -> np.ndarray:
    """Half great circles from the heading (3,) to its antipode: rays (K, 3), NaN between them.

    The flow of stationary points is along these curves.
    """
    basis = tangent_basis(heading)
    turn = np.arange(_MERIDIANS) * 2.0 * np.pi / _MERIDIANS
    sides = np.stack([np.cos(turn), np.sin(turn)], axis=1) @ basis.T
    # With three points, each arc between neighbours is below 180 degrees.
    angles = np.linspace(_POLE_GAP_RAD, np.pi - _POLE_GAP_RAD, 3)[:, None]
    paths = np.cos(angles) * heading + np.sin(angles) * sides[:, None]
    gap = np.full((_MERIDIANS, 1, 3), np.nan)
    return np.concatenate([paths, gap], axis=1).reshape(-1, 3)
