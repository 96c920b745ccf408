"""How kernels call one another: with values as they are, and without a word of errors.

numba hands an array over as seven numbers, a record of arrays as those of all, and asks after every
call whether it failed. No kernel fails; and a third of all that was compiled was this.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import llvmlite.ir as llvm
from numba.core import cgutils
from numba.core.callconv import CPUCallConv, Status, errcode_t, excinfo_ptr_t
from numba.core.cpu import CPUContext
from numba.core.imputils import impl_ret_new_ref

__all__ = ["Call", "as_kernel"]

_YES, _NO = (llvm.Constant(llvm.IntType(1), truth) for truth in (True, False))
_FINE = Status(
    code=llvm.Constant(errcode_t, 0),
    is_ok=_YES,
    is_none=_NO,
    is_error=_NO,
    is_stop_iteration=_NO,
    is_python_exc=_NO,
    is_user_exc=_NO,
    excinfoptr=llvm.Constant(excinfo_ptr_t, llvm.Undefined),
)


def as_kernel(context: Any) -> None:
    """Have numba's target, which is that of one function alone, compile it as a kernel."""
    context.__class__ = _KernelContext


@dataclass
class Call:
    """What writes down a call of a kernel that has been compiled, for numba."""

    described: Any
    libs: tuple[Any, ...]

    @property
    def signature(self) -> Any:
        """Types of its arguments."""
        return self.described.argtypes

    def __call__(self, context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        """Its result."""
        convention, kind = _KernelConvention(context), self.described.restype
        called = convention.declared(builder.module, self.described)
        _, value = convention.call_function(builder, called, kind, self.signature, values)
        return impl_ret_new_ref(context, builder, kind, value)


class _KernelConvention(CPUCallConv):
    """Arguments and results as numba holds them."""

    def get_function_type(self, restype: Any, argtypes: Any) -> Any:
        """LLVM's type of a kernel."""
        models = self.context.data_model_manager
        given = [models[kind].get_value_type() for kind in argtypes]
        return llvm.FunctionType(models[restype].get_return_type(), given)

    def declared(self, module: Any, described: Any) -> Any:
        """The kernel, in this module."""
        kind = self.get_function_type(described.restype, described.argtypes)
        return cgutils.get_or_insert_function(module, kind, described.mangled_name)

    def get_arguments(self, func: Any) -> Any:
        """What a kernel is given."""
        return func.args

    def decode_arguments(self, builder: Any, argtypes: Any, func: Any) -> Any:  # noqa: ARG002
        """The same."""
        return list(func.args)

    def return_value(self, builder: Any, retval: Any) -> None:
        """End with a result."""
        builder.ret(retval)

    def call_function(
        self, builder: Any, callee: Any, resty: Any, argtys: Any, args: Any, attrs: Any = None
    ) -> Any:
        """Call a kernel, or a function of numba's own in its own way."""
        if callee.function_type != self.get_function_type(resty, argtys):
            own = CPUCallConv(self.context)
            _, value = own.call_function(builder, callee, resty, argtys, args, attrs)
            return _FINE, value
        value = builder.call(callee, args, attrs=attrs or ())
        return _FINE, self.context.get_returned_value(builder, resty, value)

    def return_status_propagate(self, builder: Any, status: Any) -> None:
        """Nothing: none fails."""

    def raise_error(self, builder: Any, pyapi: Any, status: Any) -> None:
        """Nothing: none fails."""

    def return_user_exc(self, builder: Any, *_: Any, **__: Any) -> None:
        """No kernel has a range of step zero, or asks for an element of a tuple that has fewer."""
        builder.unreachable()


class _KernelContext(CPUContext):
    """Numba's target, for one kernel."""

    @property
    def call_conv(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """How it is called, and calls others."""
        return _KernelConvention(self)

    def declare_function(self, module: Any, fndesc: Any) -> Any:
        """The kernel itself, or a function of numba's own that it calls."""
        if fndesc is not self.fndesc:
            return _plain(self).declare_function(module, fndesc)
        return self.call_conv.declared(module, fndesc)

    def compile_subroutine(self, *arguments: Any, **options: Any) -> Any:
        """A function of numba's own, which others may call, too."""
        return _plain(self).compile_subroutine(*arguments, **options)


def _plain(context: Any) -> Any:
    """The target as it is for functions that are no kernels."""
    other = copy.copy(context)
    other.__class__ = CPUContext
    other.__dict__.pop("call_conv", None)
    return other
