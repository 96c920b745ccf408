"""A process that compiles a kernel computes the digits of one that loads it from the cache."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

MATCH = """
import hashlib
import numpy as np
from farpoint.tracks import LucasKanadeOptions, RefinementOptions
from farpoint.tracks.pyramid import build_pyramid
from farpoint.tracks.refinement import refine

y, x = np.mgrid[:120.0, :160.0]
images = [
    np.uint8(127.5 + 60.0 * np.sin(0.31 * (x + s) + 0.13 * y) + 60.0 * np.cos(0.27 * y - 0.05 * x))
    for s in (0.0, 1.3)
]
points = np.random.default_rng(0).uniform(30.0, 90.0, (60, 2))
pyramids = [build_pyramid(image, LucasKanadeOptions()) for image in images]
matched = refine(*pyramids, points, points, RefinementOptions())
print(hashlib.sha256(matched[0].tobytes() + matched[1].tobytes()).hexdigest())
"""


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_matches_have_the_same_digits_compiled_and_loaded(tmp_path: Path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    compiled, loaded = (
        subprocess.run(
            [sys.executable, "-c", MATCH],
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            check=True,
        ).stdout
        for _ in range(2)
    )
    assert len(compiled) == 65
    assert compiled == loaded
