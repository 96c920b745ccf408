"""Whether all parallax is that of one compact object, which may move independently.

Far points and one near object allow two explanations with the same likelihood: a camera that moves
past a stationary object, and a camera that only turns while the object moves.
"""

from __future__ import annotations

import numpy as np

from farpoint.geometry.sphere import normalize

__all__ = ["is_one_object"]

# Share of the near matches that the region around their median ray holds.
REGION_SHARE = 0.9
# Largest share of all inliers in that region: recorded drives and walks have 0.5 and more, objects
# with 0.2 of the matches 0.24.
COMPACT = 0.3
# Least share of near matches among the inliers of the region: far points show at an object's edges
# only (simulated objects with 0.1 and 0.2 of the matches: 0.66 to 1).
PURE = 0.6
# Least number of near matches of an object: two fix a direction, and outliers may agree with it.
FEWEST_NEAR, FEWEST_FAR = 4, 8


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
    # The region holds its share of the near matches at the least: no need to look for it.
    if count < FEWEST_NEAR or total - count < FEWEST_FAR or REGION_SHARE * count >= COMPACT * total:
        return False
    center = normalize(np.median(rays[near], axis=0)[None])[0]
    distance2 = np.sum((rays - center) ** 2, axis=1)
    within = inliers & (distance2 <= np.quantile(distance2[near], REGION_SHARE))
    region = np.count_nonzero(within)
    is_compact = region < COMPACT * total
    return bool(is_compact and np.count_nonzero(within & near) > PURE * region)
