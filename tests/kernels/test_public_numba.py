"""Kernels use the public interface of numba, and Python calls only kernels with a wrapper."""

from __future__ import annotations

import ast
import os
import re
from importlib import import_module
from pathlib import Path

import pytest

import farpoint

SOURCES = Path(farpoint.__file__).parent
KERNELS = SOURCES / "_kernels"
# Called by kernels only: these have no wrapper for Python.
INNER = {"inner_kernel", "inlined_kernel", "sum_kernel", "inner_loop_kernel"}
PRIVATE = re.compile(r"^(numba\.(core|_\w+|np|cpython|misc|typed|stencils)\b|llvmlite\b)")


def imported(source: Path) -> list[str]:
    names = []
    for node in ast.walk(ast.parse(source.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def decorators(source: Path) -> dict[str, set[str]]:
    return {
        node.name: {ast.unparse(each) for each in node.decorator_list}
        for node in ast.parse(source.read_text()).body
        if isinstance(node, ast.FunctionDef)
    }


def test_nothing_private_of_numba_is_imported():
    found = {
        (source.name, name)
        for source in SOURCES.rglob("*.py")
        for name in imported(source)
        if PRIVATE.match(name)
    }
    assert not found
    assert PRIVATE.match("numba.core.errors")
    assert PRIVATE.match("llvmlite.ir")
    assert not PRIVATE.match("numba.extending.type_callable")


def test_python_calls_no_kernel_that_only_kernels_may_call():
    of_module = {source.stem: decorators(source) for source in KERNELS.glob("*.py")}
    called = 0
    for source in SOURCES.rglob("*.py"):
        if source.parent == KERNELS:
            continue
        for name in imported(source):
            if name.startswith("farpoint._kernels."):
                module, function = name.split(".")[2:4]
                called += 1
                assert not of_module[module].get(function, set()) & INNER, (source.name, name)
    assert called > 50


def plain_functions(source: Path) -> dict[str, ast.FunctionDef]:
    return {
        node.name: node
        for node in ast.parse(source.read_text()).body
        if isinstance(node, ast.FunctionDef) and not node.decorator_list
    }


def test_plain_functions_among_the_kernels_call_none_either():
    """Such as `motion.fit_motion`, which calls one kernel after another."""
    inner = {
        name
        for source in KERNELS.glob("*.py")
        for name, by in decorators(source).items()
        if by & INNER
    }
    for source in KERNELS.glob("*.py"):
        for name, node in plain_functions(source).items():
            calls = {
                each.func.id
                for each in ast.walk(node)
                if isinstance(each, ast.Call) and isinstance(each.func, ast.Name)
            }
            assert not calls & inner, (source.name, name)


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_kernels_for_python_let_go_of_the_interpreter():
    motion = import_module("farpoint._kernels.motion")
    assert motion._search.targetoptions["nogil"]
