"""What every test may ask for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

# Kernels that only kernels call are called by their tests, too; said before any is imported.
os.environ["FARPOINT_TEST_KERNELS"] = "1"

# The same examples in every run: a change is judged by what it changes, not by luck.
settings.register_profile("same", derandomize=True, deadline=None)
settings.load_profile("same")

# Compiled, unsigned words wrap around, 1 / 0 is infinite and infinity minus infinity is NaN; where
# kernels are interpreted, NumPy's scalars do the same with a warning.
OF_KERNELS = r"ignore:(overflow|divide by zero|invalid value) encountered:RuntimeWarning"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let kernels compute without warnings when they are not compiled."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        for item in items:
            item.add_marker(pytest.mark.filterwarnings(OF_KERNELS))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real sequences with truth; tests that need it skip where it is absent."""
    folder = Path(
        os.environ.get("FARPOINT_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")
    ).resolve()
    if not folder.is_dir():
        pytest.skip(f"real sequences not found at {folder} (set FARPOINT_DATA)")
    return folder
