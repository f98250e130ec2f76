"""Groups of similar statements, and an order in which their loops can be computed."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from .alike import Access, Piece, parse
from .layout import CodeLine


class Statement:
    """One line.

    - `place`: its number in the function.
    - `type`, `name`: of the declared variable; an assignment has no type, and its target as name.
    - `piece`: its expression.
    """

    def __init__(self, line: CodeLine, place: int, type: str, name: str, text: str) -> None:
        self.line = line
        self.place = place
        self.type = type
        self.name = name
        self.piece: Piece = parse(text)


class Group:
    """Statements that one loop computes, or a single statement.

    - `lanes`: the statements, in order.
    - `array`: array of their values; empty for a single statement with a variable of its own.
    - `at`: rule for each operand.
    - `target`: rule for the values; None for a single statement.
    """

    def __init__(self, lanes: list[Statement], array: str = "", at: Sequence[Access] = ()) -> None:
        self.lanes = lanes
        self.array = array
        self.at = list(at)
        self.target: Access | None = None

    @property
    def turns(self) -> int:
        """Number of iterations of its loop."""
        return 1 if self.target is None else len(self.lanes)

    @property
    def looks_back(self) -> bool:
        """True if an iteration needs the value of an earlier one."""
        names = {lane.name for lane in self.lanes}
        return any(word in names for lane in self.lanes for word in lane.piece.operands)


def order_groups(groups: list[Group]) -> list[Group]:
    """Return the groups in an order of computation; a group that prevents one is split into statements."""
    maker = {lane.name: group for group in groups for lane in group.lanes}
    order: list[Group] = []
    while True:
        missing: dict[int, set[int]] = {}
        users: defaultdict[int, list[Group]] = defaultdict(list)
        for group in groups:
            needs = {id(maker[word]) for lane in group.lanes for word in lane.piece.operands if word in maker}
            # Iterations keep the order of the statements, which need earlier ones only.
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
        for lane in broken.lanes:
            single = Group([lane], broken.array)
            groups.append(single)
            maker[lane.name] = single


def _next(ready: list[Group], order: list[Group]) -> Group:
    """Next group: a loop with as many iterations as the last, else the first in the source."""
    if order and order[-1].target is not None:
        same = [group for group in ready if group.turns == order[-1].turns]
        if same:
            return min(same, key=lambda group: group.lanes[0].place)
    return min(ready, key=lambda group: (len(group.lanes) > 1, group.lanes[0].place))


def fits_loop(group: Group, loop: list[Group]) -> bool:
    """True if a group fits into a loop: it reads values of that loop only from the same iteration.

    - `loop`: groups of the loop.
    """
    if group.target is None or group.turns != loop[0].turns:
        return False
    targets = {other.target for other in loop}
    places = {place for other in loop for place in _places(other.target, other.turns)}
    return all(access in targets or not places & _places(access, group.turns) for access in group.at)


def _places(access: Access | None, turns: int) -> set[tuple[str, int]]:
    """Elements that the iterations of a loop access."""
    if access is None or not access.array:
        return set()
    return {(access.array, access.start + turn * access.step) for turn in range(turns)}
