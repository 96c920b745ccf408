"""Kernels are compiled once, together with all that they call.

numba optimises each function and turns it into machine code, and then does so again within each of
its callers. Of some hundred functions Python calls a dozen. Here a function stays as it was lowered
until one of those takes it in: a *door* to Python links all that its kernel calls, directly or not,
and only that is optimised and becomes machine code.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Literal, get_type_hints

from numba import types
from numba._dynfunc import make_function  # pyright: ignore[reportMissingModuleSource]
from numba.core import compiler, errors, ir, typed_passes, untyped_passes
from numba.core.caching import FunctionCache
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.ir_utils import check_and_legalize_ir
from numba.core.registry import CPUDispatcher
from numba.core.runtime.nrt import rtsys
from numba.core.targetconfig import ConfigStack

from farpoint._kernels.calls import Call, as_kernel
from farpoint._kernels.known_types import RememberingContext
from farpoint._kernels.libraries import DoorLibrary, FormulaLibrary, InnerLibrary, SumLibrary
from farpoint._kernels.scratch import index_scratch, scratch

__all__ = ["InnerCompiler", "RecordDoor", "inner_library", "with_door"]

_errors: Any = errors  # of which the type hints lack a part
# Where a numba has no such inner parts, it fails here and not in the middle of an estimate.
_RELIED_ON = (
    _errors._termcolor_inst,
    FunctionCache._guard_against_spurious_io_errors,
    FunctionCache._load_overload,
)


def inner_library(codegen: Any, name: str) -> FormulaLibrary:
    """Room for the code of a formula."""
    return FormulaLibrary(codegen, name)


@register_pass(mutates_CFG=True, analysis_only=False)
class _InnerInference(typed_passes.NopythonTypeInference):
    """Inference of types, of elements at a constant place as such: a tuple gives these at once."""

    _name = "farpoint_inner_inference"

    def run_pass(self, state: Any) -> Literal[True]:
        """Tell these elements from others, and infer."""
        constants = (ir.Const, ir.Global, ir.FreeVar)
        for block in state.func_ir.blocks.values():
            for assign in block.find_insts(ir.Assign):
                item = assign.value
                if not (isinstance(item, ir.Expr) and item.op == "getitem"):
                    continue
                definitions = state.func_ir._definitions[item.index.name]
                place = definitions[0] if len(definitions) == 1 else None
                if isinstance(place, constants) and isinstance(place.value, int):
                    assign.value = ir.Expr.static_getitem(
                        item.value, place.value, item.index, item.loc
                    )
        return super().run_pass(state)


@register_pass(mutates_CFG=True, analysis_only=False)
class _InnerLowering(typed_passes.NativeLowering):
    """Lowering into a library of the inner kind."""

    _name = "farpoint_inner_lowering"

    def run_pass(self, state: Any) -> Literal[True]:
        """Lower, and tell numba under which name callers find the function."""
        kind = SumLibrary if state.flags.fastmath else InnerLibrary
        library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library = library
        state.flags.no_compile = True
        # References to arrays are counted, and dropped, only where an array is made.
        state.flags.nrt = state.targetctx.enable_nrt = _makes_array(state.calltypes, state.typemap)
        if state.flags.nrt:
            check_and_legalize_ir(state.func_ir, state.flags)
        # numba writes and reads a program whenever it looks for the size of a type.
        state.targetctx.get_abi_sizeof = partial(_size_of, state.targetctx.target_data)
        super().run_pass(state)
        library.finalize()
        lowered = state["cr"]
        name = lowered.fndesc.qualname.split(".")[-1]
        module = lowered.fndesc.lookup_module()
        token = make_function(module, name, "", 0, lowered.env, (library,))
        call = Call(lowered.fndesc, (library,))
        state.targetctx._defns[token].append(call, call.signature)
        state["cr"] = lowered._replace(cfunc=token)
        return True


_SIZES: dict[str, int] = {}


def _size_of(target_data: Any, kind: Any) -> int:
    """Bytes of an LLVM type, of which there is one target."""
    name = str(kind)
    if name not in _SIZES:
        _SIZES[name] = kind.get_abi_size(target_data)
    return _SIZES[name]


def _makes_array(signatures: dict[Any, Any], kinds: dict[str, Any]) -> bool:
    """Whether a call, of these in a kernel, returns an array that is not on the stack."""
    return any(
        isinstance(called, ir.Expr)
        and called.op == "call"
        and isinstance(signature.return_type, types.Array)
        and getattr(kinds[called.func.name], "typing_key", None) not in (scratch, index_scratch)
        for called, signature in signatures.items()
    )


# What kernels need of numba's passes. Others look for what no kernel has (closures, exceptions,
# loops over tuples of several types, arguments that are None, variables that change their type),
# and take their time to find that out.
_PASSES = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    _InnerInference,
    _InnerLowering,
    typed_passes.NoPythonBackend,
)


class InnerCompiler(compiler.CompilerBase):
    """Compiles what only kernels call, as far as they need it."""

    def __init__(self, typingctx: Any, *arguments: Any) -> None:
        super().__init__(typingctx, *arguments)
        as_kernel(self.state.targetctx)
        table = RememberingContext(typingctx, bool(self.state.flags.fastmath))
        self.state.typingctx = self.state.targetctx.typing_context = table
        # As for types: it looks for new registries whenever one has no answer.
        self.state.targetctx.refresh = table.refresh

    def define_pipelines(self) -> list[Any]:
        """The passes that kernels need."""
        pipeline = PassManager("kernel")
        for each in _PASSES:
            pipeline.add_pass(each, each.__name__)
        pipeline.finalize()
        return [pipeline]


class _DoorCompiler(compiler.CompilerBase):
    """Makes of a compiled kernel something that Python can call."""

    def __init__(self, inner: Any, *arguments: Any) -> None:
        super().__init__(*arguments)
        as_kernel(self.state.targetctx)
        self._inner = inner

    def compile_extra(self, func: Callable[..., object]) -> Any:
        """The kernel ``func`` with its arguments unpacked, and all that it calls."""
        with _no_collection(), _plain_messages(), ConfigStack().enter(self.state.flags.copy()):
            arguments, context = tuple(self.state.args), self.state.targetctx
            self._inner.compile(arguments)
            kernel = self._inner.overloads[arguments]
            library = DoorLibrary(context.codegen(), func.__qualname__)
            library.enable_object_caching()
            library.add_linking_library(kernel.library)
            with context.push_code_library(library):
                context.create_cpython_wrapper(
                    library, kernel.fndesc, kernel.environment, kernel.call_helper
                )
            entry = context.get_executable(library, kernel.fndesc, kernel.environment)
            return kernel._replace(
                library=library,
                entry_point=entry,
                metadata={},
                reload_init=list(getattr(library, "_reload_init", ())),
            )


@contextmanager
def _no_collection() -> Iterator[None]:
    """Collect no garbage: the compiler makes much that lasts, and little that does not."""
    wanted = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if wanted:
            gc.enable()


class _Plain:
    """Messages without colours."""

    def __getattr__(self, _role: str) -> Callable[[str], str]:
        return str


@contextmanager
def _plain_messages() -> Iterator[None]:
    """Paint no messages: numba does so at every step, with what it would say if that failed."""
    painter = _errors._termcolor_inst
    _errors._termcolor_inst = _Plain()
    try:
        yield
    finally:
        _errors._termcolor_inst = painter


class _DoorCache(FunctionCache):
    """What has been compiled, on disk."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Machine code, or None; numba would import all that it can compile, to find it."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class _Door(CPUDispatcher):
    """A kernel for Python to call, cached on disk; kernels call the ``inner`` one."""

    def __init__(self, inner: Any) -> None:
        pipeline: Any = partial(_DoorCompiler, inner)
        super().__init__(
            py_func=inner.py_func,
            targetoptions=dict(inner.targetoptions, no_cpython_wrapper=False),
            pipeline_class=pipeline,
        )
        self.inner = inner
        self.enable_caching()

    def enable_caching(self) -> None:
        """Keep what is compiled."""
        self._cache = _DoorCache(self.py_func)

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self.inner)


