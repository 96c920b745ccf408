"""The two motions that a plane allows: which of them it was, if anything off the plane tells."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from farpoint._kernels.plane import other_motion
from farpoint.pose.fits import MIN_VARIANCE, MovingFit, refit_moving
from farpoint.pose.matches import Matches

__all__ = ["OtherMotion", "likelier_motion"]


class OtherMotion(NamedTuple):
    """A second motion that explains the matches of a plane.

    Attributes
    ----------
    R_cam1_from_cam0 : ndarray, shape (3, 3)
    direction_cam1_from_cam0 : ndarray, shape (3,)
    against : float
        By how much the log likelihood of the first motion is larger, as far as it is not chance.
    """

    R_cam1_from_cam0: np.ndarray
    direction_cam1_from_cam0: np.ndarray
    against: float


def likelier_motion(matches: Matches, fit: MovingFit) -> tuple[MovingFit, OtherMotion | None]:
    """The fit, or one to the other motion that a plane allows if that is likelier; and the rival.

    Usually there is none: no plane explains the matches nearly as well.
    """
    other = _other_motion(fit) if fit.is_planar else None
    if other is None or other.against >= 0.0:
        return fit, other
    R, t = fit.R_cam1_from_cam0, fit.direction_cam1_from_cam0
    start = replace(
        fit,
        R_cam1_from_cam0=other.R_cam1_from_cam0,
        direction_cam1_from_cam0=other.direction_cam1_from_cam0,
    )
    return refit_moving(matches, start), OtherMotion(R, t, -other.against)


def _other_motion(fit: MovingFit) -> OtherMotion | None:
    seen, R, t = fit.searched, np.empty((3, 3)), np.empty(3)
    is_rival, against = other_motion(
        seen.pairs,
        seen.weights(),
        len(seen),
        seen.spread,
        MIN_VARIANCE,
        fit.R_cam1_from_cam0,
        fit.direction_cam1_from_cam0,
        fit.noise.array,
        R,
        t,
    )
    return OtherMotion(R, t, against) if is_rival else None
