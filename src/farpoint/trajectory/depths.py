"""How near the tracked points are, in the unit of the trajectory: what carries the scale."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from farpoint.trajectory.parallax import Parallax

__all__ = ["BENDS", "ERRORS", "Depths"]

ERRORS = 6
"""Of a motion: of the logarithm of its length, and of ``[dtheta, dbeta]``."""
BENDS = 6
"""Errors that all distances share, beyond one scale."""

_CONTRADICTION = 5.0  # sigma between what was known of a point and what is seen
_SMALL = 0.3  # relative error of an inverse distance that a series of second order covers
_KNOWN = 2.0  # sigma by which a distance must stand out to carry the scale


@dataclass(frozen=True, kw_only=True, eq=False)
class Depths:
    """Inverse distances of tracked points from one camera.

    Each has an error of its own. What they have in common is kept with the trajectory: the error of
    the scale, and errors of the motions that have measured them, which bend them all at once.

    Attributes
    ----------
    ids : ndarray of int64, shape (N,)
        Ascending.
    inverse : ndarray, shape (N,)
        One over the distance, in the unit of the trajectory.
    variance : ndarray, shape (N,)
        Of its own error.
    bend : ndarray, shape (N, BENDS)
        By how much it is larger for a unit of each of the errors in common, which are independent.
    """

    ids: np.ndarray
    inverse: np.ndarray
    variance: np.ndarray
    bend: np.ndarray

    @classmethod
    def empty(cls) -> Depths:
        """Of no point."""
        nothing = np.empty(0)
        return cls(
            ids=np.empty(0, np.int64), inverse=nothing, variance=nothing, bend=np.empty((0, BENDS))
        )

    def __len__(self) -> int:
        return len(self.ids)

    def of(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse distances (M,) and variances (M,) of ``ids`` (M,); 0 and infinite if unknown."""
        inverse, variance = np.zeros(len(ids)), np.full(len(ids), np.inf)
        row, known = self._rows(ids)
        inverse[known], variance[known] = self.inverse[row], self.variance[row]
        return inverse, variance

    def bend_of(self, ids: np.ndarray) -> np.ndarray:
        """Of ``ids`` (M,), shape (M, BENDS); 0 if unknown."""
        bend = np.zeros((len(ids), BENDS))
        row, known = self._rows(ids)
        bend[known] = self.bend[row]
        return bend

    def _rows(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows of those of ``ids`` (M,) that are known, and which these are (M,)."""
        if not len(self):
            return np.empty(0, np.int64), np.zeros(len(ids), bool)
        row = np.minimum(np.searchsorted(self.ids, ids), len(self) - 1)
        known = self.ids[row] == ids
        return row[known], known

    def carry_scale(self, ids: np.ndarray) -> np.ndarray:
        """Mask (M,) of the tracks whose distance stands out of its error."""
        inverse, variance = self.of(ids)
        return inverse > _KNOWN * np.sqrt(variance)

    def seen_again(
        self,
        parallax: Parallax,
        scale: float,
        correction: np.ndarray,
        translation: np.ndarray,
        errors: np.ndarray,
        scaled: np.ndarray,
    ) -> Depths:
        """What is known after a motion of length ``scale``, from its second camera.

        Points that contradict what was known of them are forgotten.

        Parameters
        ----------
        parallax : Parallax
            Of the motion.
        scale : float
            Its length in the unit of the trajectory.
        correction : ndarray, shape (5,)
            The change of the motion, ``[dtheta, dbeta]``, that the known distances ask for.
        translation : ndarray, shape (3,)
            In camera 1, of length ``scale``.
        errors : ndarray, shape (6, BENDS + 6)
            Of ``[log(scale), dtheta, dbeta]``, for a unit of each of the errors in common, of which
            there are six more now, those of the motion.
        scaled : ndarray, shape (BENDS + 6,)
            What of these errors is counted as one of the scale from now on.

        Returns
        -------
        Depths
            With as many errors in common; `condense` makes fewer of them.
        """
        before, variance = self.of(parallax.ids)
        known = np.isfinite(variance)
        seen = parallax.around(np.where(known, scale * before, parallax.measured()))
        now = (seen.inverse + seen.by_motion @ correction) / scale
        now_variance = seen.variance / scale**2
        off = np.where(known, now - before, 0.0)
        agree = off**2 < _CONTRADICTION**2 * (variance + now_variance)
        weight, now_weight = 1.0 / variance, 1.0 / now_variance
        fused_variance = 1.0 / (weight + now_weight)
        fused = fused_variance * (weight * before + now_weight * now)
        share = fused_variance * now_weight
        of_motion = seen.by_motion @ errors[1:] / scale - np.outer(fused, errors[0])
        bend = np.outer(fused, scaled) + share[:, None] * of_motion
        bend[:, :BENDS] += (1.0 - share)[:, None] * self.bend_of(parallax.ids)
        inverse, inverse_variance, slope = _moved(
            fused, fused_variance, parallax.turned, translation
        )
        return Depths(
            ids=parallax.ids[agree],
            inverse=inverse[agree],
            variance=inverse_variance[agree],
            bend=(slope[:, None] * bend)[agree],
        )

    def left_behind(self, ids: np.ndarray, rays: np.ndarray, sigma: float) -> Depths:
        """What is known of ``ids`` (M,), seen along ``rays`` (M, 3), after a translation unseen.

        Nothing is known of it but its 1-sigma in each direction, in the unit of the trajectory: its
        three parts are errors in common, the last ones.
        """
        inverse, variance = self.of(ids)
        bend = np.hstack([self.bend_of(ids), -sigma * inverse[:, None] ** 2 * rays])
        known = np.isfinite(variance)
        return Depths(
            ids=ids[known], inverse=inverse[known], variance=variance[known], bend=bend[known]
        )

    def condense(self) -> tuple[Depths, np.ndarray]:
        """With the `BENDS` errors in common that matter most, and these (M, BENDS) in terms of all.

        Those are kept that stand out most of the distances' own errors.
        """
        relative = self.bend / np.sqrt(self.variance)[:, None]
        axes = np.linalg.eigh(relative.T @ relative).eigenvectors[:, -BENDS:]
        return replace(self, bend=self.bend @ axes), axes


def _moved(
    inverse: np.ndarray, variance: np.ndarray, rays: np.ndarray, translation: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``k / |ray + k t|``, the distances ``1 / k`` seen from the next camera; variance and slope.

    To second order in the error: the mean of a bent function is not the function of the mean, and
    what is lost so with every motion adds up.
    """
    point = rays + inverse[:, None] * translation
    length = np.linalg.norm(point, axis=1)
    along = point @ translation / length**2
    slope = (1.0 - inverse * along) / length
    bend = inverse * (3.0 * along**2 - translation @ translation / length**2) - 2.0 * along
    # The series holds for small errors only; points less certain weigh little anyhow.
    small = np.where(variance < (_SMALL * inverse) ** 2, variance, 0.0)
    moved = inverse / length + 0.5 * small * bend / length
    return moved, np.maximum(variance * slope**2, np.finfo(float).tiny), slope
