"""``farpoint compile``: kernels compiled ahead of their first use."""

from __future__ import annotations

from dataclasses import dataclass

from farpoint.fleet.kernels import compile_kernels

__all__ = ["Compile"]


@dataclass(frozen=True, kw_only=True)
class Compile:
    """Compile the kernels into numba's cache, for container images and machines of a fleet.

    The cache is beside the package, or in the folder ``NUMBA_CACHE_DIR``.
    """

    def __call__(self) -> None:
        """Do it."""
        compile_kernels()
        print("compiled")
