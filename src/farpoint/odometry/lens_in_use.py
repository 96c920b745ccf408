"""Lens and shutter of the two-view estimates."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy

from farpoint._kernels.constants import GATE_SIGMA
from farpoint.camera import Camera
from farpoint.odometry.constants import LENS_CHANGE_FALSE_ALARM
from farpoint.path.lens import LensEstimate, readout_prior
from farpoint.path.options import LensRefinementOptions

__all__ = ["LensInUse"]


class LensInUse:
    """The camera of two-view estimates.

    The camera is the given camera until the lens estimate of the path differs significantly from
    the lens in use. The path's estimate then becomes the lens in use. An insignificant difference
    is mostly noise, and each change of the lens costs time, because tables are computed again.
    After a change, or if the given camera has an uncertainty, the lens covariance is ``C + d d^T``,
    where C is the covariance of the path's estimate, and d is the difference between the lens in
    use and the path's estimate. An unknown shutter counts as global until the estimated read-out
    time exceeds 3 sigma. Until then, the 1-sigma of the read-out time is the root mean square error
    of this assumption: the root of the sum of squares of the path's estimate and its sigma.

    Parameters
    ----------
    camera : Camera
        The given camera.
    options : LensRefinementOptions
        The read-out time of the options, if given, replaces the read-out time of the camera.
    """

    def __init__(self, camera: Camera, options: LensRefinementOptions) -> None:
        self.camera, self._options = camera, options
        if options.readout_ms is not None:
            self.camera = camera.with_readout(1e-3 * options.readout_ms)
        self._estimates_shutter = self.camera.readout_s is None and options.refine
        self._z: np.ndarray | None = None  # lens in use; None for the given lens
        self._solution: np.ndarray | None = None  # lens covariance at the last update

    def begin(self, seconds: float) -> None:
        """Take the prior of an unknown read-out time, given the time between two frames."""
        if self._estimates_shutter and self.camera.readout_s is None and seconds > 0.0:
            prior = readout_prior(self.camera, self._options, seconds)
            self.camera = self.camera.with_readout(*prior)

    def update(self, lens: LensEstimate | None) -> None:
        """Adopt the path's estimate of lens and shutter if the difference is significant."""
        if lens is None or lens.covariance is self._solution:
            return
        self._solution = lens.covariance
        moved = lens.z if self._z is None else lens.z - self._z
        if lens.size and _is_significant(moved, lens.covariance[:-1, :-1]):
            self._z, moved = lens.z, np.zeros(lens.size)
            self.camera = replace(self.camera, model=lens.found().model)
        if lens.size and (self._z is not None or self.camera.uncertainty is not None):
            covariance = lens.covariance[:-1, :-1] + np.outer(moved, moved)
            covariance = lens.factor @ covariance @ lens.factor.T
            self.camera = self.camera.with_parameter_covariance(covariance)
        if not self._estimates_shutter:
            return
        readout_s, sigma_s = lens.readout_s, lens.readout_sigma_s
        if readout_s > GATE_SIGMA * sigma_s:
            self.camera = self.camera.with_readout(readout_s, sigma_s)
        else:
            self.camera = self.camera.with_readout(0.0, math.hypot(readout_s, sigma_s))

    def interval_s(self, seconds: float) -> float | None:
        """Time between two views, s, at least the read-out time; None if either time is unknown."""
        if seconds <= 0.0 or self.camera.readout_s is None:
            return None
        return max(seconds, self.camera.readout_s)


def _is_significant(moved: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether a change (r,) is larger than the ``covariance`` explains."""
    distance2 = float(moved @ np.linalg.solve(covariance, moved))
    return distance2 > float(scipy.special.chdtri(len(moved), LENS_CHANGE_FALSE_ALARM))
