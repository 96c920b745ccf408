"""Kernels compiled ahead are all that a run uses."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

# In a process of its own, where nothing is compiled or loaded yet. A dispatcher of numba has a
# signature for each combination of argument types that it was compiled for.
SCRIPT = """
import sys
import numpy as np
import farpoint as fp
from farpoint.fleet.kernels import compile_kernels
from farpoint.sinks.overlay.canvas import Canvas
from farpoint.sinks.overlay.palette import RED_GREEN
from farpoint.synthetic import render_drive

def compiled():
    return {
        f"{name}.{key}{signature}"
        for name, module in sys.modules.items() if name.startswith("farpoint._kernels.")
        for key, value in vars(module).items()
        for signature in getattr(value, "signatures", ())
    }

compile_kernels()
ahead = compiled()
for distortion in ((), (-0.2, 0.05, 1e-3, 0.0)):
    camera = fp.Camera.pinhole(480, 360, 360.0, 360.0, 239.5, 179.5, distortion=distortion)
    odometry = fp.Odometry(camera.with_readout(0.02, 0.002))
    for frame in render_drive(camera, frames=25, seed=3):
        result = odometry.process(frame.image, frame.timestamp)
pane = np.zeros((60, 80, 3), np.uint8)
canvas = Canvas(pixels=pane, scale=np.ones(2), stroke=1, palette=RED_GREEN)
canvas.dots(result.tracks.points1, RED_GREEN.far, 2.0)
print(sorted(compiled() - ahead))
"""


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_a_run_compiles_nothing_further():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=300
    )
    assert done.stdout.strip().splitlines()[-1] == "[]"
