"""The record of what was tracked between two frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Tracks"]


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """Points seen in two frames of one camera.

    Attributes
    ----------
    ids : ndarray of int64, shape (N,)
        Identity of each track; the same number means the same scene point in every frame.
    points0, points1 : ndarray of float64, shape (N, 2)
        Pixel positions in the earlier and the later frame.
    covariance_px2 : ndarray of float64, shape (N, 2, 2)
        Covariance of ``points1`` given ``points0``: what the image gradients and the residual of
        the match tell about the displacement.
    """

    ids: np.ndarray
    points0: np.ndarray
    points1: np.ndarray
    covariance_px2: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def empty(cls) -> Tracks:
        """No track at all: what a frame without a predecessor has."""
        return cls(
            ids=np.empty(0, np.int64),
            points0=np.empty((0, 2)),
            points1=np.empty((0, 2)),
            covariance_px2=np.empty((0, 2, 2)),
        )

    def select(self, which: np.ndarray) -> Tracks:
        """The tracks that a mask of bool (N,) marks, or that indices name."""
        return Tracks(
            ids=self.ids[which],
            points0=self.points0[which],
            points1=self.points1[which],
            covariance_px2=self.covariance_px2[which],
        )
