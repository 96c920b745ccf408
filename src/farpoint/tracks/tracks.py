"""The record of what was tracked between two frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Tracks", "Windows"]


@dataclass(frozen=True, kw_only=True)
class Windows:
    """What the matched windows tell beyond where they are.

    Attributes
    ----------
    warps : ndarray of float64, shape (N, 2, 2)
        Derivatives of ``points1`` by ``points0``: how the windows have changed their shapes.
    bending : ndarray of float64, shape (N, 2, 2, 3)
        How far, px, the quadratic part of a window's motion moves its match: ``[a, b, c]`` is the
        move along axis a for each unit of ``u^2``, ``u v`` or ``v^2`` (c = 0, 1, 2; pixels from
        the window's centre) in the motion along axis b.
    """

    warps: np.ndarray
    bending: np.ndarray

    def select(self, which: np.ndarray) -> Windows:
        """Those that a mask of bool (N,) marks, or that indices name."""
        return Windows(warps=self.warps[which], bending=self.bending[which])


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
    windows : Windows or None
        Of the matches, as long as `points1` is where the windows were found; None where it was
        corrected for what they tell, or put together from several matches.
    """

    ids: np.ndarray
    points0: np.ndarray
    points1: np.ndarray
    covariance_px2: np.ndarray
    windows: Windows | None = None

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
            windows=None if self.windows is None else self.windows.select(which),
        )
