"""Kernels of tests, which call those of the project, are compiled anew when these change."""

from __future__ import annotations

from pathlib import Path

from farpoint._kernels import compile as compiling

compiling.forget_stale(Path(__file__).parent, Path(compiling.__file__).parent)
