"""How kernels reach the engine's arrays: by one pointer, to a table of the addresses of all of them.

`s.row` loads an address from the table. The compiler is told that addresses never change, so it loads each
only once, or keeps it. If kernels handed over all pointers one by one, every call of one by another would be
a hundred instructions, and compilation would take longer. There is one such table for all kinds of scenes.
"""

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic, models, register_model

from hardspheres.kernel.arrays import TYPES

__all__ = ["TABLE_BYTES", "addresses", "pointers_at"]

# First comes the table's own address: the compiler can be told that what is loaded points to a whole table.
PLACES = {name: place for place, name in enumerate(TYPES, 1)}
TABLE_BYTES = 8 * (1 + len(PLACES))


def addresses(arrays: Any) -> Any:
    """Return the addresses of all arrays; whoever hands them to a kernel keeps the arrays alive."""
    table = np.array([0, *(array.__array_interface__["data"][0] for array in arrays)], dtype=np.int64)
    table[0] = table.__array_interface__["data"][0]
    return table


class Addresses(types.Type):  # type: ignore[misc]
    """A pointer to the addresses of all arrays."""

    def __init__(self) -> None:
        super().__init__("Addresses")


register_model(Addresses)(models.OpaqueModel)


@infer_getattr
class _Pointers(AttributeTemplate):
    key = Addresses

    def generic_resolve(self, _table: Any, name: str) -> Any:  # type: ignore[override]
        """Return the type of the pointer to an array."""
        return types.CPointer(numba.from_dtype(np.dtype(TYPES[name])))


@lower_getattr_generic(Addresses)
def _load_pointer(context: Any, builder: Any, _table: Any, value: Any, name: str) -> Any:
    pointer = context.get_value_type(types.CPointer(numba.from_dtype(np.dtype(TYPES[name]))))
    table = builder.bitcast(value, pointer.as_pointer())
    loaded = builder.load(builder.gep(table, [ir.IntType(64)(PLACES[name])]))
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded


@intrinsic
def pointers_at(_context: Any, array: Any) -> Any:
    """Return the record of pointers, of which `addresses` made an array."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        kind = context.get_value_type(signature.return_type)
        table = builder.load(builder.bitcast(data, kind.as_pointer()))
        table.set_metadata("dereferenceable", builder.module.add_metadata([ir.IntType(64)(TABLE_BYTES)]))
        return table

    return Addresses()(array), codegen
