"""Tracking of corners over an image sequence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from farpoint.errors import InputError
from farpoint.tracks.constants import (
    MAX_AVERAGED_IMAGES,
    MAX_PREDICTED_WARP,
    ROW_GAIN_ROUNDS,
    WARP_STEP_PX,
)
from farpoint.tracks.corners import find_corners, thin_out
from farpoint.tracks.defects import DefectivePixels
from farpoint.tracks.lucas_kanade import track_points
from farpoint.tracks.options import TrackerOptions
from farpoint.tracks.pyramid import Pyramid, build_pyramid
from farpoint.tracks.refinement import refine, window_reach
from farpoint.tracks.row_brightness import normalize_rows, remove_row_gains, row_gains
from farpoint.tracks.tracks import Tracks

__all__ = ["Tracker", "grey_size"]

Predict = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Reference:
    """Reference image and the tracks in the reference image."""

    pyramid: Pyramid
    ids: np.ndarray
    points: np.ndarray


class _Start(NamedTuple):
    """Initial pixels (N, 2) and warps (N, 2, 2) of tracks, and how many found tracks suffice.

    The number is half of the tracks whose initial pixel is in the image, but at least a quarter of
    all tracks, because an initial pixel outside the image may be wrong.
    """

    pixels: np.ndarray
    warps: np.ndarray
    least_found: float

    @classmethod
    def of(cls, pixels: np.ndarray, warps: np.ndarray, image: np.ndarray) -> _Start:
        height, width = image.shape
        inside = ((pixels > -0.5) & (pixels < (width - 0.5, height - 0.5))).all(axis=1)
        return cls(pixels, warps, 0.5 * max(np.count_nonzero(inside), 0.5 * len(pixels)))


class Tracker:
    """Tracks corners through a sequence of images.

    `match` finds the tracks of a reference image in a new image and keeps the reference. The caller
    then has three choices: make the new image the reference and keep the inlier tracks (`advance`),
    make the new image the reference with new tracks (`restart`), or keep the old reference. `track`
    calls `match` and then `advance`.

    Hot and dead pixels are detected and interpolated (`DefectivePixels`). Gains that vary from row
    to row, which flickering light causes with a rolling shutter, are estimated and removed
    (`row_gains`).

    The same images, options and calls give the same tracks, bit for bit.

    Parameters
    ----------
    options : TrackerOptions, optional
        Number of tracks, spacing, windows and thresholds.
    mask : ndarray of bool, shape (H, W), optional
        True where tracks may lie. Parts of the vehicle, such as a bonnet, and pixels outside the
        lens' field (`trackable_region`) should be False.

    Examples
    --------
    >>> tracker = Tracker(TrackerOptions(max_tracks=300))
    >>> texture = np.random.default_rng(0).integers(0, 255, (60, 80)).astype(np.uint8)
    >>> len(tracker.track(texture))  # the first image has no reference
    0
    >>> tracks = tracker.track(texture)
    >>> len(tracks) > 0 and np.allclose(tracks.points0, tracks.points1, atol=1e-6)
    True
    """

    def __init__(self, options: TrackerOptions | None = None, *, mask: np.ndarray | None = None):
        self.options = TrackerOptions() if options is None else options
        self._mask = None if mask is None else _checked_mask(mask)
        self._defects = DefectivePixels()
        self._reference: _Reference | None = None
        # Pyramid of the last matched image, and row gains of this image relative to the reference.
        self._matched: tuple[Pyramid, np.ndarray | None] | None = None
        # Number of images over which the row brightness of the reference is averaged.
        self._images_averaged = 1
        self._next_id = 0

    @property
    def ids(self) -> np.ndarray:
        """Ids of the reference's tracks, int64, shape (N,), ascending."""
        return np.empty(0, np.int64) if self._reference is None else self._reference.ids.copy()

    @property
    def points(self) -> np.ndarray:
        """Pixels of the reference's tracks, shape (N, 2)."""
        return np.empty((0, 2)) if self._reference is None else self._reference.points.copy()

    def track(self, image: np.ndarray, predict: Predict | None = None) -> Tracks:
        """`match`, then `advance` with all tracks found."""
        tracks = self.match(image, predict)
        self.advance(image, tracks)
        return tracks

    def match(self, image: np.ndarray, predict: Predict | None = None) -> Tracks:
        """Find the reference's tracks in an image. The reference does not change.

        Parameters
        ----------
        image : ndarray of uint8, shape (H, W)
            Grey values.
        predict : callable, optional
            Maps pixels (N, 2) of the reference to expected pixels (N, 2) in the image; NaN if
            unknown. The function is also called with neighbouring pixels, to compute expected
            warps. If fewer than half of the tracks expected in the image are found, all tracks are
            matched again without the prediction, and the result with more tracks is returned.

        Returns
        -------
        Tracks
            Matches from the reference to the image. Empty if there is no reference, if the image
            has no texture, or if no window matches.

        Raises
        ------
        InputError
            If the image is not a two-dimensional array of uint8, or if its size differs from the
            size of the reference.
        """
        image = _checked_image(image)
        reference = self._reference
        if reference is None:
            return Tracks.empty()
        if image.shape != reference.pyramid.image.shape:
            raise InputError(
                f"expected {_size(reference.pyramid.image)} pixels like the reference, "
                f"got {_size(image)}",
                field="image",
            )
        image = self._defects.repaired(image)
        pyramid = build_pyramid(image, self.options.matching)
        self._matched = pyramid, None
        starts = _starts(predict, reference.points, image)
        tracks = found = self._match_from_any(reference, pyramid, starts)
        if len(tracks) < starts[0].least_found:
            found = self._match_normalized_rows(reference, pyramid, starts)
        for _ in range(ROW_GAIN_ROUNDS):
            gains = row_gains(reference.pyramid, pyramid, found)
            if gains is None:
                break
            adapted = build_pyramid(remove_row_gains(image, gains), self.options.matching)
            tracks = found = self._match_from_any(reference, adapted, starts)
            self._matched = pyramid, gains
        return tracks

    def _match_normalized_rows(
        self, reference: _Reference, pyramid: Pyramid, starts: list[_Start]
    ) -> Tracks:
        """Match images with normalised rows, because row gains may have made most tracks fail."""
        even0, even1 = (
            build_pyramid(normalize_rows(level.image), self.options.matching)
            for level in (reference.pyramid, pyramid)
        )
        return self._match_from_any(replace(reference, pyramid=even0), even1, starts)

    def _match_from_any(
        self, reference: _Reference, pyramid: Pyramid, starts: list[_Start]
    ) -> Tracks:
        """Match from the first start that finds enough tracks, or from that which finds most."""
        best = Tracks.empty()
        for start in starts:
            best = max(best, self._match(reference, pyramid, start), key=len)
            if len(best) >= start.least_found:
                break
        return best

    def sees_texture(self, image: np.ndarray) -> bool:
        """Whether an image has at least 8 corners and at least 1 % of the requested corners."""
        image = self._defects.repaired(_checked_image(image))
        wanted = max(self.options.max_tracks // 100, 8)
        return len(self._new_corners(image, np.empty((0, 2)), wanted)) == wanted

    def advance(self, image: np.ndarray, tracks: Tracks) -> None:
        """Make ``image`` the reference with the given tracks.

        New tracks are added up to `TrackerOptions.max_tracks`. If tracks have come as close as half
        of `CornerOptions.min_distance_px`, only the oldest of these tracks is kept.

        Parameters
        ----------
        image : ndarray of uint8, shape (H, W)
            The image given to `match`.
        tracks : Tracks
            Result of `match`, or the inliers of that result (`Tracks.select`).
        """
        image = _checked_image(image)
        self._defects.learn(image, tracks)
        image = self._defects.repaired(image)
        order = np.argsort(tracks.ids, kind="stable")
        ids, points = tracks.ids[order], tracks.points1[order]
        alive = thin_out(
            points, np.zeros(image.shape, bool), self.options.corners.min_distance_px // 2
        )
        ids, points = ids[alive], points[alive]
        new = self._new_corners(image, points, self.options.max_tracks - len(points))
        new_ids = np.arange(self._next_id, self._next_id + len(new), dtype=np.int64)
        new = new + _subpixel_offsets(new_ids)
        self._next_id += len(new)
        self._reference = _Reference(
            pyramid=self._pyramid_of(image),
            ids=np.concatenate([ids, new_ids]),
            points=np.concatenate([points, new]),
        )

    def restart(self, image: np.ndarray) -> None:
        """Make ``image``, which may have any size, the reference with new tracks and new ids."""
        self.advance(image, Tracks.empty())

    def _pyramid_of(self, image: np.ndarray) -> Pyramid:
        """Pyramid of an image that becomes the reference. A pyramid from `match` is reused."""
        matched, self._matched = self._matched, None
        # The images are compared by value, because a caller may reuse an array for the next image.
        if matched is None or not np.array_equal(matched[0].image, image):
            self._images_averaged = 1
            return build_pyramid(image, self.options.matching)
        pyramid, gains = matched
        if gains is None:
            return pyramid
        # The row brightness of the new reference is the geometric mean over the last images, so
        # that moving bands average out and errors of the gains do not accumulate.
        self._images_averaged = min(self._images_averaged + 1, MAX_AVERAGED_IMAGES)
        gains = gains ** (1.0 - 1.0 / self._images_averaged)
        return build_pyramid(remove_row_gains(image, gains), self.options.matching)

    def _new_corners(self, image: np.ndarray, points: np.ndarray, count: int) -> np.ndarray:
        reach = window_reach(self.options.refinement)
        corners = self.options.corners
        return find_corners(image, points, count, reach, corners, self._mask_for(image))

    def _match(
        self,
        reference: _Reference,
        pyramid: Pyramid,
        start: _Start,
    ) -> Tracks:
        options = self.options
        rough, is_found = track_points(
            reference.pyramid, pyramid, reference.points, start.pixels, options.matching
        )
        ids, points0 = reference.ids[is_found], reference.points[is_found]
        points1, covariance_px2, found, windows = refine(
            reference.pyramid,
            pyramid,
            points0,
            rough[is_found],
            options.refinement,
            start.warps[is_found],
        )
        return Tracks(
            ids=ids,
            points0=points0,
            points1=points1,
            covariance_px2=covariance_px2,
            windows=windows,
        ).select(found & self._inside_mask(points1, pyramid.image))

    def _inside_mask(self, points: np.ndarray, image: np.ndarray) -> np.ndarray:
        """Whether each of the points (N, 2) of the image lies inside the mask."""
        mask = self._mask_for(image)
        if mask is None:
            return np.ones(len(points), bool)
        column, row = np.rint(points).astype(np.intp).T
        height, width = mask.shape
        return mask[row.clip(0, height - 1), column.clip(0, width - 1)]

    def _mask_for(self, image: np.ndarray) -> np.ndarray | None:
        if self._mask is not None and self._mask.shape != image.shape:
            raise InputError(
                f"expected {_size(image)} pixels like the image, got {_size(self._mask)}",
                field="mask",
            )
        return self._mask


def _subpixel_offsets(ids: np.ndarray) -> np.ndarray:
    """Low-discrepancy offsets (N, 2), -0.5 to 0.5 px, of new tracks.

    Interpolation biases a match by up to 0.02 px, depending on the sub-pixel positions of the
    window in both images. Tracks that start at whole pixels would have similar biases, and the
    covariances of single matches do not include such a common error.
    """
    # Roberts' R2 sequence: the reciprocal of the plastic number, and the square of the reciprocal.
    return ((ids[:, None] + 1) * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0 - 0.5


def _checked_image(image: np.ndarray) -> np.ndarray:
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2:
        given = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image)
        raise InputError(f"expected grey values, uint8 of shape (H, W), got {given}", field="image")
    if 0 in image.shape:
        raise InputError(f"expected at least one pixel, got shape {image.shape}", field="image")
    return image


def grey_size(image: np.ndarray) -> tuple[int, int]:
    """Width and height of a grey uint8 image. Any other image is an InputError."""
    height, width = _checked_image(image).shape
    return width, height


def _checked_mask(mask: np.ndarray) -> np.ndarray:
    mask = np.asarray(mask)
    if mask.dtype != bool or mask.ndim != 2:
        raise InputError(
            f"expected bool of shape (H, W), got {mask.dtype} {mask.shape}", field="mask"
        )
    return mask.copy()


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"


def _starts(predict: Predict | None, points: np.ndarray, image: np.ndarray) -> list[_Start]:
    """The predicted start, if there is a prediction, and the start at the same ``points`` (N, 2).

    The expected warps are the derivatives of the expected pixels.
    """
    unchanged = np.broadcast_to(np.eye(2), (len(points), 2, 2)).copy()
    starts = [_Start.of(points, unchanged, image)]
    if predict is None:
        return starts
    pixels, warps = _checked_prediction(predict, points), np.empty_like(unchanged)
    for axis in range(2):
        step = WARP_STEP_PX * np.eye(2)[axis]
        ahead, behind = (_checked_prediction(predict, points + sign * step) for sign in (1, -1))
        warps[:, :, axis] = (ahead - behind) / (2.0 * WARP_STEP_PX)
    with np.errstate(invalid="ignore"):
        known = np.abs(warps - np.eye(2)).max(axis=(1, 2), initial=0.0) < MAX_PREDICTED_WARP
    warps[~known] = np.eye(2)
    pixels = np.where(np.isfinite(pixels).all(axis=1, keepdims=True), pixels, points)
    return [_Start.of(pixels, warps, image), *starts]


def _checked_prediction(predict: Predict, points: np.ndarray) -> np.ndarray:
    predicted = np.asarray(predict(points.copy()), dtype=np.float64)
    if predicted.shape != points.shape:
        raise InputError(
            f"expected it to return shape {points.shape}, got {predicted.shape}", field="predict"
        )
    return predicted
