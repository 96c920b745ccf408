"""A motion with its length, and what it inherits from the distances behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.trajectory.depths import Depths
from farpoint.trajectory.parallax import Parallax
from farpoint.trajectory.scale import ScaleFit

__all__ = ["Moved"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """A motion with its length.

    Attributes
    ----------
    parallax : Parallax
        Of its points.
    fit : ScaleFit
        Its length.
    inherited : ndarray, shape (6, BENDS)
        Errors of ``[log(scale), dtheta, dbeta]`` of the fit, for a unit of each of those that the
        distances behind it have in common.
    is_resected : bool
        Whether the motion itself is what these distances say, and errs with them.
    """

    parallax: Parallax
    fit: ScaleFit
    inherited: np.ndarray
    is_resected: bool

    @classmethod
    def by(
        cls, fit: ScaleFit, parallax: Parallax, depths: Depths, *, is_resected: bool = False
    ) -> Moved:
        """With the length that was fitted to these distances, as known before."""
        inherited = fit.by_inverse @ depths.bend_of(fit.ids)
        return cls(parallax=parallax, fit=fit, inherited=inherited, is_resected=is_resected)

    def carry_on(self, depths: Depths, direction: np.ndarray) -> Depths:
        """The distances as known after it, ``direction`` (3,) being that of travel in camera 1."""
        fit = self.fit
        errors = np.hstack([self.inherited, fit.root])
        scaled = np.concatenate([self.inherited[0], fit.gain * fit.root[0]])
        return depths.seen_again(
            self.parallax, fit.scale, fit.correction, fit.scale * direction, errors, scaled
        )
