"""``plot.flow``: the translational flow."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from farpoint.camera import Camera
from farpoint.errors import InputError
from farpoint.plot.axes import image_axes, sized_camera
from farpoint.plot.epipole import epipole
from farpoint.pose import RelativePose, TrackLabel
from farpoint.pose.flow import derotated_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["flow"]


class _Style(NamedTuple):
    label: TrackLabel
    name: str
    colour: str
    marker: str


# Red and green as in Burschka and Mair (2008). The markers differ, too.
_STYLES = (
    _Style(TrackLabel.OUTLIER, "outlier", "0.6", "x"),
    _Style(TrackLabel.FAR, "far", "#e5352b", "o"),
    _Style(TrackLabel.NEAR, "near", "#1f9d4d", "."),
)


def flow(
    pose: RelativePose,
    points0: np.ndarray,
    points1: np.ndarray,
    camera: Camera,
    *,
    image: np.ndarray | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the translational flow: every match with the rotation removed, and the epipole.

    A line goes from each point of image 0 to the pixel that the same point would have in image 1 if
    the camera had not rotated. Far points do not move. Near points move along lines through the
    epipole.

    Parameters
    ----------
    pose : RelativePose
        Motion between the two images. For a FAILED pose, the flow is drawn without removal of a
        rotation.
    points0, points1 : ndarray, shape (N, 2)
        The matches of the pose, px, such as ``result.tracks.points0``.
    camera : Camera
        Camera of both images.
    image : ndarray, shape (height, width) or (height, width, 3), optional
        Image 0, drawn in the background.
    ax : matplotlib.axes.Axes, optional
        New axes by default.

    Returns
    -------
    matplotlib.axes.Axes
        Axes in pixels of image 0, y down.

    Raises
    ------
    InputError
        If the points are not the matches of the pose, or if neither the camera nor the image has a
        size.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).

    Examples
    --------
    >>> pose = fp.estimate_relative_pose(points0, points1, camera)  # doctest: +SKIP
    >>> fp.plot.flow(pose, points0, points1, camera, image=image0)  # doctest: +SKIP
    """
    points0 = _points(points0, pose, "points0")
    points1 = _points(points1, pose, "points1")
    camera, size = sized_camera(camera, image)
    ax = image_axes(ax, size, image)
    heads = points1
    if pose.rotation_cam1_from_cam0 is not None:
        heads = derotated_points(camera, points1, pose.rotation_cam1_from_cam0)
    for style in _STYLES:
        chosen = pose.labels == style.label
        _draw_matches(ax, points0[chosen], heads[chosen], style)
    title = None if pose.heading_cam0 is not None else f"{pose.status.value}: no direction"
    if title is None:
        epipole(pose, camera, ax=ax)
    # Above the picture, because points may be in every corner of the picture.
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, frameon=False, title=title)
    return ax


def _draw_matches(ax: Axes, tails: np.ndarray, heads: np.ndarray, style: _Style) -> None:
    ends = np.stack([tails, heads], axis=1)
    # One line for all matches, interrupted by NaN, which is much faster than one line per match.
    broken = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1)
    ax.plot(*broken.reshape(-1, 2).T, color=style.colour, linewidth=1.0)
    ax.plot(
        *heads.T,
        linestyle="",
        marker=style.marker,
        markersize=4.0,
        fillstyle="none" if style.marker == "o" else "full",
        color=style.colour,
        label=f"{style.name} ({len(heads)})",
    )


def _points(points: np.ndarray, pose: RelativePose, name: str) -> np.ndarray:
    points = np.asarray(points, float)
    if points.shape != (len(pose.labels), 2):
        raise InputError(
            f"expected shape ({len(pose.labels)}, 2), a row for each label of the pose, "
            f"got {points.shape}",
            field=name,
        )
    return points
