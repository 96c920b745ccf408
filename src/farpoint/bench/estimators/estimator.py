"""Interface of estimators in the benchmark."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

import numpy as np

from farpoint.bench.views import TwoViews
from farpoint.camera import Pinhole
from farpoint.errors import InputError

__all__ = ["Estimator", "Motion", "PinholePoints", "load_peer", "pinhole_points"]


class Motion(NamedTuple):
    """Estimated motion: ``X_cam1 = R_cam1_from_cam0 @ X_cam0 + s * direction`` with s > 0.

    Attributes
    ----------
    rotation_cam1_from_cam0 : ndarray, shape (3, 3)
    direction_cam1_from_cam0 : ndarray, shape (3,), or None
        Unit vector; None if the estimator reports no direction.
    """

    rotation_cam1_from_cam0: np.ndarray
    direction_cam1_from_cam0: np.ndarray | None


@dataclass(frozen=True, kw_only=True)
class Estimator:
    """An estimator of a motion from matches.

    Attributes
    ----------
    name : str
        Name of the estimator and of its settings.
    settings : str
        Settings that differ from the defaults of the library, as text.
    prepare : callable
        Takes views and a seed, converts the views to the input of the library, and returns the
        function whose call is timed. This function has no arguments and returns a `Motion`, or None
        if there is no estimate.
    """

    name: str
    settings: str
    prepare: Callable[[TwoViews, int], Callable[[], Motion | None]]


class PinholePoints(NamedTuple):
    """Matches as seen by a camera without distortion, and the intrinsics of this camera."""

    points0: np.ndarray
    points1: np.ndarray
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]

    @property
    def matrix(self) -> np.ndarray:
        """Camera matrix, shape (3, 3)."""
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def pinhole_points(views: TwoViews) -> PinholePoints:
    """The matches without lens distortion. The time of this conversion is not measured.

    Pixels and principal point stay in farpoint's convention. In the convention of COLMAP and
    PoseLib, the origin is the corner of the top-left pixel, so that pixels and principal point are
    0.5 px larger. Without distortion the two shifts cancel exactly.
    """
    model = views.camera.model
    if not isinstance(model, Pinhole):
        raise InputError("expected a pinhole camera: the peers know no other", field="camera")
    focal, centre = (model.fx, model.fy), (model.cx, model.cy)
    if any(model.distortion):
        ideal0, ideal1 = (
            _ideal_pixels(views.camera.unproject(points), focal, centre)
            for points in (views.points0, views.points1)
        )
        seen = np.isfinite(ideal0[:, 0]) & np.isfinite(ideal1[:, 0])
        return PinholePoints(ideal0[seen], ideal1[seen], focal, centre)
    return PinholePoints(views.points0, views.points1, focal, centre)


def _ideal_pixels(
    rays: np.ndarray, focal_px: tuple[float, float], centre_px: tuple[float, float]
) -> np.ndarray:
    return rays[:, :2] / rays[:, 2:] * focal_px + centre_px


def load_peer(module: str) -> ModuleType | None:
    """Import the library of a peer; None if not installed, because farpoint needs no peer."""
    try:
        return importlib.import_module(module)
    except ImportError:
        return None
