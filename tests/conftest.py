"""What every test may ask for."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from numba import typeof

from farpoint._kernels import compile as compiling

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


@pytest.fixture(autouse=True, scope="session")
def same_types_at_every_door() -> Iterator[None]:
    """Hold the arguments of kernels that take records against the types they are compiled for.

    After the first call such a kernel does not look at types any more: here it does, in all tests.
    """
    with pytest.MonkeyPatch.context() as patch:
        if os.environ.get("NUMBA_DISABLE_JIT") != "1" and compiling.with_door is not None:
            from farpoint._kernels.linking import RecordDoor

            straight = RecordDoor.__call__

            def checked(door: RecordDoor, *arguments: object) -> object:
                for compiled in door.overloads:
                    assert tuple(map(typeof, arguments)) == compiled
                return straight(door, *arguments)

            patch.setattr(RecordDoor, "__call__", checked)
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real sequences with truth; tests that need it skip where it is absent."""
    folder = Path(
        os.environ.get("FARPOINT_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")
    ).resolve()
    if not folder.is_dir():
        pytest.skip(f"real sequences not found at {folder} (set FARPOINT_DATA)")
    return folder
