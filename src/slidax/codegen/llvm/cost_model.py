"""Cost model of vectors: saved operations against the cost of gathering and extracting elements."""

from __future__ import annotations

from collections import defaultdict

from slidax.codegen.ir import Loop, Value, uses

from .slp import Bundles, Members

COSTS = {"div": 4.0, "sqrt": 4.0}
"""Cost of an operation in instructions; 1 for all others."""


def keep_profitable(bundles: Bundles) -> None:
    """Dissolve, in place, the bundles that cost more than they save."""
    costs = _CostModel(bundles)
    while True:
        costly = [members for members in bundles.slots if members in bundles.vectors and costs.gain(members) < 0.0]
        if not costly:
            return
        for members in costly:
            if costs.gain(members) < 0.0:
                costs.dissolve(members)


class _CostModel:
    """Users of each value and vector."""

    def __init__(self, bundles: Bundles) -> None:
        self.bundles = bundles
        self.scalar_uses: defaultdict[Value, int] = defaultdict(int)
        self.users: defaultdict[Members, set[Members]] = defaultdict(set)  # by vector, the vectors that use it
        self.slots: dict[Members, list[Members]] = dict(bundles.slots)
        for value in bundles.program.walk():
            if isinstance(value, Loop):
                self._loop(value)
            elif not bundles.is_vectorised(value):
                for arg in uses(value):
                    self.scalar_uses[arg] += 1
        for output in bundles.program.outputs:
            for value in output.values or ():
                self.scalar_uses[value] += 1
        for members in bundles.vectors:
            for slot in self.slots.get(members, ()):
                self.users[slot].add(members)

    def _loop(self, loop: Loop) -> None:
        self.scalar_uses[loop.condition] += 1
        for k, param in enumerate(loop.params):
            if not self.bundles.is_vectorised(param):
                self.scalar_uses[loop.args[k]] += 1
                self.scalar_uses[loop.following[k]] += 1
                continue
            members, lane = self.bundles.place[param]
            if lane == 0:
                self.slots[members] = [loop.args[k : k + len(members)], loop.following[k : k + len(members)]]

    def gain(self, members: Members) -> float:
        """Instructions that a vector saves; negative if it costs more than it saves."""
        gain = (len(members) - 1) * COSTS.get(members[0].op, 1.0)
        for value in members:
            if self.scalar_uses[value]:
                gain -= _extraction_cost(self.bundles, value)
        if self.users[members]:
            gain += len(members) - 1
        for slot in set(self.slots[members]):
            if slot in self.bundles.vectors:
                gain += sum(_extraction_cost(self.bundles, value) for value in slot if not self.scalar_uses[value])
            elif len(self.users[slot]) == 1:
                gain -= self._gather_cost(slot)
        return gain

    def dissolve(self, members: Members) -> None:
        """Replace a vector by its members."""
        self.bundles.dissolve(members)
        for slot in set(self.slots[members]):
            self.users[slot].discard(members)
        for value in members:
            for arg in value.args:
                self.scalar_uses[arg] += 1

    def _gather_cost(self, slot: Members) -> float:
        """Cost of assembling a vector: one instruction per further piece, and half of one to extract each."""
        if len(set(slot)) == 1:
            return 0.0 if slot[0].op == "const" else 1.0
        pieces = {self.bundles.place[value][0] if self.bundles.is_vectorised(value) else (value,) for value in slot}
        return max(len(pieces) - 1.0, 0.0) + sum(0.5 for piece in pieces if len(piece) > 1)


def _extraction_cost(bundles: Bundles, value: Value) -> float:
    """Cost of extracting an element: the first lane is cheaper, and inputs are in memory."""
    if value.op == "input":
        return 0.0
    return 1.0 if bundles.place[value][1] else 0.5
