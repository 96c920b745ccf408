"""Compiled loops of synthetic scenes: ray casting, and filtered textures of surfaces."""

from pathlib import Path

from farpoint._kernels.compile import SHARED_KERNELS, forget_stale

forget_stale(Path(__file__).parent, SHARED_KERNELS)
