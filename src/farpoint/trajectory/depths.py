"""How near the tracked points are, in the unit of the trajectory: what carries the scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from farpoint.trajectory.parallax import Parallax

__all__ = ["Depths"]

_CONTRADICTION = 5.0  # sigma between what was known of a point and what is seen
_SMALL = 0.3  # relative error of an inverse distance that a series of second order covers
_KNOWN = 2.0  # sigma by which a distance must stand out to carry the scale


@dataclass(frozen=True, kw_only=True, eq=False)
class Depths:
    """Inverse distances of tracked points from one camera.

    They are apart by their own errors; what they have in common, the error of the scale itself, is
    kept with the trajectory.

    Attributes
    ----------
    ids : ndarray of int64, shape (N,)
        Ascending.
    inverse : ndarray, shape (N,)
        One over the distance, in the unit of the trajectory.
    variance : ndarray, shape (N,)
        Of its own error.
    """

    ids: np.ndarray
    inverse: np.ndarray
    variance: np.ndarray

    @classmethod
    def empty(cls) -> Depths:
        """Of no point."""
        return cls(ids=np.empty(0, np.int64), inverse=np.empty(0), variance=np.empty(0))

    def __len__(self) -> int:
        return len(self.ids)

    def of(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse distances (M,) and variances (M,) of ``ids`` (M,); 0 and infinite if unknown."""
        inverse, variance = np.zeros(len(ids)), np.full(len(ids), np.inf)
        if len(self):
            row = np.minimum(np.searchsorted(self.ids, ids), len(self) - 1)
            known = self.ids[row] == ids
            inverse[known] = self.inverse[row[known]]
            variance[known] = self.variance[row[known]]
        return inverse, variance

    def carry_scale(self, ids: np.ndarray) -> np.ndarray:
        """Mask (M,) of the tracks whose distance stands out of its error."""
        inverse, variance = self.of(ids)
        return inverse > _KNOWN * np.sqrt(variance)

    def seen_again(
        self, parallax: Parallax, scale: float, correction: np.ndarray, translation: np.ndarray
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
        inverse, inverse_variance = _moved(fused, fused_variance, parallax.turned, translation)
        return Depths(
            ids=parallax.ids[agree], inverse=inverse[agree], variance=inverse_variance[agree]
        )


def _moved(
    inverse: np.ndarray, variance: np.ndarray, rays: np.ndarray, translation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """``k / |ray + k t|`` with its variance, the distances ``1 / k`` seen from the next camera.

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
    return moved, np.maximum(variance * slope**2, np.finfo(float).tiny)
