"""From functions of JAX to a plan: one block of memory, and machine code that works in it."""

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
    """Puts arrays side by side into a block, and code beside them that knows where they are.

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
        """Gives each array of a tree a place; returns the tree with places.

        - `tree`: arrays with what they hold at first, or their shapes, which begin as zeros.
        - `name`: of the region that they make together; none if empty.
        """
        start = self._size
        placed = jax.tree.map(self._put, tree)
        if name:
            self._regions[name] = (start, self._size)
        return placed

    def view(self, name: str, array: Any) -> Slot:
        """A place of its own for one array, which is found by its name.

        - `name`: of the view.
        - `array`: as in `place`.
        """
        self._views[name] = slot = self._put(array)
        return slot

    def named(self, name: str, slot: Slot) -> None:
        """A name for an array that has its place.

        - `name`: of the view.
        - `slot`: its place.
        """
        self._views[name] = slot

    def region(self, name: str, first: Slot, last: Slot) -> None:
        """A name for all from one array to another.

        - `name`: of the region.
        - `first`, `last`: both are in it.
        """
        self._regions[name] = (first.offset, -(-last.end // WORD) * WORD)

    def code(self, name: str, kernel: llvm.Kernel, inputs: Any, outputs: Any) -> None:
        """Machine code at its places.

        - `name`: of the routine.
        - `kernel`: what it does.
        - `inputs`, `outputs`: trees of places, in the kernel's order.
        """
        slots: list[Slot] = [*jax.tree.leaves(inputs, is_leaf=_is_slot), *jax.tree.leaves(outputs, is_leaf=_is_slot)]
        shapes = [*(entry.shape for entry in kernel.inputs), *(entry.shape for entry in kernel.outputs)]
        assert [slot.shape for slot in slots] == shapes
        self._routines[name] = Coded(kernel.object, kernel.entry, tuple(slot.offset for slot in slots))

    def plan(self) -> Plan:
        """All of it."""
        return Plan(b"".join(part.tobytes() for part in self._parts), self._routines, self._views, self._regions)

    def _put(self, array: Any) -> Slot:
        shape, dtype = tuple(np.shape(array)), np.dtype(array.dtype)
        if isinstance(array, jax.ShapeDtypeStruct):
            shape, held = tuple(array.shape), np.zeros(array.shape, dtype)
        else:
            held = np.asarray(array)
        slot = Slot(self._size, shape, dtype.str)
        bytes_ = np.frombuffer(held.tobytes(), np.uint8)
        # The numbers are their own: no array shares a word with another.
        padded = np.zeros(-(-len(bytes_) // WORD) * WORD, np.uint8)
        padded[: len(bytes_)] = bytes_
        self._parts.append(padded)
        self._size += len(padded)
        return slot


def kernel(function: Callable[..., Any], *args: Any) -> tuple[llvm.Kernel, Any]:
    """Machine code of a function of arrays, and the shapes of its result.

    - `function`: from trees of arrays to a tree of arrays.
    - `args`: the trees, or their shapes.

    Raises NoNativeCodeError if there is no machine code for something in it.
    """
    found: list[Any] = []

    def arrays_of(*args: Any) -> Any:
        result = function(*args)
        # Seen while it is traced: to trace a law takes seconds.
        found[:] = [jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), result)]
        return result

    made = llvm.compile(trace(arrays_of, *args, named=False))
    return made, found[0]


def _is_slot(x: Any) -> bool:
    return isinstance(x, Slot)
