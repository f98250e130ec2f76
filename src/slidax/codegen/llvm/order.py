"""The order of the operations: long chains of dependants come first, other work fills the waiting time.

A processor looks a few hundred operations ahead, and one turn of a control loop has thousands: left in the order of the
formulas, it computes one function after the other, each waiting for itself at every operation. Here the operations of a
region are dealt out, turn by turn of an imagined processor, in the order of how long a chain still hangs on each (list
scheduling). What a loop carries hangs on what the next turn does with it, so that the state comes before the records.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence

from slidax.codegen.ir import BLOCKS, Branch, Loop, Program, Region, Value, regions, uses, walk

CYCLES = {
    **dict.fromkeys(("const", "input", "param", "result"), 0),
    **dict.fromkeys(("mul", "add", "sub", "bitcast", "eq", "ne", "lt", "le", "gt", "ge"), 3),
    **dict.fromkeys(("fma", "rint", "floor", "ceil", "convert"), 4),
    **dict.fromkeys(("min", "max", "load"), 5),
    **dict.fromkeys(("div", "rem"), 13),
    **dict.fromkeys(("select", "pick", "gather", "spread"), 2),
    "sqrt": 20,
    "branch": 30,
    "loop": 100,
}
"""How long each operation takes until its result is there, on processors of these years; 1 for all others."""

STARTED = 2.0
"""Operations that the imagined processor starts in a cycle. Found by measurement: with more, too much is begun at once
and has to be put aside."""

Heights = Mapping[Value, int]
"""By value, the cycles until all is done that hangs on it."""


def put_in_order(program: Program) -> None:
    """Orders the values of each region.

    - `program`: changed in place; only of stores, and of blocks with stores, does the order matter that it has.
    """
    _order(program.body, {})


def _order(region: Region, after: Heights) -> None:
    region.values = _dealt(region.values, after)
    for value in region.values:
        if isinstance(value, Loop):
            turn = [*value.params, *value.head.values, *value.body.values]
            heights = _heights(waiting(turn), {})
            again: dict[Value, int] = {}
            for param, following in zip(value.params, value.following, strict=True):
                again[following] = max(again.get(following, 0), heights[param])
            _order(value.head, {})
            _order(value.body, again)
        elif isinstance(value, Branch):
            _order(value.then, {})
            _order(value.otherwise, {})


def _dealt(values: Sequence[Value], after: Heights) -> list[Value]:
    """The values in their new order.

    - `values`: of one region.
    - `after`: the cycles that hang on some of them beside.
    """
    users = waiting(values)
    heights = _heights(users, after)
    missing = awaited(users)
    known_at = dict.fromkeys(values, 0.0)
    place = {value: k for k, value in enumerate(values)}
    coming = [(0.0, place[value], value) for value in values if not missing[value]]
    heapq.heapify(coming)
    ready: list[tuple[int, int, Value]] = []
    dealt: list[Value] = []
    now = 0.0
    while coming or ready:
        while coming and coming[0][0] <= now:
            _, k, value = heapq.heappop(coming)
            heapq.heappush(ready, (-heights[value], k, value))
        if not ready:
            now = coming[0][0]
            continue
        value = heapq.heappop(ready)[2]
        dealt.append(value)
        cycles = CYCLES.get(value.op, 1)
        done = now + cycles
        if cycles:
            now += 1.0 / STARTED
        for user in users[value]:
            known_at[user] = max(known_at[user], done)
            missing[user] -= 1
            if not missing[user]:
                heapq.heappush(coming, (known_at[user], place[user], user))
    assert len(dealt) == len(values), "a value waits for itself"
    return dealt


def _heights(users: Mapping[Value, Sequence[Value]], after: Heights) -> Heights:
    missing = awaited(users)
    ready = [value for value, count in missing.items() if not count]
    # The list grows while it is gone through, and ends as an order in which all can be computed.
    for value in ready:
        for user in users[value]:
            missing[user] -= 1
            if not missing[user]:
                ready.append(user)
    heights: dict[Value, int] = {}
    for value in reversed(ready):
        most = after.get(value, 0)
        for user in users[value]:
            if heights[user] > most:
                most = heights[user]
        heights[value] = most + CYCLES.get(value.op, 1)
    return heights


def awaited(users: Mapping[Value, Sequence[Value]]) -> dict[Value, int]:
    """By value, how many of the others it has to wait for.

    - `users`: from `waiting`.
    """
    missing = dict.fromkeys(users, 0)
    for those in users.values():
        for user in those:
            missing[user] += 1
    return missing


def waiting(values: Sequence[Value]) -> dict[Value, list[Value]]:
    """By value, those of the others that have to come after it.

    - `values`: of one region.
    """
    users: dict[Value, list[Value]] = {value: [] for value in values}
    last_store: Value | None = None
    for value in values:
        args, stores = value.args, value.op == "store"
        if value.op in BLOCKS:
            args, stores = _used_inside(value)
        for other in set(args) if len(args) > 1 else args:
            those = users.get(other)
            if those is not None:
                those.append(value)
        if stores:
            if last_store is not None and last_store not in args:
                users[last_store].append(value)
            last_store = value
    return users


def _used_inside(block: Value) -> tuple[tuple[Value, ...], bool]:
    """All that a block uses, in the blocks inside it too, what is inside of them among it; and whether it stores."""
    used, stores = set(uses(block)), False
    for region in regions(block):
        for inner in walk(region):
            used.update(uses(inner) if inner.op in BLOCKS else inner.args)
            stores |= inner.op == "store"
    return tuple(used), stores
