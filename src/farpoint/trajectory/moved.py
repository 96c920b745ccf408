"""What a motion makes of the distances: one with its length, and one that nobody has seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.pose import RelativePose
from farpoint.trajectory.chain import parts_of
from farpoint.trajectory.depths import Depths
from farpoint.trajectory.parallax import Parallax
from farpoint.trajectory.scale import ScaleFit

__all__ = ["Moved", "MovedUnseen"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """A motion with its length.

    Attributes
    ----------
    direction : ndarray, shape (3,)
        Of the translation, in camera 1.
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

    direction: np.ndarray
    parallax: Parallax
    fit: ScaleFit
    inherited: np.ndarray
    is_resected: bool

    @classmethod
    def by(
        cls,
        fit: ScaleFit,
        motion: RelativePose,
        parallax: Parallax,
        depths: Depths,
        *,
        is_resected: bool = False,
    ) -> Moved:
        """With the length that was fitted to these distances, as known before."""
        _, direction, _ = parts_of(motion)
        return cls(
            direction=direction,
            parallax=parallax,
            fit=fit,
            inherited=fit.by_inverse @ depths.bend_of(fit.ids),
            is_resected=is_resected,
        )

    def carry_on(self, depths: Depths) -> Depths:
        """The distances as known after it."""
        fit = self.fit
        errors = np.hstack([self.inherited, fit.root])
        scaled = np.concatenate([self.inherited[0], fit.gain * fit.root[0]])
        return depths.seen_again(
            self.parallax, fit.scale, fit.correction, fit.scale * self.direction, errors, scaled
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class MovedUnseen:
    """A motion of which the rotation is known, and that there is a translation.

    Attributes
    ----------
    ids : ndarray of int64, shape (N,)
        Tracks, ascending.
    rays : ndarray, shape (N, 3)
        Where they are seen after it.
    sigma : float
        1-sigma of the translation in each direction, in the unit of the trajectory.
    """

    ids: np.ndarray
    rays: np.ndarray
    sigma: float

    def carry_on(self, depths: Depths) -> Depths:
        """The distances as known after it."""
        return depths.left_behind(self.ids, self.rays, self.sigma)
