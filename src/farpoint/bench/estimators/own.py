"""farpoint itself, called through the public interface."""

from __future__ import annotations

from collections.abc import Callable

from farpoint.bench.estimators.estimator import Estimator, Motion
from farpoint.bench.views import TwoViews
from farpoint.pose import RelativePoseOptions, estimate_relative_pose

__all__ = ["CLOSED_FORM", "FARPOINT"]


def _estimator(name: str, settings: str, options: RelativePoseOptions) -> Estimator:
    def prepare(views: TwoViews, seed: int) -> Callable[[], Motion | None]:
        """Return the call that is timed; pixels and camera need no conversion."""

        def estimate() -> Motion | None:
            """The call that a user would make."""
            pose = estimate_relative_pose(
                views.points0, views.points1, views.camera, options=options, seed=seed
            )
            if pose.rotation_cam1_from_cam0 is None:
                return None
            return Motion(pose.rotation_cam1_from_cam0, pose.direction_cam1_from_cam0)

        return estimate

    return Estimator(name=name, settings=settings, prepare=prepare)


FARPOINT = _estimator("farpoint", "defaults", RelativePoseOptions())
CLOSED_FORM = _estimator("farpoint, closed form", "refine=False", RelativePoseOptions(refine=False))
