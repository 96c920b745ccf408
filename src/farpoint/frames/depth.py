"""From deep samples to the 8 bits that tracking needs, the same way for all images of a source."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["EXAMPLES", "GreyTable"]

EXAMPLES = 8
"""Images, spread over all of a source, by which the table is made."""

_DEPTHS = (8, 10, 12, 14, 16)
"""Bits that sensors give."""

_LEAST_CONTRAST = 64
"""Grey levels, of 256, that an image must span so that its upper 8 bits are taken as they are: half
of what a stretched one spans."""

_TAIL = 0.001
"""Share of the darkest, and of the brightest, samples that may saturate (convention)."""

_HEADROOM = 0.5
"""Of the span on either side, for images that are darker or brighter than those looked at."""

_EVERY = 7
"""Samples looked at: one of so many along both axes."""


@dataclass(frozen=True, eq=False)
class GreyTable:
    """Grey values of deep samples.

    Attributes
    ----------
    values : ndarray of uint8, shape (65536,)
        The grey value of each sample.
    words : str
        What is done, for a person; empty where the upper 8 of 16 bits are taken.
    """

    values: np.ndarray
    words: str

    @classmethod
    def for_images(cls, images: Sequence[np.ndarray]) -> GreyTable:
        """The table for a source of which these images (H, W), uint16, are examples.

        The upper 8 of the bits that are in use, or, where these would span less than 1/4 of
        the grey values (a thermal camera's raw counts), the span of the samples with headroom.
        """
        some = np.concatenate([image[::_EVERY, ::_EVERY].ravel() for image in images])
        low, high = (int(value) for value in np.quantile(some, (_TAIL, 1.0 - _TAIL)))
        in_use = max(int(image.max()) for image in images).bit_length()
        bits = next(depth for depth in _DEPTHS if depth >= in_use)
        if high - low >= _LEAST_CONTRAST << (bits - 8):
            return cls.upper_bits(bits)
        margin = max(_HEADROOM * (high - low), 1.0)
        begin, end = low - margin, high + margin
        scaled = (np.arange(1 << 16) - begin) * (255.0 / (end - begin))
        words = (
            f"The images are deeper than 8 bits: samples from {max(begin, 0):.0f} to {end:.0f} are "
            "shown as grey values from 0 to 255, the same in all images."
        )
        return cls(np.clip(np.rint(scaled), 0, 255).astype(np.uint8), words)

    @classmethod
    def for_source(cls, examples: Iterable[np.ndarray]) -> GreyTable:
        """The table by examples from all over a source, as far as the first that is not deep."""
        deep = []
        for image in examples:
            if image.dtype != np.uint16:
                break
            deep.append(image)
        return cls.for_images(deep) if deep else cls.upper_bits(16)

    @classmethod
    def upper_bits(cls, bits: int) -> GreyTable:
        """The upper 8 of so many bits; larger samples saturate."""
        values = np.minimum(np.arange(1 << 16) >> (bits - 8), 255).astype(np.uint8)
        words = f"The images have {bits} bits in 16: the upper 8 of these are used."
        return cls(values, "" if bits == 16 else words)

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Grey values (H, W), uint8, of samples, uint16."""
        return self.values[image]
