"""``farpoint compile``: compilation of the kernels before their first use."""

from __future__ import annotations

from dataclasses import dataclass

from farpoint.fleet.kernels import compile_kernels

__all__ = ["Compile"]


@dataclass(frozen=True, kw_only=True)
class Compile:
    """Compile the kernels into numba's cache, for container images and machines of a fleet.

    The cache is beside the package, or in the folder that ``NUMBA_CACHE_DIR`` names.
    """

    def __call__(self) -> None:
        """Run the command."""
        compile_kernels()
        print("compiled")
