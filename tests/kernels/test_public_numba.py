"""Kernels use the public interface of numba, and Python calls only kernels with a wrapper."""

from __future__ import annotations

import ast
import os
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

import farpoint

SOURCES = Path(farpoint.__file__).parent
# Folders of kernels: those that any kernel may call with the two-view estimator, and those of one
# package each.
KERNELS = [SOURCES / "_kernels", *sorted(SOURCES.glob("*/kernels"))]
# Called by kernels only: these have no wrapper for Python.
INNER = {"inner_kernel", "inlined_kernel", "sum_kernel"}
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


def kernel_files() -> list[Path]:
    return [source for folder in KERNELS for source in folder.glob("*.py")]


def module_name(source: Path) -> str:
    parts = source.relative_to(SOURCES.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_python_calls_no_kernel_that_only_kernels_may_call():
    of_module = {module_name(source): decorators(source) for source in kernel_files()}
    called = 0
    for source in SOURCES.rglob("*.py"):
        if source.parent in KERNELS:
            continue
        for name in imported(source):
            assert name not in of_module, "functions of a whole module would not be seen here"
            module, _, function = name.rpartition(".")
            if module in of_module:
                called += 1
                assert not of_module[module].get(function, set()) & INNER, (source.name, name)
    assert called > 50


def test_kernels_import_shared_kernels_and_those_and_the_numbers_of_their_package():
    packages = {"numpy", "numba", *sys.stdlib_module_names}
    for source in kernel_files():
        own = module_name(source.parent.parent)
        allowed = ["farpoint._kernels."]
        if source.parent != KERNELS[0]:
            allowed += [f"{own}.kernels.", f"{own}.constants."]
        for name in imported(source):
            if name.startswith("farpoint"):
                assert name.startswith(tuple(allowed)), (source, name)
            else:
                assert name.split(".")[0] in packages, (source, name)


def plain_functions(source: Path) -> dict[str, ast.FunctionDef]:
    return {
        node.name: node
        for node in ast.parse(source.read_text()).body
        if isinstance(node, ast.FunctionDef) and not node.decorator_list
    }


def test_plain_functions_among_the_kernels_call_none_either():
    """Such as `motion.fit_motion`, which calls one kernel after another."""
    inner = {
        name for source in kernel_files() for name, by in decorators(source).items() if by & INNER
    }
    for source in kernel_files():
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
    resection = import_module("farpoint.path.kernels.resection")
    assert resection.locate.targetoptions["nogil"]
