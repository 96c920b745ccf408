"""A keyframe: a pose that the window may still change."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

__all__ = ["Keyframe"]


@dataclass(kw_only=True, eq=False)
class Keyframe:
    """A frame whose observations are compared with those of others.

    Attributes
    ----------
    frame : int
        Index of the frame.
    timestamp : float
        Seconds.
    R : ndarray, shape (3, 3)
        Rotation ``world_from_cam``.
    p : ndarray, shape (3,)
        Position in the world.
    twist : ndarray, shape (6,)
        Velocities in the world when it was taken: of rotation, rad/s, and of the position.
    """

    frame: int
    timestamp: float
    R: np.ndarray
    p: np.ndarray
    twist: np.ndarray = field(default_factory=lambda: np.zeros(6))
