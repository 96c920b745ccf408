"""pycolmap: COLMAP's LO-RANSAC of the essential matrix, and its cheirality check."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from farpoint.bench.estimators.estimator import Estimator, Motion, load_peer, pinhole_points
from farpoint.bench.views import TwoViews
from farpoint.geometry.sphere import normalize

__all__ = ["colmap_estimators"]

_TUNED = {"min_num_trials": 50, "max_error": 1.0}


def colmap_estimators() -> tuple[Estimator, ...]:
    """COLMAP's estimator with defaults, and tuned for tracks; empty if not installed."""
    pycolmap = load_peer("pycolmap")
    if pycolmap is None:
        return ()
    return (
        Estimator(name="pycolmap", settings="defaults", prepare=_preparation(pycolmap, {})),
        Estimator(
            name="pycolmap tuned",
            settings=", ".join(f"{key}={value}" for key, value in _TUNED.items()),
            prepare=_preparation(pycolmap, _TUNED),
        ),
    )


def _preparation(
    pycolmap: Any, ransac: dict[str, Any]
) -> Callable[[TwoViews, int], Callable[[], Motion | None]]:
    options = pycolmap.RANSACOptions()
    for name, value in ransac.items():
        setattr(options, name, value)

    def prepare(views: TwoViews, seed: int) -> Callable[[], Motion | None]:
        """Convert matches and camera to pycolmap's format; returns the call that is timed."""
        ideal = pinhole_points(views)
        width, height = views.camera.size or (0, 0)
        camera = pycolmap.Camera(
            model="PINHOLE",
            width=width,
            height=height,
            params=[*ideal.focal_px, *ideal.centre_px],
        )

        def estimate() -> Motion | None:
            """One call of the library; the result is converted to farpoint's conventions."""
            options.random_seed = seed
            found = pycolmap.estimate_essential_matrix(
                ideal.points0, ideal.points1, camera, camera, options
            )
            pose = None if found is None else found["cam2_from_cam1"]
            if pose is None or not np.any(pose.translation):
                return None
            return Motion(pose.rotation.matrix(), normalize(pose.translation))

        return estimate

    return prepare
