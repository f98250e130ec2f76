"""What has to be computed only when parameters change."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from ..form import ELEMENTARY, Branch, Loop, Program, Region, Value, regions, uses, walk

DEAR = frozenset(ELEMENTARY) | {"div", "rem", "sqrt"}
WORTH = 4
"""Additions that are worth a place in memory; what is `DEAR` always is."""


def lasting(program: Program, inputs: Collection[int]) -> list[Value]:
    """Values that depend on nothing but constants and some inputs, and are worth keeping from one call to the next.

    They can be computed apart, by `statements` of the same program, wherever in branches they stand: what is computed
    in vain there does no harm. `statements` of the rest is given them.

    - `program`: the program.
    - `inputs`: the numbers of the inputs that seldom change.
    """
    return _Lasting(program, inputs).kept()


class _Lasting:
    def __init__(self, program: Program, inputs: Collection[int]) -> None:
        self.program = program
        self.inputs = inputs
        self.cost: dict[Value, int] = {}  # of each value that lasts
        self.inner: set[Value] = set()  # of blocks that last
        self._region(program.body, guarded=False)

    def kept(self) -> list[Value]:
        """Those that something else needs, in the order of their making."""
        kept = {value for output in self.program.outputs for value in output.values or () if self._is_worth(value)}
        for value in self.program.walk():
            if value not in self.cost and value not in self.inner:
                kept.update(need for need in uses(value) if self._is_worth(need))
        return sorted(kept, key=lambda value: value.number)

    def _is_worth(self, value: Value) -> bool:
        return self.cost.get(value, 0) >= WORTH

    def _region(self, region: Region, guarded: bool) -> None:
        for value in region.values:
            if regions(value):
                self._block(value, guarded)
            elif value.op == "const" or (value.op == "input" and value.data[0] in self.inputs):
                self.cost[value] = 0
            elif value.op == "result":
                if value.args[0] in self.cost:
                    self.cost[value] = WORTH
            elif self._lasts(value, guarded):
                own = WORTH if value.op in DEAR else 1
                self.cost[value] = min(own + sum(self.cost[arg] for arg in value.args), WORTH)

    def _lasts(self, value: Value, guarded: bool) -> bool:
        if value.op in ("input", "store") or not all(arg in self.cost for arg in value.args):
            return False
        # Where a branch guards it, its index may be out of range elsewhere.
        return value.op != "load" or (value.data in self.inputs and not guarded)

    def _block(self, block: Value, guarded: bool) -> None:
        inner = {value for region in regions(block) for value in walk(region)}
        if isinstance(block, Loop):
            inner.update(block.params)
        inner |= {param for one in inner if isinstance(one, Loop) for param in one.params}
        if self._block_lasts(block, inner, guarded):
            self.cost[block] = WORTH
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
            if not all(need in inner or need in self.cost for need in _needs(one)):
                return False
        return True


def _needs(value: Value) -> Iterator[Value]:
    yield from uses(value)
    if isinstance(value, Loop) and value.turns is not None:
        yield value.turns
