"""Model of the sensor: noise, changes of the exposure, rolling shutter and motion blur."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.errors import InputError
from farpoint.options import coerce_float, coerce_int

__all__ = ["ImagingOptions"]


@dataclass(frozen=True, kw_only=True)
class ImagingOptions:
    """Options of the sensor model.

    Attributes
    ----------
    noise_grey : float
        1-sigma of the normal noise on every pixel, grey levels. Rounding to whole grey levels adds
        noise of 0.29 grey levels.
    exposure_swing : float
        Relative amplitude, 0 to 0.5, of slow changes of the exposure.
    readout_s : float
        Read-out time of a frame, first row to last, s, 0 to 1; 0 for a global shutter. The time of
        a frame, and its true pose, are those of the middle row.
    exposure_s : float
        Exposure time of each row, s, 0 to 1; 0 for no motion blur. The time of a row is the middle
        of its exposure.
    exposure_samples : int
        Number of images that are averaged for motion blur, odd, 1 to 99. The times of these images
        are spread evenly over the exposure. The middle time is that of the middle of the exposure.
    """

    noise_grey: float = 1.0
    exposure_swing: float = 0.0
    readout_s: float = 0.0
    exposure_s: float = 0.0
    exposure_samples: int = 5

    def __post_init__(self) -> None:
        coerce_float(self, "0 to 100", lambda grey: 0 <= grey <= 100, "noise_grey")
        coerce_float(self, "0 to 0.5", lambda share: 0 <= share <= 0.5, "exposure_swing")
        coerce_float(self, "0 to 1", lambda time: 0 <= time <= 1, "readout_s", "exposure_s")
        coerce_int(self, 1, "exposure_samples", most=99)
        if self.exposure_samples % 2 == 0:
            raise InputError(
                f"expected an odd number, got {self.exposure_samples}", field="exposure_samples"
            )

    @property
    def is_instant(self) -> bool:
        """Whether the whole frame is taken at one time."""
        return self.readout_s == self.exposure_s == 0.0

    def row_delays_s(self, rows: np.ndarray, height: int) -> np.ndarray:
        """Times (N,), s after the middle row, at which whole or fractional rows (N,) are read."""
        return self.readout_s * (rows / max(height - 1, 1) - 0.5)

    @property
    def exposure_delays_s(self) -> np.ndarray:
        """Times (K,), s, of the averaged images, relative to the middle of the exposure."""
        if self.exposure_s == 0.0:
            return np.zeros(1)
        count = self.exposure_samples
        return self.exposure_s * ((np.arange(count) + 0.5) / count - 0.5)
