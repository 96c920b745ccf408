"""Lens and shutter of the two-view estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from farpoint.camera import Camera
from farpoint.path.lens import LensEstimate
from farpoint.path.options import LensRefinementOptions

__all__ = ["LensInUse"]

_SIGNIFICANT_SIGMAS = 3.0  # deviation from the lens in use that replaces it


class LensInUse:
    """The camera of two-view estimates: as given, until the path's estimate differs by 3 sigma.

    Smaller differences are noise, and each change recomputes tables of the lens. An unknown shutter
    is global until its read-out time exceeds 3 sigma.

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

    def update(self, lens: LensEstimate | None) -> None:
        """Adopt the path's estimate where it differs by more than 3 sigma."""
        if lens is None:
            return
        moved = lens.z if self._z is None else lens.z - self._z
        if lens.size and lens.moved_px(moved) > _SIGNIFICANT_SIGMAS * lens.sigma_px():
            self._z, found = lens.z, lens.report().camera
            # The posterior uncertainty where the given camera has one; else exact.
            uncertainty = None if self.camera.uncertainty is None else found.uncertainty
            self.camera = replace(self.camera, model=found.model, uncertainty=uncertainty)
        sigma_s = lens.readout_sigma_s
        if not self._is_shutter_known and lens.readout_s > _SIGNIFICANT_SIGMAS * sigma_s:
            self.camera = self.camera.with_readout(lens.readout_s, sigma_s)

    def interval_s(self, seconds: float) -> float | None:
        """Time between two views, at least the read-out time; None where unknown."""
        if seconds <= 0.0 or self.camera.readout_s is None:
            return None
        return max(seconds, self.camera.readout_s)