class RecordDoor(_Door):
    """A door to a kernel that takes records (named tuples), which only farpoint makes.

    numba asks each value for its type, and a record for those of all that it holds: several
    microseconds a call. Records hold the same types every time, so after the first call one goes
    straight to the machine code.
    """

    def __init__(self, inner: Any) -> None:
        super().__init__(inner)
        self._straight: Callable[..., Any] = self._first

    def __call__(  # pyright: ignore[reportIncompatibleMethodOverride] - nothing goes by name
        self, *arguments: Any
    ) -> Any:
        """What the kernel makes of arguments of the types that it was first called with."""
        return self._straight(*arguments)

    def _first(self, *arguments: Any) -> Any:
        result = super().__call__(*arguments)
        [compiled] = self.overloads.values()
        self._straight = compiled.entry_point
        return result


def with_door(inner: Any) -> Any:
    """The kernel for Python to call, of one that kernels call; the same where nothing compiles."""
    if not isinstance(inner, CPUDispatcher):
        return inner
    return RecordDoor(inner) if _takes_records(inner.py_func) else _Door(inner)


def _takes_records(function: Callable[..., object]) -> bool:
    kinds = get_type_hints(function).values()
    return any(isinstance(kind, type) and issubclass(kind, tuple) for kind in kinds)
