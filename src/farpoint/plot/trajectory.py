"""``plot.trajectory``: the path of the camera from above."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from farpoint.errors import InputError
from farpoint.odometry import OdometryResult
from farpoint.plot.axes import new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["trajectory"]


def trajectory(
    path: Iterable[OdometryResult] | np.ndarray, *, ax: Axes | None = None, label: str | None = None
) -> Axes:
    """Draw a path from above: x to the right, z (initially forward) upwards, with equal axes.

    Parameters
    ----------
    path : iterable of OdometryResult, or ndarray, shape (N, 4, 4)
        Results of `Odometry`, or ``world_from_cam`` of each frame.
    ax : matplotlib.axes.Axes, optional
        New axes by default; use the same axes to compare paths.
    label : str, optional
        Name in the legend.

    Returns
    -------
    matplotlib.axes.Axes
        Axes in the unit of the trajectory.

    Raises
    ------
    InputError
        If `path` has no pose, or if `path` is neither results nor an array of shape (N, 4, 4).
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).

    Examples
    --------
    >>> fp.plot.trajectory(fp.Odometry(camera).run(frames))  # doctest: +SKIP
    """
    x, _, z = _poses(path)[:, :3, 3].T
    ax = new_axes() if ax is None else ax
    (line,) = ax.plot(x, z, label=label)
    ax.plot(x[0], z[0], linestyle="", marker="o", color=line.get_color())
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("x, to the right at the start")
    ax.set_ylabel("z, ahead at the start")
    if label is not None:
        ax.legend()
    return ax


def _poses(path: Iterable[OdometryResult] | np.ndarray) -> np.ndarray:
    """``world_from_cam`` (N, 4, 4), with at least one pose."""
    if isinstance(path, np.ndarray):
        poses = path
    else:
        results = list(path)
        if not all(isinstance(result, OdometryResult) for result in results):
            raise InputError("expected results of Odometry or an array (N, 4, 4)", field="path")
        poses = np.array([result.world_from_cam for result in results])
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or len(poses) == 0:
        raise InputError(f"expected poses (N, 4, 4), at least one, got {poses.shape}", field="path")
    return poses
