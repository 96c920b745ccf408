"""Textures filtered over the footprint of a pixel by mip pyramids.

The minor axis of the footprint selects the mip level of a trilinear lookup (Williams, "Pyramidal
Parametrics", SIGGRAPH 1983). For a long footprint, several lookups are averaged along the major
axis of the footprint (McCormack et al., "Feline", SIGGRAPH 1999).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from farpoint._kernels.compile import inlined_kernel
from farpoint.synthetic.kernels.constants import MAX_TEXTURE_LOOKUPS, TEXEL_WIDTH_PX
from farpoint.synthetic.kernels.scene_arrays import Finish

__all__ = ["Footprint", "filtered", "footprint_of", "scaled"]


class Footprint(NamedTuple):
    """Elliptical footprint of a pixel on a texture, in the texture's units."""

    u: float
    """Centre."""
    v: float
    major_u: float
    """Major axis."""
    major_v: float
    minor: float
    """Length of the minor axis."""


@inlined_kernel
def bilinear(
    texels: np.ndarray, start: int, log2_width: int, level: int, u: float, v: float
) -> float:
    """Bilinear value of a level of a periodic pyramid at ``u, v``, in texels of level 0."""
    skipped = ((1 << (2 * log2_width + 2)) - (1 << (2 * (log2_width - level) + 2))) // 3
    width = 1 << (log2_width - level)
    x, y = u / (1 << level) - 0.5, v / (1 << level) - 0.5
    left, top = math.floor(x), math.floor(y)
    fx, fy = x - left, y - top
    i0, i1 = int(left) & (width - 1), int(left + 1) & (width - 1)
    j0 = start + skipped + (int(top) & (width - 1)) * width
    j1 = start + skipped + (int(top + 1) & (width - 1)) * width
    upper = texels[j0 + i0] + fx * (texels[j0 + i1] - texels[j0 + i0])
    lower = texels[j1 + i0] + fx * (texels[j1 + i1] - texels[j1 + i0])
    return upper + fy * (lower - upper)


@inlined_kernel
def trilinear(
    texels: np.ndarray, start: int, log2_width: int, level: float, u: float, v: float
) -> float:
    """Value of a pyramid at a fractional ``level``, interpolated between two levels."""
    below = min(int(level), log2_width)
    above = min(below + 1, log2_width)
    fine = bilinear(texels, start, log2_width, below, u, v)
    coarse = bilinear(texels, start, log2_width, above, u, v)
    return fine + (level - below) * (coarse - fine)


@inlined_kernel
def footprint_of(
    u: float, v: float, right: tuple[float, float], down: tuple[float, float]
) -> Footprint:
    """Footprint of a pixel, from the steps in (u, v) to the pixels on the right and below."""
    (ux, vx), (uy, vy) = right, down
    uu, uv, vv = ux * ux + uy * uy, ux * vx + uy * vy, vx * vx + vy * vy
    half_sum, half_difference = 0.5 * (uu + vv), 0.5 * (uu - vv)
    root = math.sqrt(half_difference * half_difference + uv * uv)
    major, minor = math.sqrt(half_sum + root), math.sqrt(max(half_sum - root, 0.0))
    angle = 0.5 * math.atan2(uv, half_difference)
    return Footprint(u, v, major * math.cos(angle), major * math.sin(angle), minor)


@inlined_kernel
def scaled(footprint: Footprint, u: float, v: float, scale: float) -> Footprint:
    """Footprint moved to ``u, v``, with position and lengths multiplied by ``scale``."""
    major_u, major_v, minor = footprint.major_u, footprint.major_v, footprint.minor
    return Footprint(u * scale, v * scale, major_u * scale, major_v * scale, minor * scale)


@inlined_kernel
def filtered(finish: Finish, index: int, footprint: Footprint) -> float:
    """Mean of a texture over a footprint, which is given in texels."""
    texels, texture = finish.texels, finish.texture
    start, log2_width = texture[index, 0], texture[index, 1]
    u, v, major_u, major_v, minor = footprint
    major = math.sqrt(major_u * major_u + major_v * major_v)
    width = max(minor, major / MAX_TEXTURE_LOOKUPS)
    level = math.log2(max(width * TEXEL_WIDTH_PX, 1.0))
    taps = max(1, math.ceil(major / width - 0.25))
    if taps == 1:
        return trilinear(texels, start, log2_width, level, u, v)
    total, weights = 0.0, 0.0
    for k in range(taps):
        place = (2 * k + 1 - taps) / taps
        weight = 1.0 - place * place
        reach = 0.9 * place * (1.0 - width / major)
        value = trilinear(
            texels, start, log2_width, level, u + reach * major_u, v + reach * major_v
        )
        total, weights = total + weight * value, weights + weight
    return total / weights
