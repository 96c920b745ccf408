"""The kernels mean the same to Python as to numba: their tests once more, interpreted."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="is what this test runs")
def test_the_kernels_pass_their_tests_interpreted():
    here = Path(__file__)
    # Compiled, unsigned words wrap around and infinity minus infinity is NaN; NumPy's scalars do
    # the same with a warning.
    options = ["-p", "no:cacheprovider", "-W", "ignore::RuntimeWarning", "--tb=short"]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *options, str(here.parent)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-4000:]
