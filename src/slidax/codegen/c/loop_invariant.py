"""Loop-invariant values: values that change only with the parameters."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from ..ir import ELEMENTARY, Branch, Loop, Program, Region, Value, regions, uses, walk

EXPENSIVE = frozenset(ELEMENTARY) | {"div", "rem", "sqrt"}
WORTH = 4
"""Number of additions that are worth a place in memory; a value of `EXPENSIVE` always is."""


def loop_invariant(program: Program, inputs: Collection[int]) -> list[Value]:
    """Return values that depend on constants and some inputs alone, and are worth keeping between calls.

    `statements` of the same program can compute them separately, even values inside branches: computing those in vain
    does no harm. `statements` of the rest takes them as `precomputed`.

    - `inputs`: numbers of the inputs that seldom change.
    """
    return _LoopInvariant(program, inputs).values()


class _LoopInvariant:
    def __init__(self, program: Program, inputs: Collection[int]) -> None:
        self.program = program
        self.inputs = inputs
        self.invariant: dict[Value, None] = {}  # in an order of computation
        self.inner: set[Value] = set()  # contents of invariant blocks
        self._region(program.body, guarded=False)

    def values(self) -> list[Value]:
        """Expensive values that other values need, given that the returned ones are kept."""
        needed = {value for output in self.program.outputs for value in output.values or ()}
        for value in self.program.walk():
            if value not in self.invariant and value not in self.inner:
                needed.update(uses(value))
        values: list[Value] = []
        cost: dict[Value, int] = {}
        for value in self.invariant:
            own = WORTH if value.op in EXPENSIVE or value.op == "result" else 0 if value.op in ("const", "input") else 1
            cost[value] = min(own + sum(cost[arg] for arg in value.args if not regions(arg)), WORTH)
            if value in needed and cost[value] == WORTH:
                values.append(value)
                cost[value] = 0
        return values

    def _region(self, region: Region, guarded: bool) -> None:
        for value in region.values:
            if regions(value):
                self._block(value, guarded)
            elif value.op == "const" or (value.op == "input" and value.data[0] in self.inputs):
                self.invariant[value] = None
            elif value.op == "result":
                if value.args[0] in self.invariant:
                    self.invariant[value] = None
            elif self._is_invariant(value, guarded):
                self.invariant[value] = None

    def _is_invariant(self, value: Value, guarded: bool) -> bool:
        if value.op in ("input", "store") or not all(arg in self.invariant for arg in value.args):
            return False
        # Outside a branch that guards it, its index may be out of range.
        return value.op != "load" or (value.data in self.inputs and not guarded)

    def _block(self, block: Value, guarded: bool) -> None:
        inner = {value for region in regions(block) for value in walk(region)}
        if isinstance(block, Loop):
            inner.update(block.params)
        inner |= {param for value in inner if isinstance(value, Loop) for param in value.params}
        if self._is_invariant_block(block, inner, guarded):
            self.invariant[block] = None
            self.inner |= inner
            return
        for region in regions(block):
            self._region(region, guarded or isinstance(block, Branch))

    def _is_invariant_block(self, block: Value, inner: set[Value], guarded: bool) -> bool:
        for value in (block, *inner):
            if value.op in ("store", "input") or (value.op == "load" and (value.data not in self.inputs or guarded)):
                return False
            # The branch may protect against an endless loop.
            if guarded and isinstance(value, Loop) and value.turns is None:
                return False
            if not all(need in inner or need in self.invariant for need in _needs(value)):
                return False
        return True


def _needs(value: Value) -> Iterator[Value]:
    yield from uses(value)
    if isinstance(value, Loop) and value.turns is not None:
        yield value.turns
