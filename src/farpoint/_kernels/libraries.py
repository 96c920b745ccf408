"""Where compiled code is kept: as it was lowered, until a door to Python takes it in.

`linking` tells what that is for.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen

__all__ = ["DoorLibrary", "FormulaLibrary", "InnerLibrary", "SumLibrary"]

# Where a numba has no such inner parts, it fails here and not in the middle of an estimate.
_RELIED_ON = (
    JITCodeLibrary._finalize_dynamic_globals,
    JITCodeLibrary._get_module_for_linking,
    JITCodeLibrary._optimize_final_module,
    JITCPUCodegen._module_pass_manager,
    JITCPUCodegen._pass_builder,
    llvm.create_new_function_pass_manager,
)


class InnerLibrary(JITCodeLibrary):
    """Code for callers alone."""

    def finalize(self) -> None:
        """Make it ready to be taken in, which is less than ready to run."""
        self._finalize_dynamic_globals()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage.name == "external":
                function.linkage = "linkonce_odr"  # several callers may hold it
        self._shared_module = self._final_module
        self._finalized = True

    def _optimize_functions(self, ll_module: Any) -> None:
        """Only what makes it small: callers optimise it together with themselves."""
        ll_module.data_layout = self._codegen._data_layout
        passes, settings = llvm.create_new_function_pass_manager(), self._codegen._pass_builder()
        passes.add_sroa_pass()
        passes.add_simplify_cfg_pass()
        for function in ll_module.functions:
            if not function.is_declaration:
                passes.run(function, settings)

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002 - numba's interface
        """None: there is no machine code."""
        return 0


class FormulaLibrary(InnerLibrary):
    """Code for callers alone, written as small as they would make it."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout


class SumLibrary(InnerLibrary):
    """Code that may add in any order: optimised by itself, so that all callers get one order."""

    def finalize(self) -> None:
        """Take in all that it calls, and optimise that."""
        for library in _taken_in(self):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._optimize_final_module()
        super().finalize()
        self._linking_libraries = []


class DoorLibrary(JITCodeLibrary):
    """Code that Python calls."""

    def _optimize_functions(self, ll_module: Any) -> None:
        """Nothing yet: unpacking arguments holds no loop, and waits for the whole."""
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Take in all that it calls, optimise that, and make machine code of it."""
        self._linking_libraries = list(_taken_in(self))
        super().finalize()

    def _optimize_final_module(self) -> None:
        """Once: numba does so twice, for references that would be counted between functions."""
        passes, settings = self._codegen._module_pass_manager()
        passes.run(self._final_module, settings)


def _taken_in(library: JITCodeLibrary) -> Iterable[JITCodeLibrary]:
    """Every library that this one calls, directly or by way of others, once."""
    found: dict[JITCodeLibrary, None] = {}
    waiting = list(library._linking_libraries)
    while waiting:
        other = waiting.pop(0)
        if other not in found:
            found[other] = None
            if isinstance(other, InnerLibrary):
                waiting.extend(other._linking_libraries)
    return found
