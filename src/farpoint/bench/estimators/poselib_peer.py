"""PoseLib: LO-RANSAC on five points, then a robust Sampson refinement."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from farpoint.bench.estimators.estimator import Estimator, Motion, load_peer, pinhole_points
from farpoint.bench.views import TwoViews
from farpoint.geometry import so3
from farpoint.geometry.sphere import normalize

__all__ = ["poselib_estimators"]

# Of the choices tried, the fastest and the most accurate on tracks with a noise of 0.2 px.
_TUNED_RANSAC = {"min_iterations": 50}
_TUNED_BUNDLE = {"loss_type": "TRUNCATED", "loss_scale": 1.0}


def poselib_estimators() -> tuple[Estimator, ...]:
    """PoseLib with defaults, and PoseLib tuned for tracks; empty if not installed."""
    poselib = load_peer("poselib")
    if poselib is None:
        return ()
    return (
        Estimator(name="PoseLib", settings="defaults", prepare=_preparation(poselib, {}, {})),
        Estimator(
            name="PoseLib tuned",
            settings=", ".join(
                f"{key}={value}" for key, value in (_TUNED_RANSAC | _TUNED_BUNDLE).items()
            ),
            prepare=_preparation(poselib, _TUNED_RANSAC, _TUNED_BUNDLE),
        ),
    )


def _preparation(
    poselib: Any, ransac: dict[str, Any], bundle: dict[str, Any]
) -> Callable[[TwoViews, int], Callable[[], Motion | None]]:
    def prepare(views: TwoViews, seed: int) -> Callable[[], Motion | None]:
        """Convert matches and camera to PoseLib's format; returns the call that is timed."""
        ideal = pinhole_points(views)
        width, height = views.camera.size or (0, 0)
        camera = {
            "model": "PINHOLE",
            "width": width,
            "height": height,
            "params": [*ideal.focal_px, *ideal.centre_px],
        }
        settings = {**ransac, "seed": seed}

        def estimate() -> Motion | None:
            """One call of the library; the result is converted to farpoint's conventions."""
            pose, _ = poselib.estimate_relative_pose(
                ideal.points0, ideal.points1, camera, camera, settings, bundle
            )
            if not pose.t.any():
                return None
            # PoseLib's quaternions are w x y z.
            return Motion(so3.matrix_from_quat_xyzw(pose.q[[1, 2, 3, 0]]), normalize(pose.t))

        return estimate

    return prepare
