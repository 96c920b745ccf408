"""The tests of the kernels, interpreted instead of compiled."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
# Kernels that are tested where they are used.
ELSEWHERE = [
    HERE.parent / "synthetic" / "test_raycast.py",
    f"{HERE.parent / 'tracks' / 'test_refinement.py'}::"
    "test_the_kernel_computes_what_plain_numpy_computes",
]


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="is what this test runs")
def test_the_kernels_pass_their_tests_interpreted():
    options = ["-p", "no:cacheprovider", "--tb=short"]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *map(str, [HERE, *ELSEWHERE])],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-4000:]
