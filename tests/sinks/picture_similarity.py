"""Whether two pictures look the same to a person."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

WIDTH = 640  # of a reference: a phone's
REDRAW = "FARPOINT_DRAW_REFERENCES"

_BLUR_PX = 1.2
_MEAN, _SEEN, _SHARE = 0.6, 6.0, 2e-4


@dataclass(frozen=True)
class PictureSimilarity:
    """How far apart two pictures are, in CIE Lab after a little blur.

    One in `mean` is what a trained eye just notices on a whole picture; `share` is the part of the
    picture where anybody sees a difference: in a picture of thin lines it is what counts.
    """

    mean: float
    share: float

    @property
    def same(self) -> bool:
        return self.mean < _MEAN and self.share < _SHARE


def picture_similarity(a: np.ndarray, b: np.ndarray) -> PictureSimilarity:
    """Compare two RGB pictures of one size."""
    assert a.shape == b.shape

    def lab(picture: np.ndarray) -> np.ndarray:
        seen = cv2.GaussianBlur(picture.astype(np.float32) / 255.0, (0, 0), _BLUR_PX)
        return cv2.cvtColor(seen, cv2.COLOR_RGB2LAB)

    difference = np.linalg.norm(lab(a) - lab(b), axis=-1)
    return PictureSimilarity(
        mean=float(difference.mean()), share=float((difference > _SEEN).mean())
    )


def at_phone_width(picture: np.ndarray) -> np.ndarray:
    height = round(picture.shape[0] * WIDTH / picture.shape[1])
    return cv2.resize(picture, (WIDTH, height), interpolation=cv2.INTER_AREA)


def assert_looks_like(picture: np.ndarray, reference: Path, scratch: Path) -> None:
    """Compare with a reference, which `REDRAW` in the environment draws anew."""
    drawn = at_phone_width(picture)
    if os.environ.get(REDRAW):
        reference.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(reference), drawn[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    assert reference.is_file(), f"no reference; look at what {REDRAW}=1 draws"
    expected = cv2.imread(str(reference))[..., ::-1]
    found = picture_similarity(drawn, expected)
    if not found.same:
        beside = scratch / reference.name
        cv2.imwrite(str(beside), np.hstack([expected, drawn])[..., ::-1])
        raise AssertionError(f"{found}: look at {beside}; if the right half is right, {REDRAW}=1")
