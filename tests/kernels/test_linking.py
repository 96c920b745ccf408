"""Kernels are compiled once, as a part of what Python calls."""

from __future__ import annotations

import gc
import math
import os
import pkgutil
import subprocess
import sys
from importlib import import_module
from typing import NamedTuple, get_args, get_type_hints

import numba
import numpy as np
import pytest
from numba import types
from numba.core.caching import NullCache
from numba.core.runtime import _nrt_python, rtsys

from farpoint import _kernels
from farpoint._kernels import compile as compiling
from farpoint._kernels import scratch
from farpoint._kernels.compile import inlined_kernel, inner_kernel, kernel, sum_kernel

if os.environ.get("NUMBA_DISABLE_JIT") == "1":
    pytest.skip("nothing is compiled", allow_module_level=True)
if compiling.with_door is None:
    pytest.skip("this numba has other inner parts", allow_module_level=True)

from farpoint._kernels.linking import RecordDoor


@inlined_kernel
def square(x):
    return x * x


@sum_kernel
def sum_of_squares(values):
    total = 0.0
    for i in range(values.shape[0]):
        total += square(values[i])
    return total


@inner_kernel
def mean_square(values):
    return sum_of_squares(values) / values.shape[0]


class Weighted(NamedTuple):
    values: np.ndarray
    weight: float


@inner_kernel
def weighted_sum(weighted: Weighted) -> float:
    return weighted.weight * weighted.values.sum()


def uncached(inner):
    assert compiling.with_door is not None
    door = compiling.with_door(inner)
    door._cache = NullCache()
    return door


def root_mean_square_of(values):
    return math.sqrt(mean_square(values))


VALUES = np.array([3.0, 4.0, 3.0, 4.0])
ROOT = math.sqrt(12.5)


@pytest.fixture(scope="module")
def root_mean_square():
    return uncached(inner_kernel(root_mean_square_of))


@pytest.fixture(scope="module")
def root_plus_one(root_mean_square):
    @inner_kernel
    def root_plus_one(values):
        return root_mean_square(values) + 1.0

    return uncached(root_plus_one)


def test_kernels_call_kernels_of_every_kind(root_mean_square, root_plus_one):
    assert root_plus_one(VALUES) == ROOT + 1.0
    assert root_mean_square(VALUES) == ROOT
    assert sum_of_squares(VALUES) == 50.0


def test_what_kernels_call_has_no_machine_code_of_its_own(root_mean_square, root_plus_one):
    root_plus_one(VALUES)
    (code,) = root_mean_square.inner.overloads.values()
    assert code.library.get_pointer_to_function(code.fndesc.llvm_func_name) == 0


def test_a_door_holds_all_that_its_kernel_calls(root_plus_one):
    root_plus_one(VALUES)
    (code,) = root_plus_one.overloads.values()
    missing = [f.name for f in code.library._final_module.functions if f.is_declaration]
    assert not [name for name in missing if "square" in name]


def test_a_kernel_is_lowered_once_for_python_and_for_kernels(root_mean_square, root_plus_one):
    root_plus_one(VALUES)
    root_mean_square(VALUES)
    (inner,) = root_mean_square.inner.overloads.values()
    (door,) = root_mean_square.overloads.values()
    assert door.fndesc is inner.fndesc


@pytest.mark.parametrize("wanted", [True, False])
def test_collection_of_garbage_is_left_as_it_was(wanted):
    @inner_kernel
    def half(x):
        return 0.5 * x

    before = gc.isenabled()
    (gc.enable if wanted else gc.disable)()
    try:
        assert uncached(half)(3.0) == 1.5
        assert gc.isenabled() is wanted
    finally:
        (gc.enable if before else gc.disable)()


def test_a_numba_with_other_inner_parts_compiles_in_its_own_way(monkeypatch):
    monkeypatch.setattr(compiling, "with_door", None)
    first_square = compiling.njit(lambda values: values[0] * values[0])

    def first_square_plus_one(values):
        return first_square(values) + 1.0

    plain = kernel(first_square_plus_one)
    plain._cache = NullCache()
    assert not hasattr(plain, "inner")
    assert plain(VALUES) == 10.0


def ir_of(inner):
    (code,) = inner.overloads.values()
    return str(code.library._final_module)


def test_references_are_counted_only_where_an_array_is_made():
    @inner_kernel
    def reads(values):
        first = values
        return first[1:][0]

    @inner_kernel
    def makes(values):
        made = np.empty(1)
        made[0] = reads(values)
        return made[0]

    assert uncached(makes)(VALUES) == 4.0
    assert "NRT_incref" not in ir_of(reads)
    assert "NRT_" in ir_of(makes)


def test_memory_that_a_kernel_makes_is_given_back():
    @inner_kernel
    def total(size):
        made, places = scratch.room(size), scratch.index_room(size)
        for i in range(size):
            made[i], places[i] = 0.5 * i, i
        sum_of_both = 0.0
        for i in range(size):
            sum_of_both += made[i] + places[i]
        return sum_of_both

    door = uncached(total)
    assert door(4) == 9.0
    _nrt_python.memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    assert door(1000) == 1.5 * 499500.0
    after = rtsys.get_allocation_stats()
    _nrt_python.memsys_disable_stats()
    assert after.alloc - before.alloc == after.free - before.free == 2


