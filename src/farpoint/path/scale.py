"""Scale of a window: the baseline that is the unit of the path, and the error of the scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from farpoint._kernels.constants import GATE_SIGMA
from farpoint.path.keyframe import Keyframe
from farpoint.path.prior import by_position_change

__all__ = ["Scale", "by_log_length"]


class Scale:
    """The scale of a window.

    The unit of the path is the distance between two keyframes. As soon as a keyframe is
    marginalised, the prior of the window fixes the scale instead.

    Parameters
    ----------
    unknowns : int
        Number of unknowns of the window, D.

    Attributes
    ----------
    by_state : ndarray, shape (D,)
        Derivatives of the logarithm of the scale by all unknowns, at the last solution. Zero if no
        baseline measures the scale.
    """

    def __init__(self, unknowns: int) -> None:
        # Slots (indices of keyframes) of the baseline whose length is the unit of the path. None as
        # soon as the prior fixes the scale.
        self._unit: tuple[int, int] | None = None
        self._unit_variance = self._variance = 0.0
        self.by_state = np.zeros(unknowns)

    def set_unit(self, slots: tuple[int, int]) -> None:
        """Fix the scale by the current distance between two keyframes."""
        self._unit = slots

    def ends_unit(self, slot: int) -> bool:
        """Whether the later keyframe of the unit baseline is ``slot``."""
        return self._unit is not None and self._unit[1] == slot

    def gauge(self, frames: Sequence[Keyframe]) -> tuple[int, int] | None:
        """Slots of the two keyframes whose distance is fixed in a solution.

        The two keyframes are the first keyframe and the keyframe farthest from the first. The
        result is None if the prior fixes the scale, or if all keyframes have the same position.
        """
        if self._unit is None:
            return None
        lengths = [float(np.linalg.norm(frame.p - frames[0].p)) for frame in frames]
        return (0, int(np.argmax(lengths))) if max(lengths) > 0.0 else None

    def unit_variance(self, frames: Sequence[Keyframe], covariance: np.ndarray) -> float:
        """Variance of the logarithm of the length of the unit baseline.

        ``covariance`` (D, D) is that of the unknowns. After `forget_unit`, the variance is the one
        that the unit baseline had then.
        """
        if self._unit is None:
            return self._unit_variance
        row = by_log_length(frames, self._unit, len(covariance))
        return float(row @ covariance @ row)

    def forget_unit(self, frames: Sequence[Keyframe], covariance: np.ndarray) -> None:
        """The prior fixes the scale from now on."""
        self._unit_variance, self._unit = self.unit_variance(frames, covariance), None

    def unmeasured_variance(self) -> float:
        """Variance of the logarithm of the scale if no baseline measures it; otherwise zero."""
        return 0.0 if self.by_state.any() else self._variance

    def update(self, frames: Sequence[Keyframe], covariance: np.ndarray) -> None:
        """Find the derivatives of the logarithm of the scale at a new solution.

        The logarithm of the scale is measured by a baseline from another keyframe to the newest
        keyframe: the baseline whose length has the smallest relative 1-sigma. If this 1-sigma is
        1/3 or more, as under pure rotation, the derivatives are zero, and the variance from an
        earlier solution is kept.
        """
        count, newest, least = len(covariance), len(frames) - 1, np.inf
        self.by_state = np.zeros(count)
        for slot in range(newest):
            if float(np.sum((frames[newest].p - frames[slot].p) ** 2)) > 0.0:
                row = by_log_length(frames, (slot, newest), count)
                variance = float(row @ covariance @ row)
                if variance < least:
                    least, self.by_state = variance, row
        if least < 1.0 / GATE_SIGMA**2:
            self._variance = least
        else:
            self.by_state = np.zeros(count)


def by_log_length(frames: Sequence[Keyframe], slots: tuple[int, int], count: int) -> np.ndarray:
    """Derivatives (count,) of the logarithm of the distance between two keyframes."""
    displacement = frames[slots[1]].p - frames[slots[0]].p
    along = displacement / float(displacement @ displacement)
    return by_position_change(frames, *slots, along, count)
