"""Compiled loops of synthetic scenes: rays that meet surfaces, and the textures on these."""

from pathlib import Path

from farpoint._kernels.compile import SHARED_KERNELS, forget_stale

forget_stale(Path(__file__).parent, SHARED_KERNELS)
