"""Detection and repair of hot and dead pixels, from image motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from farpoint.errors import optional_import
from farpoint.tracks.constants import (
    DEFECT_REACH_PX,
    DEFECT_RING_PX,
    DETECTION_RATE,
    FALSE_DETECTIONS,
    FIRST_IMAGES,
    LATER_EVERY,
    MAX_MISSES,
    MIN_DEFECT_CONTRAST,
    MIN_MOTION_PX,
    MOTION_NEIGHBOURS,
    SUSPECT_PULL_PX,
)
from farpoint.tracks.kernels.spacing import cover
from farpoint.tracks.tracks import Tracks

__all__ = ["DefectivePixels"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Suspects:
    """Pixels that may be defective: brighter or darker than all pixels of a surrounding ring.

    Attributes
    ----------
    indices : ndarray of int64, shape (N,)
        Flat index of the pixel: row times width plus column.
    scores : ndarray of float64, shape (N,)
        Log likelihood ratio of the two explanations "defective pixel" and "scene content".
    displacements : ndarray of float64, shape (N, 2)
        Image motion at the pixel since the last test of the pixel, px.
    defective : ndarray of bool, shape (N,)
        Whether the pixel is classified as defective.
    """

    indices: np.ndarray
    scores: np.ndarray
    displacements: np.ndarray
    defective: np.ndarray

    def select(self, which: np.ndarray) -> _Suspects:
        return _Suspects(
            indices=self.indices[which],
            scores=self.scores[which],
            displacements=self.displacements[which],
            defective=self.defective[which],
        )


class DefectivePixels:
    """Detects defective pixels, which stand out even while the image moves, and repairs them.

    A pixel stands out if the 16 pixels of the square ring around the pixel (5 px wide) are all
    darker, or all brighter, by at least 6 grey levels. Scene content can stand out, too, but
    usually not at the same pixel after an image motion of 1 px. A pixel that stands out becomes a
    suspect. A suspect is tested again whenever the image has moved by 1 px at the suspect since the
    last test. Each test adds a log likelihood ratio (sequential test: A. Wald, 1945,
    doi:10.1214/aoms/1177731118). A defective pixel is assumed to stand out with a probability of
    0.8, any other pixel with a probability equal to the share of pixels of the image that stand
    out.

    A repair replaces the defective pixel and the eight neighbours by values interpolated from the
    ring.
    """

    def __init__(self) -> None:
        self._suspects = _no_suspects()
        self._images = 0
        self._shape = (0, 0)
        self._near_suspects = np.empty((0, 0), bool)  # buffer, because allocation is slow

    @property
    def pixels(self) -> np.ndarray:
        """Positions of the defective pixels, int64 (N, 2), column and row."""
        rows, columns = np.divmod(self._defects, max(self._shape[1], 1))
        return np.stack([columns, rows], axis=1)

    @property
    def _defects(self) -> np.ndarray:
        return self._suspects.indices[self._suspects.defective]

    def learn(self, image: np.ndarray, tracks: Tracks) -> None:
        """Test the suspects in an unrepaired image, uint8 (H, W).

        ``tracks`` are the matches from the reference image to this image.
        """
        if image.shape != self._shape:
            self._suspects, self._shape = _no_suspects(), (image.shape[0], image.shape[1])
            self._near_suspects = np.empty(image.shape, bool)
            self._images = 0
        self._images += 1
        if self._images > FIRST_IMAGES and self._images % LATER_EVERY:
            return
        outstanding = _outstanding(image).reshape(-1)
        indices = np.flatnonzero(outstanding)
        rate = min(max(len(indices), 1) / image.size, 0.5)
        known = self._suspects
        seen = outstanding[known.indices]
        # A suspect that does not stand out was scene content, unless the suspect is already
        # classified as defective.
        known, seen = known.select(seen | known.defective), seen[seen | known.defective]
        known = self._scored(known, seen, rate, tracks)
        outstanding[known.indices] = False
        new = indices[outstanding[indices]]
        self._suspects = _merged(known, new, math.log(DETECTION_RATE / rate))

    def _scored(self, known: _Suspects, seen: np.ndarray, rate: float, tracks: Tracks) -> _Suspects:
        """The suspects with updated scores.

        The score of a suspect changes only if the image motion since the last test of the suspect
        is 1 px or more. ``seen`` marks the suspects that stand out in the current image, and
        ``rate`` is the share of the pixels of the image that stand out.
        """
        displacements = known.displacements + self._motion_at(known.indices, tracks)
        tested = np.hypot(*displacements.T) >= MIN_MOTION_PX
        miss = math.log((1.0 - DETECTION_RATE) / (1.0 - rate))
        gains = np.where(seen, math.log(DETECTION_RATE / rate), miss)
        enough = math.log(math.prod(self._shape) / FALSE_DETECTIONS)
        scores = known.scores + np.where(tested, gains, 0.0)
        defective = (known.defective | (scores >= enough)) & (scores > enough + MAX_MISSES * miss)
        return _Suspects(
            indices=known.indices,
            scores=np.minimum(scores, enough),
            displacements=np.where(tested[:, None], 0.0, displacements),
            defective=defective,
        )

    def _motion_at(self, indices: np.ndarray, tracks: Tracks) -> np.ndarray:
        """Image motion (N, 2), px, at suspects given by flat index: median of the nearest tracks.

        Tracks within 5 px of any suspect are excluded, because such tracks may follow a defect
        instead of the scene.
        """
        if len(indices) == 0 or len(tracks) < MOTION_NEIGHBOURS:
            return np.zeros((len(indices), 2))
        pixels = np.stack(np.divmod(indices, self._shape[1])[::-1], axis=1)
        near_suspects = self._near_suspects
        near_suspects.fill(False)
        cover(pixels, near_suspects, SUSPECT_PULL_PX)
        columns, rows = np.rint(tracks.points1).astype(np.int64).T
        height, width = self._shape
        free = ~near_suspects[rows.clip(0, height - 1), columns.clip(0, width - 1)]
        points, moves = tracks.points1[free], (tracks.points1 - tracks.points0)[free]
        if len(points) < MOTION_NEIGHBOURS:
            return np.zeros((len(indices), 2))
        # For one query an unbalanced tree is three times as fast.
        tree = KDTree(points, balanced_tree=False, compact_nodes=False)
        near = tree.query(pixels, MOTION_NEIGHBOURS)[1]
        return np.median(moves[near], axis=1)

    def repaired(self, image: np.ndarray) -> np.ndarray:
        """A copy of the image with repaired defects, or the image itself if no defect is known."""
        indices = self._defects
        if len(indices) == 0 or image.shape != self._shape:
            return image
        result = np.array(image, order="C")
        values, width = result.reshape(-1), image.shape[1]
        ring, inner = (indices[:, None] + v * width + u for v, u in (_RING_AT.T, _INNER_AT.T))
        for _ in range(2):  # in the first pass, a ring may still contain another defect
            values[inner] = np.rint(values[ring] @ _INTERPOLATION).astype(np.uint8)
        return result


def _no_suspects() -> _Suspects:
    return _Suspects(
        indices=np.empty(0, np.int64),
        scores=np.empty(0),
        displacements=np.empty((0, 2)),
        defective=np.empty(0, bool),
    )


def _merged(known: _Suspects, new: np.ndarray, score: float) -> _Suspects:
    """The known suspects, and new suspects with the given score."""
    count = len(new)
    return _Suspects(
        indices=np.concatenate([known.indices, new]),
        scores=np.concatenate([known.scores, np.full(count, score)]),
        displacements=np.concatenate([known.displacements, np.zeros((count, 2))]),
        defective=np.concatenate([known.defective, np.zeros(count, bool)]),
    )


def _outstanding(image: np.ndarray) -> np.ndarray:
    """Mask (H, W) of pixels that are brighter, or darker, than all pixels of their ring."""
    cv2 = optional_import("cv2", extra="video", purpose="tracking")
    kernel = np.ones((2 * DEFECT_RING_PX + 1, 2 * DEFECT_RING_PX + 1), np.uint8)
    kernel[1:-1, 1:-1] = 0
    above = cv2.subtract(image, cv2.dilate(image, kernel))  # saturates at 0
    below = cv2.subtract(cv2.erode(image, kernel), image)
    out = cv2.max(above, below) >= MIN_DEFECT_CONTRAST
    out[:DEFECT_RING_PX] = out[-DEFECT_RING_PX:] = False
    out[:, :DEFECT_RING_PX] = out[:, -DEFECT_RING_PX:] = False
    return out


def _offsets(reach: int) -> np.ndarray:
    """Offsets (N, 2), row and column, of all pixels of a square from -reach to reach."""
    return np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1).T


def _interpolation() -> np.ndarray:
    """Weights (16, 9) with which the pixels of the ring give the pixels inside the ring.

    A pixel inside is the mean of a horizontal and a vertical linear interpolation.
    """
    weights = np.zeros((len(_RING_AT), len(_INNER_AT)))
    at = {(int(v), int(u)): k for k, (v, u) in enumerate(_RING_AT)}
    for k, (v, u) in enumerate(_INNER_AT.tolist()):
        for end in (-DEFECT_RING_PX, DEFECT_RING_PX):
            weights[at[v, end], k] += (
                0.5 * (DEFECT_RING_PX + math.copysign(u, u * end)) / (2 * DEFECT_RING_PX)
            )
            weights[at[end, u], k] += (
                0.5 * (DEFECT_RING_PX + math.copysign(v, v * end)) / (2 * DEFECT_RING_PX)
            )
    return weights


_INNER_AT = _offsets(DEFECT_REACH_PX)
_RING_AT = np.array(
    [at for at in _offsets(DEFECT_RING_PX).tolist() if max(map(abs, at)) == DEFECT_RING_PX]
)
_INTERPOLATION = _interpolation()
