"""Pixels of the sensor that do not show the scene: hot and dead ones, found as the image moves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from farpoint._kernels.spacing import cover
from farpoint.errors import optional_import
from farpoint.tracks.tracks import Tracks

__all__ = ["DefectivePixels"]

# A defect reaches a pixel to each side: demosaicing and compression spread it.
_REACH = 1
_RING = _REACH + 1  # px, the distance of the pixels that it is compared with and repaired by
_MIN_CONTRAST = 6  # grey levels beyond all of the ring: less hardly pulls at a window
# All of the first images are looked at, then one of so many: sensors age slowly.
_FIRST_IMAGES, _LATER_EVERY = 20, 4
# px: from here on the scene shows another part of itself at every pixel, and what stands out again
# does so independently.
_MIN_MOTION_PX = 1.0
_PULL_PX = 5  # so near to a suspect, along either axis, a track may follow it
_NEIGHBOURS = 5  # tracks whose median says how the scene moves at a place
_DETECTION_RATE = 0.8  # of a defect in one image: a bright scene may hide it
_FALSE_ALARMS = 0.01  # pixels taken for defects by chance, of a whole image
_MOST_MISSES = 6  # after so many images without it, a defect is no more


@dataclass(frozen=True, kw_only=True, eq=False)
class _Suspects:
    """Pixels that stand out.

    Attributes
    ----------
    places : ndarray of int64, shape (N,)
        Row times width plus column.
    scores : ndarray of float64, shape (N,)
        Log likelihood ratio of a defect against the scene.
    travels : ndarray of float64, shape (N, 2)
        How far the scene has moved there since they were last asked, px.
    defective : ndarray of bool, shape (N,)
    """

    places: np.ndarray
    scores: np.ndarray
    travels: np.ndarray
    defective: np.ndarray

    def select(self, which: np.ndarray) -> _Suspects:
        return _Suspects(
            places=self.places[which],
            scores=self.scores[which],
            travels=self.travels[which],
            defective=self.defective[which],
        )


class DefectivePixels:
    """Learns which pixels stand out at one place while the scene moves on, and repairs them.

    A pixel stands out where it is brighter, or darker, than all pixels of a ring around it. That
    happens in the scene too, but not at the same pixel once the scene has moved by more than such a
    dot is wide. So images are asked only at that distance from each other, as the tracks nearby
    tell it, and every answer adds its log likelihood ratio (sequential test: A. Wald, 1945,
    doi:10.1214/aoms/1177731118): a defect stands out in most images, the scene at a pixel as
    rarely as it does anywhere in this image. Where nothing moves nothing is learnt.

    Repaired pixels, the defect with its eight neighbours, are interpolated from the ring.
    """

    def __init__(self) -> None:
        self._suspects = _no_suspects()
        self._images = 0
        self._shape = (0, 0)
        self._taken = np.empty((0, 0), bool)  # a page of its own takes longer than filling this

    @property
    def pixels(self) -> np.ndarray:
        """Centres of the defects found, int64 (N, 2), column and row."""
        rows, columns = np.divmod(self._defects, max(self._shape[1], 1))
        return np.stack([columns, rows], axis=1)

    @property
    def _defects(self) -> np.ndarray:
        return self._suspects.places[self._suspects.defective]

    def learn(self, image: np.ndarray, tracks: Tracks) -> None:
        """Look at an image, uint8 (H, W), as it came; the tracks lead to it from the one before."""
        if image.shape != self._shape:
            self._suspects, self._shape = _no_suspects(), (image.shape[0], image.shape[1])
            self._taken = np.empty(image.shape, bool)
            self._images = 0
        self._images += 1
        if self._images > _FIRST_IMAGES and self._images % _LATER_EVERY:
            return
        outstanding = _outstanding(image).reshape(-1)
        places = np.flatnonzero(outstanding)
        rate = min(max(len(places), 1) / image.size, 0.5)
        known = self._suspects
        seen = outstanding[known.places]
        # What is not known to be a defect and stands out no more was the scene.
        known, seen = known.select(seen | known.defective), seen[seen | known.defective]
        known = self._judged(known, seen, rate, tracks)
        outstanding[known.places] = False
        new = places[outstanding[places]]
        self._suspects = _merged(known, new, math.log(_DETECTION_RATE / rate))

    def _judged(self, known: _Suspects, seen: np.ndarray, rate: float, tracks: Tracks) -> _Suspects:
        """The suspects with what this image adds, as far as the scene has moved."""
        travels = known.travels + self._motion_at(known.places, tracks)
        asked = np.hypot(*travels.T) >= _MIN_MOTION_PX
        miss = math.log((1.0 - _DETECTION_RATE) / (1.0 - rate))
        gains = np.where(seen, math.log(_DETECTION_RATE / rate), miss)
        enough = math.log(math.prod(self._shape) / _FALSE_ALARMS)
        scores = known.scores + np.where(asked, gains, 0.0)
        defective = (known.defective | (scores >= enough)) & (scores > enough + _MOST_MISSES * miss)
        return _Suspects(
            places=known.places,
            scores=np.minimum(scores, enough),
            travels=np.where(asked[:, None], 0.0, travels),
            defective=defective,
        )

    def _motion_at(self, places: np.ndarray, tracks: Tracks) -> np.ndarray:
        """How far (N, 2) the scene has moved at some places, px: the median of nearby tracks.

        Tracks beside the places themselves may follow them, and not the scene.
        """
        if len(places) == 0 or len(tracks) < _NEIGHBOURS:
            return np.zeros((len(places), 2))
        pixels = np.stack(np.divmod(places, self._shape[1])[::-1], axis=1)
        taken = self._taken
        taken.fill(False)
        cover(pixels, taken, _PULL_PX)
        columns, rows = np.rint(tracks.points1).astype(np.int64).T
        height, width = self._shape
        free = ~taken[rows.clip(0, height - 1), columns.clip(0, width - 1)]
        points, moves = tracks.points1[free], (tracks.points1 - tracks.points0)[free]
        if len(points) < _NEIGHBOURS:
            return np.zeros((len(places), 2))
        # Made for one look: a tree that is not balanced takes a third of the time.
        tree = KDTree(points, balanced_tree=False, compact_nodes=False)
        near = tree.query(pixels, _NEIGHBOURS)[1]
        return np.median(moves[near], axis=1)

    def repaired(self, image: np.ndarray) -> np.ndarray:
        """The image without its defects; itself where there is none. The one given stays as is."""
        places = self._defects
        if len(places) == 0 or image.shape != self._shape:
            return image
        result = np.array(image, order="C")
        values, width = result.reshape(-1), image.shape[1]
        ring, inner = (places[:, None] + v * width + u for v, u in (_RING_AT.T, _INNER_AT.T))
        for _ in range(2):  # where two are neighbours, the first pass takes one for the scene
            values[inner] = np.rint(values[ring] @ _INTERPOLATION).astype(np.uint8)
        return result


def _no_suspects() -> _Suspects:
    return _Suspects(
        places=np.empty(0, np.int64),
        scores=np.empty(0),
        travels=np.empty((0, 2)),
        defective=np.empty(0, bool),
    )


def _merged(known: _Suspects, new: np.ndarray, score: float) -> _Suspects:
    """The suspects, and behind them new ones."""
    count = len(new)
    return _Suspects(
        places=np.concatenate([known.places, new]),
        scores=np.concatenate([known.scores, np.full(count, score)]),
        travels=np.concatenate([known.travels, np.zeros((count, 2))]),
        defective=np.concatenate([known.defective, np.zeros(count, bool)]),
    )


def _outstanding(image: np.ndarray) -> np.ndarray:
    """Which pixels, bool (H, W), are brighter or darker than all of the ring around them."""
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    kernel = np.ones((2 * _RING + 1, 2 * _RING + 1), np.uint8)
    kernel[1:-1, 1:-1] = 0
    above = cv2.subtract(image, cv2.dilate(image, kernel))  # saturates at 0
    below = cv2.subtract(cv2.erode(image, kernel), image)
    out = cv2.max(above, below) >= _MIN_CONTRAST
    out[:_RING] = out[-_RING:] = False
    out[:, :_RING] = out[:, -_RING:] = False
    return out


def _offsets(reach: int) -> np.ndarray:
    """Rows and columns (N, 2) from a pixel to all within a reach."""
    return np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T


def _interpolation() -> np.ndarray:
    """Weights (ring, inner): the mean of two straight lines, across and down, between the ring."""
    weights = np.zeros((len(_RING_AT), len(_INNER_AT)))
    at = {(int(v), int(u)): k for k, (v, u) in enumerate(_RING_AT)}
    for k, (v, u) in enumerate(_INNER_AT.tolist()):
        for end in (-_RING, _RING):
            weights[at[v, end], k] += 0.5 * (_RING + math.copysign(u, u * end)) / (2 * _RING)
            weights[at[end, u], k] += 0.5 * (_RING + math.copysign(v, v * end)) / (2 * _RING)
    return weights


_INNER_AT = _offsets(_REACH)
_RING_AT = np.array([at for at in _offsets(_RING).tolist() if max(map(abs, at)) == _RING])
_INTERPOLATION = _interpolation()
