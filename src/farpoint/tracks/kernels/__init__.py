"""Compiled loops of the tracker over pixels, windows and corners."""

from pathlib import Path

from farpoint._kernels.compile import SHARED_KERNELS, forget_stale

forget_stale(Path(__file__).parent, SHARED_KERNELS, Path(__file__).parents[1] / "constants.py")
