"""Compiled loops of the path over the observations of a window, and matrices of a window."""

from pathlib import Path

from farpoint._kernels.compile import SHARED_KERNELS, forget_stale

forget_stale(Path(__file__).parent, SHARED_KERNELS, Path(__file__).parents[1] / "constants.py")
