"""Ctrl-C may come at any moment of an estimate."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

# An alarm stands for Ctrl-C: it comes from within, a random time after an estimate began.
INTERRUPTED = """
import random, signal
import numpy as np
from farpoint import Camera, estimate_relative_pose

camera = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5)
points = np.random.default_rng(1).uniform(50.0, 400.0, (2, 40, 2))
estimate_relative_pose(*points, camera)

def interrupt(*_):
    raise KeyboardInterrupt

signal.signal(signal.SIGALRM, interrupt)
random.seed(1)
interrupted = 0
for _ in range(3000):
    try:
        signal.setitimer(signal.ITIMER_REAL, random.uniform(2e-5, 4e-4))
        estimate_relative_pose(*points, camera)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    except KeyboardInterrupt:
        interrupted += 1
print(interrupted)
"""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no such alarm on this system")
def test_an_estimate_can_be_interrupted_anywhere():
    run = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout) > 100
