"""Kernels compiled ahead are all that a run uses."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

# In a process of its own, where nothing is compiled or loaded yet. A dispatcher of numba has a
# signature for each combination of argument types that it was compiled for, and a cache if Python
# calls it.
SCRIPT = """
import sys
import numpy as np
import farpoint as fp
from farpoint.fleet.kernels import compile_kernels
from farpoint.sinks.overlay.canvas import Canvas
from farpoint.sinks.overlay.palette import RED_GREEN
from farpoint.synthetic import render_drive

def signatures():
    return {
        f"{name}.{key}": value.signatures
        for name, module in sys.modules.items()
        if name.startswith("farpoint.") and not name.startswith("farpoint.synthetic")
        for key, value in vars(module).items()
        if hasattr(value, "signatures") and value.stats.cache_path is not None
    }

compile_kernels()
ahead = signatures()
print(sorted(name for name, compiled in ahead.items() if len(compiled) != 1))
for distortion in ((), (-0.2, 0.05, 1e-3, 0.0)):
    camera = fp.Camera.pinhole(320, 240, 240.0, 240.0, 159.5, 119.5, distortion=distortion)
    odometry = fp.Odometry(camera.with_readout(0.02, 0.002))
    for frame in render_drive(camera, frames=15, seed=3):
        result = odometry.process(frame.image, frame.timestamp)
pane = np.zeros((60, 80, 3), np.uint8)
canvas = Canvas(pixels=pane, scale=np.ones(2), stroke=1, palette=RED_GREEN)
canvas.dots(result.tracks.points1, RED_GREEN.far, 2.0)
rng = np.random.default_rng(0)
for trial in range(60):
    noise_px, translation = rng.uniform(0.1, 2.0), rng.normal(0.0, 0.1, 3) * (trial % 4)
    points = rng.uniform([-2.0, -1.5, 3.0], [2.0, 1.5, 3.0 + 10.0 ** rng.uniform(-2, 2)], (80, 3))
    pixels = [
        camera.project(seen) + rng.normal(0.0, noise_px, (80, 2))
        for seen in (points, points + translation)
    ]
    fp.estimate_relative_pose(*pixels, camera)
    covariance = np.tile(np.diag([1.0, 2.0]), (80, 1, 1))
    fp.estimate_relative_pose(*pixels, camera, covariance0_px2=covariance)
print(sorted(name for name, compiled in signatures().items() if len(compiled) != 1))
"""


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_every_kernel_is_compiled_ahead_and_only_once():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=300
    )
    assert done.stdout.splitlines() == ["[]", "[]"]
