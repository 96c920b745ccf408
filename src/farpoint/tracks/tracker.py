"""Tracks that live from frame to frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from farpoint.errors import InputError
from farpoint.tracks.corners import find_corners, thin_out
from farpoint.tracks.defects import DefectivePixels
from farpoint.tracks.lucas_kanade import follow
from farpoint.tracks.options import TrackerOptions
from farpoint.tracks.pyramid import Pyramid, build_pyramid
from farpoint.tracks.refinement import refine, window_reach
from farpoint.tracks.row_brightness import even_rows, row_gains, with_row_gains
from farpoint.tracks.tracks import Tracks

__all__ = ["Tracker", "grey_size"]

Predict = Callable[[np.ndarray], np.ndarray]

_WARP_STEP_PX = 4.0  # to either side: half of a window, over which the lens is about affine
_ROUNDS = 2  # of learning how bright rows are from tracks, and finding tracks by that
_MOST_AVERAGED = 20  # images whose bands are averaged
_LARGEST_WARP = 0.5  # elements farther off the identity are a seam or the edge of a field


@dataclass(frozen=True, kw_only=True, eq=False)
class _Reference:
    """The image that the next one is compared with, and the tracks alive in it."""

    pyramid: Pyramid
    ids: np.ndarray
    points: np.ndarray


class Tracker:
    """Follows corners through a sequence of images.

    Every image is compared with the reference, the last image that was advanced to. Comparing
    changes nothing, so that the caller decides what becomes of an image: the next reference
    (`advance`), with the tracks that proved good; the beginning of something new (`restart`); or
    nothing, and the next image is compared with the same reference again. `track` is `match` and
    `advance` in one.

    Pixels of the sensor that are hot or dead are found as the image moves, and are not seen from
    then on (`DefectivePixels`). Where the light changes row by row, as mains light does under a
    rolling shutter, images are compared as if it had not (`row_gains`).

    Equal images, options and calls give equal tracks, bit for bit.

    Parameters
    ----------
    options : TrackerOptions, optional
        Number of tracks, spacing, windows and thresholds.
    mask : ndarray of bool, shape (H, W), optional
        True where tracks may be; False on what moves with the camera, such as a bonnet, and where
        the lens sees nothing (`trackable_region`).

    Examples
    --------
    >>> tracker = Tracker(TrackerOptions(max_tracks=300))
    >>> texture = np.random.default_rng(0).integers(0, 255, (60, 80)).astype(np.uint8)
    >>> len(tracker.track(texture))  # the first image has nothing to be compared with
    0
    >>> tracks = tracker.track(texture)
    >>> len(tracks) > 0 and bool(np.all(tracks.points0 == tracks.points1))
    True
    """

    def __init__(self, options: TrackerOptions | None = None, *, mask: np.ndarray | None = None):
        self.options = TrackerOptions() if options is None else options
        self._mask = None if mask is None else _checked_mask(mask)
        self._defects = DefectivePixels()
        self._reference: _Reference | None = None
        # Of the image that was matched last, and how much brighter its rows are than before.
        self._matched: tuple[Pyramid, np.ndarray | None] | None = None
        self._averaged = 1  # images whose bands of brightness the reference's are the mean of
        self._next_id = 0

    @property
    def ids(self) -> np.ndarray:
        """Identities of the tracks alive in the reference, int64, shape (N,), ascending."""
        return np.empty(0, np.int64) if self._reference is None else self._reference.ids.copy()

    @property
    def points(self) -> np.ndarray:
        """Their pixels, shape (N, 2)."""
        return np.empty((0, 2)) if self._reference is None else self._reference.points.copy()

    def track(self, image: np.ndarray, predict: Predict | None = None) -> Tracks:
        """`match`, then `advance` with all tracks found."""
        tracks = self.match(image, predict)
        self.advance(image, tracks)
        return tracks

    def match(self, image: np.ndarray, predict: Predict | None = None) -> Tracks:
        """Find the reference's tracks in an image; the tracker stays as it is.

        Parameters
        ----------
        image : ndarray of uint8, shape (H, W)
            Grey values.
        predict : callable, optional
            Takes pixels (N, 2) in the reference, returns where they are expected (N, 2), such as
            by the last motion; where it returns NaN nothing is expected. A wrong prediction costs
            time, not tracks. It is also asked a few pixels beside them, which tells how the windows
            will change their shapes.

        Returns
        -------
        Tracks
            None without a reference, on an image without texture, and where nothing fits.

        Raises
        ------
        InputError
            Where the image is not uint8 of two dimensions, or not of the reference's size.
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
        tracks = found = self._predicted_or_not(reference, pyramid, predict)
        if 2 * len(tracks) < len(reference.ids):
            found = self._found_in_even_rows(reference, pyramid, predict)
        for _ in range(_ROUNDS):
            gains = row_gains(reference.pyramid, pyramid, found)
            if gains is None:
                break
            adapted = build_pyramid(with_row_gains(image, gains), self.options.matching)
            tracks = found = self._predicted_or_not(reference, adapted, predict)
            self._matched = pyramid, gains
        return tracks

    def _found_in_even_rows(
        self, reference: _Reference, pyramid: Pyramid, predict: Predict | None
    ) -> Tracks:
        """Bands of brightness may lose most tracks; these are found in spite of them."""
        even0, even1 = (
            build_pyramid(even_rows(lit.image), self.options.matching)
            for lit in (reference.pyramid, pyramid)
        )
        return self._predicted_or_not(replace(reference, pyramid=even0), even1, predict)

    def _predicted_or_not(
        self, reference: _Reference, pyramid: Pyramid, predict: Predict | None
    ) -> Tracks:
        tracks = self._found(reference, pyramid, *_predicted(predict, reference.points))
        if predict is not None and 2 * len(tracks) < len(reference.ids):
            # A prediction that loses most tracks may itself be the fault.
            unpredicted = self._found(reference, pyramid, *_predicted(None, reference.points))
            tracks = max(tracks, unpredicted, key=len)
        return tracks

    def sees_texture(self, image: np.ndarray) -> bool:
        """Whether an image has corners enough, a hundredth of the tracks wanted, to begin with."""
        image = self._defects.repaired(_checked_image(image))
        wanted = max(self.options.max_tracks // 100, 8)
        return len(self._new_corners(image, np.empty((0, 2)), wanted)) == wanted

    def advance(self, image: np.ndarray, tracks: Tracks) -> None:
        """Make ``image`` the reference: the tracks given live on in it, missing ones are begun.

        Where tracks have run together the oldest goes on.

        Parameters
        ----------
        image : ndarray of uint8, shape (H, W)
            The image that `match` has seen.
        tracks : Tracks
            What `match` returned, or the part of it that proved good (`Tracks.select`).
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
        new = new + _fractions(new_ids)
        self._next_id += len(new)
        self._reference = _Reference(
            pyramid=self._pyramid_of(image),
            ids=np.concatenate([ids, new_ids]),
            points=np.concatenate([points, new]),
        )

    def restart(self, image: np.ndarray) -> None:
        """Make ``image``, of any size, the reference; all tracks begin anew, under new ids."""
        self.advance(image, Tracks.empty())

    def _pyramid_of(self, image: np.ndarray) -> Pyramid:
        """The image's pyramid, which `match` has mostly built before."""
        matched, self._matched = self._matched, None
        # Looked at, not remembered: a caller may fill the same array with the next image.
        if matched is None or not np.array_equal(matched[0].image, image):
            self._averaged = 1
            return build_pyramid(image, self.options.matching)
        pyramid, gains = matched
        if gains is None:
            return pyramid
        # Bands that move average out, and errors of the gains do not add up.
        self._averaged = min(self._averaged + 1, _MOST_AVERAGED)
        gains = gains ** (1.0 - 1.0 / self._averaged)
        return build_pyramid(with_row_gains(image, gains), self.options.matching)

    def _new_corners(self, image: np.ndarray, points: np.ndarray, count: int) -> np.ndarray:
        reach = window_reach(self.options.refinement)
        corners = self.options.corners
        return find_corners(image, points, count, reach, corners, self._mask_for(image))

    def _found(
        self,
        reference: _Reference,
        pyramid: Pyramid,
        start: np.ndarray,
        warps: np.ndarray,
    ) -> Tracks:
        options = self.options
        rough, seen = follow(reference.pyramid, pyramid, reference.points, start, options.matching)
        ids, points0 = reference.ids[seen], reference.points[seen]
        points1, covariance_px2, found, windows = refine(
            reference.pyramid, pyramid, points0, rough[seen], options.refinement, warps[seen]
        )
        return Tracks(
            ids=ids,
            points0=points0,
            points1=points1,
            covariance_px2=covariance_px2,
            windows=windows,
        ).select(found & self._inside_mask(points1, pyramid.image))

    def _inside_mask(self, points: np.ndarray, image: np.ndarray) -> np.ndarray:
        """Which points (N, 2), all within the image, the mask allows."""
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


def _fractions(ids: np.ndarray) -> np.ndarray:
    """Offsets (N, 2), -0.5 to 0.5 px, that spread evenly over the pixel as tracks are begun.

    Corners are whole pixels, and what a match is off by depends on the fractions of a pixel at
    which the window lies in both images (0.02 px in sharp ones). Begun on whole pixels all tracks
    would share them and be off the same way, which no covariance of single tracks can tell.
    """
    # Roberts' sequence: the plastic number's reciprocal and its square.
    return ((ids[:, None] + 1) * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0 - 0.5


def _checked_image(image: np.ndarray) -> np.ndarray:
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2:
        given = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image)
        raise InputError(f"expected grey values, uint8 of shape (H, W), got {given}", field="image")
    if 0 in image.shape:
        raise InputError(f"expected at least one pixel, got shape {image.shape}", field="image")
    return image


def grey_size(image: np.ndarray) -> tuple[int, int]:
    """Width and height of an image, or an InputError where it is not of grey uint8 values."""
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


def _predicted(predict: Predict | None, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where points (N, 2) are expected, and the derivatives (N, 2, 2) of that by the points."""
    warps = np.broadcast_to(np.eye(2), (len(points), 2, 2)).copy()
    if predict is None:
        return points, warps
    start = _checked_prediction(predict, points)
    for axis in range(2):
        step = _WARP_STEP_PX * np.eye(2)[axis]
        ahead, behind = (_checked_prediction(predict, points + sign * step) for sign in (1, -1))
        warps[:, :, axis] = (ahead - behind) / (2.0 * _WARP_STEP_PX)
    with np.errstate(invalid="ignore"):
        known = np.abs(warps - np.eye(2)).max(axis=(1, 2), initial=0.0) < _LARGEST_WARP
    warps[~known] = np.eye(2)
    return np.where(np.isfinite(start).all(axis=1, keepdims=True), start, points), warps


def _checked_prediction(predict: Predict, points: np.ndarray) -> np.ndarray:
    predicted = np.asarray(predict(points.copy()), dtype=np.float64)
    if predicted.shape != points.shape:
        raise InputError(
            f"expected it to return shape {points.shape}, got {predicted.shape}", field="predict"
        )
    return predicted
