"""What has to be computed only when parameters change."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from ..ir import ELEMENTARY, Branch, Loop, Program, Region, Value, regions, uses, walk

DEAR = frozenset(ELEMENTARY) | {"div", "rem", "sqrt"}
WORTH = 4
"""Additions that are worth a place in memory; what is `DEAR` always is."""


def loop_invariant(program: Program, inputs: Collection[int]) -> list[Value]:
    """Values that depend on nothing but constants and some inputs, and are worth keeping from one call to the next.

    They can be computed apart, by `statements` of the same program, wherever in branches they stand: what is computed
    in vain there does no harm. `statements` of the rest is given them.

    - `program`: the program.
    - `inputs`: the numbers of the inputs that seldom change.
    """
    return _LoopInvariant(program, inputs).kept()


class _LoopInvariant:
    def __init__(self, program: Program, inputs: Collection[int]) -> None:
        self.program = program
        self.inputs = inputs
        self.found: dict[Value, None] = {}  # in an order in which they can be computed
        self.inner: set[Value] = set()  # of blocks that last
        self._region(program.body, guarded=False)

    def kept(self) -> list[Value]:
        """Those that something else needs and that are expensive, others being kept."""
        asked = {value for output in self.program.outputs for value in output.values or ()}
        for value in self.program.walk():
            if value not in self.found and value not in self.inner:
                asked.update(uses(value))
        kept: list[Value] = []
        cost: dict[Value, int] = {}
        for value in self.found:
            own = WORTH if value.op in DEAR or value.op == "result" else 0 if value.op in ("const", "input") else 1
            cost[value] = min(own + sum(cost[arg] for arg in value.args if not regions(arg)), WORTH)
            if value in asked and cost[value] == WORTH:
                kept.append(value)
                cost[value] = 0
        return kept

    def _region(self, region: Region, guarded: bool) -> None:
        for value in region.values:
            if regions(value):
                self._block(value, guarded)
            elif value.op == "const" or (value.op == "input" and value.data[0] in self.inputs):
                self.found[value] = None
            elif value.op == "result":
                if value.args[0] in self.found:
                    self.found[value] = None
            elif self._lasts(value, guarded):
                self.found[value] = None

    def _lasts(self, value: Value, guarded: bool) -> bool:
        if value.op in ("input", "store") or not all(arg in self.found for arg in value.args):
            return False
        # Where a branch guards it, its index may be out of range elsewhere.
        return value.op != "load" or (value.data in self.inputs and not guarded)

    def _block(self, block: Value, guarded: bool) -> None:
        inner = {value for region in regions(block) for value in walk(region)}
        if isinstance(block, Loop):
            inner.update(block.params)
        inner |= {param for one in inner if isinstance(one, Loop) for param in one.params}
        if self._block_lasts(block, inner, guarded):
            self.found[block] = None
            self.inner |= inner
            return
        for region in regions(block):
            self._region(region, guarded or isinstance(block, Branch))

    def _block_lasts(self, block: Value, inner: set[Value], guarded: bool) -> bool:
        for one in (block, *inner):
            if one.op in ("store", "input") or (one.op == "load" and (one.data not in self.inputs or guarded)):
                return False
            # A branch may be there to keep a loop from going on for ever.
            if guarded and isinstance(one, Loop) and one.turns is None:
                return False
            if not all(need in inner or need in self.found for need in _needs(one)):
                return False
        return True


def _needs(value: Value) -> Iterator[Value]:
    yield from uses(value)
    if isinstance(value, Loop) and value.turns is not None:
        yield value.turns
