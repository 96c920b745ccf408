"""What numba is asked once: which type a function of its own returns, for given arguments."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core.datamodel.models import OpaqueModel
from numba.core.typing.context import Context
from numba.extending import register_model

__all__ = ["RememberingContext"]


class _Known(types.Function):
    """A function of numba's own that is asked once for what it returns.

    It asks some dozen rules, of strings or dates, whenever two numbers are added. What kernels that
    add in any order are told, with functions made for them, is theirs alone.
    """

    def __init__(self, function: types.Function, any_order: bool) -> None:
        self._any_order = any_order
        self._answers: dict[Any, Any] = {}
        super().__init__(function.templates)

    @property
    def key(self) -> Any:
        """What numba tells types apart by."""
        return *super().key, self._any_order

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Signature of a call."""
        if kws:
            return super().get_call_type(context, args, kws)
        if args not in self._answers:
            self._answers[args] = super().get_call_type(context, args, kws)
        return self._answers[args]


register_model(_Known)(OpaqueModel)  # a value of nothing, as before

# For the life of the process.
_KNOWN: dict[tuple[types.Function, bool], _Known] = {}


class RememberingContext(Context):
    """The types that numba knows, another view of the same table."""

    _any_order: bool

    def __init__(self, table: Context, any_order: bool) -> None:
        self.__dict__ = table.__dict__ | {"_any_order": any_order}

    def refresh(self) -> None:
        """Nothing: the table itself has been."""

    def _lookup_global(self, gv: Any) -> Any:
        found = super()._lookup_global(gv)
        if type(found) is not types.Function:
            return found
        key = found, self._any_order
        if key not in _KNOWN:
            _KNOWN[key] = _Known(*key)
        return _KNOWN[key]
