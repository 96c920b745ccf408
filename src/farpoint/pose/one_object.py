"""Test whether only one compact object has parallax: this object may move independently.

Far points and one near object allow two explanations with the same likelihood: a camera that moves
past a stationary object, and a camera that only turns while the object moves.
"""

from __future__ import annotations

import numpy as np

from farpoint._kernels.constants import MIN_MATCHES
from farpoint.geometry.sphere import normalize
from farpoint.pose.constants import (
    COMPACT_REGION_SHARE,
    MIN_OBJECT_NEAR,
    NEAR_IN_REGION_SHARE,
    OBJECT_REGION_SHARE,
)

__all__ = ["is_one_object"]


def is_one_object(rays: np.ndarray, labels: np.ndarray) -> bool:
    """Whether the near matches lie on one compact part of the image, surrounded by far matches.

    Parameters
    ----------
    rays : ndarray, shape (N, 3)
        Unit rays in one of the cameras.
    labels : ndarray of uint8, shape (N,)
        `TrackLabel` of each match.
    """
    near, inliers = labels == 2, labels > 0
    count, total = np.count_nonzero(near), np.count_nonzero(inliers)
    # The region contains at least `OBJECT_REGION_SHARE` of the near matches. If this number of
    # matches is already too large for a compact region, the region is not computed.
    if (
        count < MIN_OBJECT_NEAR
        or total - count < MIN_MATCHES
        or OBJECT_REGION_SHARE * count >= COMPACT_REGION_SHARE * total
    ):
        return False
    center = normalize(np.median(rays[near], axis=0)[None])[0]
    distance2 = np.sum((rays - center) ** 2, axis=1)
    within = inliers & (distance2 <= np.quantile(distance2[near], OBJECT_REGION_SHARE))
    region = np.count_nonzero(within)
    is_compact = region < COMPACT_REGION_SHARE * total
    return bool(is_compact and np.count_nonzero(within & near) > NEAR_IN_REGION_SHARE * region)
