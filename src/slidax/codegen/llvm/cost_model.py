"""Which vectors pay: what they save against what it costs to put them together and to take them apart."""

from __future__ import annotations

from collections import defaultdict

from slidax.codegen.ir import Loop, Value, uses

from .slp import Bundles, Members

SAVED = {"div": 4.0, "sqrt": 4.0}
"""Instructions' worth of an operation; 1 for all others."""


def keep_profitable(bundles: Bundles) -> None:
    """Takes apart what costs more than it saves.

    - `bundles`: changed in place.
    """
    costs = _CostModel(bundles)
    while True:
        losing = [members for members in bundles.slots if members in bundles.made and costs.lost(members) < 0.0]
        if not losing:
            return
        for members in losing:
            if costs.lost(members) < 0.0:
                costs.dissolve(members)


class _CostModel:
    """Which values use which.

    - `bundles`: what is computed side by side at the moment.
    """

    def __init__(self, bundles: Bundles) -> None:
        self.bundles = bundles
        self.alone: defaultdict[Value, int] = defaultdict(int)  # by number, how many take it alone
        self.takers: defaultdict[Members, set[Members]] = defaultdict(set)  # by vector, the vectors that take it
        self.slots: dict[Members, list[Members]] = dict(bundles.slots)
        for value in bundles.program.walk():
            if isinstance(value, Loop):
                self._loop(value)
            elif not bundles.is_made(value):
                for arg in uses(value):
                    self.alone[arg] += 1
        for output in bundles.program.outputs:
            for value in output.values or ():
                self.alone[value] += 1
        for members in bundles.made:
            for slot in self.slots.get(members, ()):
                self.takers[slot].add(members)

    def _loop(self, loop: Loop) -> None:
        self.alone[loop.condition] += 1
        for k, param in enumerate(loop.params):
            if not self.bundles.is_made(param):
                self.alone[loop.args[k]] += 1
                self.alone[loop.following[k]] += 1
                continue
            members, place = self.bundles.place[param]
            if place == 0:
                self.slots[members] = [loop.args[k : k + len(members)], loop.following[k : k + len(members)]]

    def lost(self, members: Members) -> float:
        """What is lost if a vector is taken apart; less than 0 if something is won.

        - `members`: of the vector.
        """
        lost = (len(members) - 1) * SAVED.get(members[0].op, 1.0)
        for value in members:
            if self._is_picked(value):
                lost -= _pick(self.bundles, value)
        if self.takers[members]:
            lost += len(members) - 1
        for slot in set(self.slots[members]):
            if slot in self.bundles.made:
                lost += sum(_pick(self.bundles, value) for value in slot if not self._is_picked(value))
            elif len(self.takers[slot]) == 1:
                lost -= self._gather(slot)
        return lost

    def dissolve(self, members: Members) -> None:
        """Takes a vector apart.

        - `members`: of the vector.
        """
        self.bundles.dissolve(members)
        for slot in set(self.slots[members]):
            self.takers[slot].discard(members)
        for value in members:
            for arg in value.args:
                self.alone[arg] += 1

    def _is_picked(self, value: Value) -> bool:
        return self.alone[value] > 0

    def _gather(self, slot: Members) -> float:
        """What it costs to put a vector together: an instruction for each further piece, half of one to cut it out."""
        if len(set(slot)) == 1:
            return 0.0 if slot[0].op == "const" else 1.0
        pieces = {self.bundles.place[value][0] if self.bundles.is_made(value) else (value,) for value in slot}
        return max(len(pieces) - 1.0, 0.0) + sum(0.5 for piece in pieces if len(piece) > 1)


def _pick(bundles: Bundles, value: Value) -> float:
    """What it costs to take a number out: the first one is in place, and inputs are in memory."""
    if value.op == "input":
        return 0.0
    return 1.0 if bundles.place[value][1] else 0.5
