"""Two-view motion of a camera that does not translate, by the evidence of landmarks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farpoint.geometry import so3
from farpoint.path.constants import CHI2_P99_OF_3
from farpoint.path.point import Rest
from farpoint.pose import PoseStatus, RelativePose

__all__ = ["at_rest"]


def at_rest(pose: RelativePose, rest: Rest | None) -> RelativePose:
    """Replace a two-view motion, if the camera does not translate, by STATIC or ROTATION_ONLY.

    Parameters
    ----------
    pose : RelativePose
        Two-view estimate.
    rest : Rest or None
        Evidence from landmarks that the camera does not translate. If None, ``pose`` is returned
        unchanged.
    """
    if rest is None:
        return pose
    turn = so3.log(rest.rotation_cam1_from_cam0)
    squared = turn @ np.linalg.pinv(rest.rotation_covariance, hermitian=True) @ turn
    is_rotating = bool(squared > CHI2_P99_OF_3)
    return replace(
        pose,
        status=PoseStatus.ROTATION_ONLY if is_rotating else PoseStatus.STATIC,
        reason=(
            f"Independently moving object: {rest.points} points of known distance show that the "
            f"camera {'rotates without a translation' if is_rotating else 'is at rest'}."
        ),
        rotation_cam1_from_cam0=rest.rotation_cam1_from_cam0,
        rotation_covariance=rest.rotation_covariance,
        direction_cam1_from_cam0=None,
        direction_basis=None,
        covariance=None,
    )
