"""From JAX functions to a plan: one block of memory, and machine code that works in it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from slidax._errors import DefinitionError
from slidax.codegen import llvm
from slidax.codegen.trace import trace
from slidax.realtime import Coded, Plan, Slot

WORD = 8


class Planner:
    """Places arrays in one block of memory, and compiles code that knows their places.

    Raises DefinitionError if llvmlite is not installed.
    """

    def __init__(self) -> None:
        if not llvm.available():
            raise DefinitionError(
                "a law that is called sample by sample needs llvmlite, which is not installed: "
                "pip install 'slidax[native]'"
            )
        self._parts: list[np.ndarray] = []
        self._size = 0
        self._routines: dict[str, Coded] = {}
        self._views: dict[str, Slot] = {}
        self._regions: dict[str, tuple[int, int]] = {}

    def place(self, tree: Any, name: str = "") -> Any:
        """Place each array of a tree; return the tree of places.

        - `tree`: arrays with their initial values, or shapes, which begin as zeros.
        - `name`: of the region that they form together; none if empty.
        """
        start = self._size
        placed = jax.tree.map(self._put, tree)
        if name:
            self._regions[name] = (start, self._size)
        return placed

    def view(self, name: str, array: Any) -> Slot:
        """Place one array under a name."""
        self._views[name] = slot = self._put(array)
        return slot

    def named(self, name: str, slot: Slot) -> None:
        """Name a placed array."""
        self._views[name] = slot

    def region(self, name: str, first: Slot, last: Slot) -> None:
        """Name the region from one array to another, both included."""
        self._regions[name] = (first.offset, -(-last.end // WORD) * WORD)

    def code(self, name: str, kernel: llvm.Kernel, inputs: Any, outputs: Any) -> None:
        """Add machine code; `inputs` and `outputs` are trees of places in the kernel's order."""
        slots: list[Slot] = [*jax.tree.leaves(inputs, is_leaf=_is_slot), *jax.tree.leaves(outputs, is_leaf=_is_slot)]
        shapes = [*(entry.shape for entry in kernel.inputs), *(entry.shape for entry in kernel.outputs)]
        assert [slot.shape for slot in slots] == shapes
        self._routines[name] = Coded(kernel.object, kernel.entry, tuple(slot.offset for slot in slots))

    def plan(self) -> Plan:
        """Return the plan."""
        return Plan(b"".join(part.tobytes() for part in self._parts), self._routines, self._views, self._regions)

    def _put(self, array: Any) -> Slot:
        shape, dtype = tuple(np.shape(array)), np.dtype(array.dtype)
        if isinstance(array, jax.ShapeDtypeStruct):
            shape, held = tuple(array.shape), np.zeros(array.shape, dtype)
        else:
            held = np.asarray(array)
        slot = Slot(self._size, shape, dtype.str)
        bytes_ = np.frombuffer(held.tobytes(), np.uint8)
        # No two arrays share a word.
        padded = np.zeros(-(-len(bytes_) // WORD) * WORD, np.uint8)
        padded[: len(bytes_)] = bytes_
        self._parts.append(padded)
        self._size += len(padded)
        return slot


def kernel(function: Callable[..., Any], *args: Any) -> tuple[llvm.Kernel, Any]:
    """Compile a function from trees of arrays to a tree of arrays; return the code and the result's shapes.

    Raises NoNativeCodeError if there is no machine code for something in it.
    """
    shapes: list[Any] = []

    def arrays_of(*args: Any) -> Any:
        result = function(*args)
        # Recorded while tracing, as tracing a law takes seconds.
        shapes[:] = [jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), result)]
        return result

    compiled = llvm.compile(trace(arrays_of, *args, named=False))
    return compiled, shapes[0]


def _is_slot(x: Any) -> bool:
    return isinstance(x, Slot)
