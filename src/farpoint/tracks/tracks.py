"""Tracks between two frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Tracks", "Windows"]


@dataclass(frozen=True, kw_only=True)
class Windows:
    """Deformations of the matched windows.

    Attributes
    ----------
    warps : ndarray of float64, shape (N, 2, 2)
        Affine warps: derivatives of ``Tracks.points1`` by ``Tracks.points0``.
    quadratic_bias : ndarray of float64, shape (N, 2, 2, 3)
        Bias of each match, px, if the motion of the pixels in the window is quadratic in their
        position. Element ``[n, a, b, c]`` is the bias of match n along axis a if the motion along
        axis b contains the term ``u^2``, ``u v`` or ``v^2`` (c = 0, 1, 2) with coefficient 1. ``u``
        and ``v`` are the offsets from the window's centre, px.
    """

    warps: np.ndarray
    quadratic_bias: np.ndarray

    def select(self, which: np.ndarray) -> Windows:
        """The windows selected by a mask of bool (N,) or by indices."""
        return Windows(warps=self.warps[which], quadratic_bias=self.quadratic_bias[which])


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """Matches of points between two frames of one camera.

    Attributes
    ----------
    ids : ndarray of int64, shape (N,)
        Id of each track. A track keeps its id in all frames.
    points0, points1 : ndarray of float64, shape (N, 2)
        Pixel positions in the earlier and the later frame.
    covariance_px2 : ndarray of float64, shape (N, 2, 2)
        Covariance of ``points1`` if ``points0`` is exact, px^2, from image gradients and residuals.
    windows : Windows or None
        Deformations of the matched windows. None if `points1` has been corrected for the
        deformations, or if the matches are chains of several matches.
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
        """No tracks, as in the first frame."""
        return cls(
            ids=np.empty(0, np.int64),
            points0=np.empty((0, 2)),
            points1=np.empty((0, 2)),
            covariance_px2=np.empty((0, 2, 2)),
        )

    def select(self, which: np.ndarray) -> Tracks:
        """The tracks selected by a mask of bool (N,) or by indices."""
        return Tracks(
            ids=self.ids[which],
            points0=self.points0[which],
            points1=self.points1[which],
            covariance_px2=self.covariance_px2[which],
            windows=None if self.windows is None else self.windows.select(which),
        )