def test_numbers_on_the_stack_are_not_counted():
    @inner_kernel
    def first(values):
        small, place = scratch.scratch(2), scratch.index_scratch(1)
        place[0] = 1
        small[place[0]] = values[0]
        return small[1]

    assert uncached(first)(VALUES) == 3.0
    assert "NRT_" not in ir_of(first)


def test_kernels_hand_over_values_as_they_are():
    @inner_kernel
    def turned(weighted, pair, is_wanted):
        larger = pair[0] > pair[1]
        return larger == is_wanted, (weighted.weight, weighted.values[pair[0]])

    @inner_kernel
    def both(weighted, is_wanted):
        first, (weight, value) = turned(weighted, (2, 1), is_wanted)
        second, _ = turned(weighted, (0, 1), is_wanted)
        return first, second, weight * value

    door = uncached(both)
    weighted = Weighted(np.arange(4.0), 0.5)
    assert door(weighted, True) == (True, False, 1.0)
    assert door(weighted, False) == (False, True, 1.0)
    for code in turned.overloads.values():
        function = code.library._final_module.get_function(code.fndesc.llvm_func_name)
        assert len(list(function.arguments)) == 3
    assert "excinfo" not in ir_of(both)


def test_functions_of_numbas_own_are_called_in_its_way():
    @inner_kernel
    def middle(values):
        return math.hypot(np.sort(values)[1], 4.0)

    values = np.array([4.0, 1.0, 3.0])
    assert uncached(middle)(values) == 5.0
    # What was compiled for the kernel serves others, too.
    assert numba.njit(lambda values: np.sort(values)[0])(values) == 1.0


def test_elements_of_tuples_keep_their_types():
    @inner_kernel
    def mixed(values):
        several = (values, 2, 0.5)
        return several[0][1] * several[1] * several[2] + values.shape[0]

    assert uncached(mixed)(VALUES) == 8.0


def test_numba_is_asked_once_what_a_sum_of_two_numbers_is(monkeypatch):
    asked = []
    really = types.Function.get_call_type

    def counted(function, context, args, kws):
        asked.append((function.typing_key, args))
        return really(function, context, args, kws)

    monkeypatch.setattr(types.Function, "get_call_type", counted)

    @inner_kernel
    def sums(x):
        return (x + 1.5) + (x + 2.5) + x

    assert uncached(sums)(np.complex64(1.0)) == 7.0
    assert {kind for _, kind in asked} == {
        (types.complex64, types.float64),
        (types.complex128, types.complex128),
        (types.complex128, types.complex64),
    }
    assert len(asked) == 3


def test_what_is_made_for_sums_in_any_order_is_for_them_alone():
    @sum_kernel
    def least_in_any_order(values):
        least = values[0]
        for i in range(values.shape[0]):
            least = min(least, values[i])
        return least

    @inner_kernel
    def least(values):
        return min(least_in_any_order(values), values[0], values[1])

    assert uncached(least)(VALUES) == 3.0
    assert "fcmp reassoc" in ir_of(least_in_any_order.inner)
    assert "fcmp reassoc" not in ir_of(least)


def test_a_kernel_that_takes_records_is_gone_to_straight_after_its_first_call(monkeypatch):
    door = uncached(weighted_sum)
    assert isinstance(door, RecordDoor)
    assert door(Weighted(VALUES, 2.0)) == 28.0
    # numba asks a record for its type by this, which now nobody asks for.
    monkeypatch.setattr(type(door), "typeof_pyval", None)
    assert RecordDoor.__call__(door, Weighted(2.0 * VALUES, 0.5)) == 14.0
    assert len(door.overloads) == 1


def test_a_kernel_that_takes_arrays_looks_at_their_types(root_mean_square):
    assert not isinstance(root_mean_square, RecordDoor)
    assert root_mean_square(VALUES.astype(np.float32)) == pytest.approx(ROOT)


def test_what_is_on_disk_is_loaded_without_what_would_compile_it(tmp_path):
    """Importing that takes longer than an estimate."""
    script = """
import sys
from farpoint import Camera
rays = Camera.pinhole(640, 480, 500, 500, 319.5, 239.5).unproject([[819.5, 239.5]])
print(abs(rays[0]).round(3).tolist(), "numba.np.linalg" in sys.modules)
"""
    outputs = [
        subprocess.run(
            [sys.executable, "-c", script],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)},
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        ).stdout.strip()
        for _ in range(2)
    ]
    assert outputs == ["[0.707, 0.0, 0.707] True", "[0.707, 0.0, 0.707] False"]


def test_no_kernel_hands_a_record_to_python():
    """numba would run Python to make it, which Ctrl-C may end there, and would crash."""
    doors = {
        name: kind
        for module in pkgutil.iter_modules(_kernels.__path__)
        for name, kind in vars(import_module(f"{_kernels.__name__}.{module.name}")).items()
        if isinstance(kind, type(uncached(weighted_sum)).__base__)
    }
    assert len(doors) > 30
    for name, door in doors.items():
        returned = get_type_hints(door.py_func)["return"]
        assert not any(holds_record(kind) for kind in (returned, *get_args(returned))), name


def holds_record(kind) -> bool:
    return isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields")
