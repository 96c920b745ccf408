"""Lens and shutter that motions of two frames are estimated with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farpoint.camera import Camera
from farpoint.path.lens import LensEstimate
from farpoint.path.options import LensRefinementOptions

__all__ = ["LensInUse"]

_SIGNIFICANT_SIGMAS = 3.0  # a lens that is farther off is wrong


class LensInUse:
    """The camera that motions are estimated with: as given, unless the path has shown it wrong.

    It changes where the lens found is more than three of its own sigmas from it: below that it
    would follow noise, and each change costs tables of the lens. A shutter that is not known is
    global until its read-out time stands out as much.

    Parameters
    ----------
    camera : Camera
        As given.
    options : LensRefinementOptions
        Whose read-out time comes first.
    """

    def __init__(self, camera: Camera, options: LensRefinementOptions) -> None:
        self.camera = camera
        if options.readout_ms is not None:
            self.camera = camera.with_readout(1e-3 * options.readout_ms)
        self._is_shutter_known = self.camera.readout_s is not None
        self._z: np.ndarray | None = None

    def follow(self, lens: LensEstimate | None) -> None:
        """Take what the path has found, where it is plainly something else."""
        if lens is None:
            return
        moved = lens.z if self._z is None else lens.z - self._z
        if lens.size and lens.moved_px(moved) > _SIGNIFICANT_SIGMAS * lens.sigma_px():
            self._z, found = lens.z, lens.report().camera
            # Of a camera whose doubt was given, what is left of it counts; else it was exact.
            uncertainty = None if self.camera.uncertainty is None else found.uncertainty
            self.camera = replace(self.camera, model=found.model, uncertainty=uncertainty)
        sigma_s = lens.readout_sigma_s
        if not self._is_shutter_known and lens.readout_s > _SIGNIFICANT_SIGMAS * sigma_s:
            self.camera = self.camera.with_readout(lens.readout_s, sigma_s)

    def interval_s(self, seconds: float) -> float | None:
        """Time between two views, in which the first one was read out; None where it is unknown."""
        if seconds <= 0.0 or self.camera.readout_s is None:
            return None
        return max(seconds, self.camera.readout_s)
