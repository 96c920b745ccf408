"""A keyframe: a frame whose pose is optimised in the window."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

__all__ = ["Keyframe"]


@dataclass(kw_only=True, eq=False)
class Keyframe:
    """A frame whose pose is an unknown of the window.

    Attributes
    ----------
    frame : int
        Index of the frame.
    timestamp : float
        Time stamp of the frame, s.
    R : ndarray, shape (3, 3)
        Rotation ``world_from_cam``.
    p : ndarray, shape (3,)
        Position in the world.
    twist : ndarray, shape (6,)
        Angular velocity, rad/s, and linear velocity, both in world axes.
    """

    frame: int
    timestamp: float
    R: np.ndarray
    p: np.ndarray
    twist: np.ndarray = field(default_factory=lambda: np.zeros(6))
