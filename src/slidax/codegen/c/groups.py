"""Statements that are alike, and in which order loops of them can be computed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from .alike import Access, Piece, parsed
from .layout import Line


class Statement:
    """One line.

    - `line`: it.
    - `place`: its number in the function.
    - `type`, `name`: of what it declares; for an assignment the type is empty, and the name is where it goes.
    - `piece`: its expression.
    """

    def __init__(self, line: Line, place: int, type: str, name: str, text: str) -> None:
        self.line = line
        self.place = place
        self.type = type
        self.name = name
        self.piece: Piece = parsed(text)


class Group:
    """Statements that are the turns of one loop, or a single one.

    - `lanes`: in order.
    - `array`: where they leave their numbers; empty for a single one that has a name of its own.
    - `at`: how each operand is found in turn i.
    - `target`: the same of where the numbers go.
    """

    def __init__(self, lanes: list[Statement], array: str = "", at: Sequence[Access] = ()) -> None:
        self.lanes = lanes
        self.array = array
        self.at = list(at)
        self.target: Access | None = None

    @property
    def turns(self) -> int:
        """How many turns its loop has."""
        return 1 if self.target is None else len(self.lanes)

    @property
    def looks_back(self) -> bool:
        """Whether a turn needs what an earlier one has computed."""
        names = {one.name for one in self.lanes}
        return any(word in names for one in self.lanes for word in one.piece.operands)


def ordered(groups: list[Group]) -> list[Group]:
    """The groups in an order in which they can be computed; one that cannot is taken apart.

    - `groups`: of statements that follow each other; changed where one is taken apart.
    """
    maker = {one.name: group for group in groups for one in group.lanes}
    order: list[Group] = []
    while True:
        missing: dict[int, set[int]] = {}
        users: defaultdict[int, list[Group]] = defaultdict(list)
        for group in groups:
            needs = {id(maker[word]) for one in group.lanes for word in one.piece.operands if word in maker}
            # The turns keep the order of their statements: one needs none but earlier ones.
            missing[id(group)] = needs - {id(group)}
            for need in needs:
                users[need].append(group)
        ready = [group for group in groups if not missing[id(group)]]
        order, done = [], set()
        while ready:
            group = _next(ready, order)
            ready.remove(group)
            order.append(group)
            done.add(id(group))
            for user in users[id(group)]:
                missing[id(user)].discard(id(group))
                if not missing[id(user)] and id(user) not in done and user not in ready:
                    ready.append(user)
        stuck = [group for group in groups if id(group) not in done and len(group.lanes) > 1]
        if len(order) == len(groups):
            return order
        broken = min(stuck, key=lambda group: group.lanes[0].place)
        groups.remove(broken)
        for one in broken.lanes:
            single = Group([one], broken.array)
            groups.append(single)
            maker[one.name] = single


def _next(ready: list[Group], order: list[Group]) -> Group:
    """What goes on best: a loop of as many turns as the last, else what came first."""
    if order and order[-1].target is not None:
        same = [group for group in ready if group.turns == order[-1].turns]
        if same:
            return min(same, key=lambda group: group.lanes[0].place)
    return min(ready, key=lambda group: (len(group.lanes) > 1, group.lanes[0].place))


def goes_on(group: Group, loop: list[Group]) -> bool:
    """Whether a group can be part of a loop: of what that computes it takes the number of its own turn.

    - `group`: that is to be added.
    - `loop`: the groups in it.
    """
    if group.target is None or group.turns != loop[0].turns:
        return False
    made = {one.target for one in loop}
    places = {place for one in loop for place in _places(one.target, one.turns)}
    return all(access in made or not places & _places(access, group.turns) for access in group.at)


def _places(access: Access | None, turns: int) -> set[tuple[str, int]]:
    """The elements that are found in the turns of a loop."""
    if access is None or not access.array:
        return set()
    return {(access.array, access.start + turn * access.step) for turn in range(turns)}
