"""Mapping of samples with more than 8 bits to 8 bits, the same for all images of a source."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["EXAMPLES", "GreyTable"]

EXAMPLES = 8
"""Number of images, spread over a source, from which the table is computed."""

_DEPTHS = (8, 10, 12, 14, 16)
"""Bits of common sensors."""

_LEAST_CONTRAST = 64
"""Least range of the samples, grey levels of the upper 8 bits, for which the upper 8 bits are used.
The samples of a stretched image span 128 grey levels."""

_TAIL = 0.001
"""Share of the darkest, and of the brightest, samples that may saturate (convention)."""

_HEADROOM = 0.5
"""Margin below and above the range of the samples, divided by this range."""

_EVERY = 7
"""Subsampling of the pixels along both axes."""


@dataclass(frozen=True, eq=False)
class GreyTable:
    """Grey values of deep samples, which are samples with more than 8 bits.

    Attributes
    ----------
    values : ndarray of uint8, shape (65536,)
        The grey value of each sample.
    words : str
        Description of the mapping for the user; empty if the upper 8 of 16 bits are used.
    """

    values: np.ndarray
    words: str

    @classmethod
    def for_images(cls, images: Sequence[np.ndarray]) -> GreyTable:
        """Table for a source, from example images (H, W), uint16.

        The table maps the upper 8 of the bits in use. If the result would span less than 1/4 of the
        grey values (as for raw counts of a thermal camera), the table maps the range of the
        samples, extended by a margin.
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
        """Table from example images of a source, up to the first image with 8 bits."""
        deep = []
        for image in examples:
            if image.dtype != np.uint16:
                break
            deep.append(image)
        return cls.for_images(deep) if deep else cls.upper_bits(16)

    @classmethod
    def upper_bits(cls, bits: int) -> GreyTable:
        """Table of the upper 8 of ``bits`` bits; larger samples saturate."""
        values = np.minimum(np.arange(1 << 16) >> (bits - 8), 255).astype(np.uint8)
        words = f"The images have {bits} bits in 16: the upper 8 of these are used."
        return cls(values, "" if bits == 16 else words)

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Grey values (H, W), uint8, of samples (H, W), uint16."""
        return self.values[image]
