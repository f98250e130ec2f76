"""Order operations by list scheduling along the longest dependency chains."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence

from ..ir import BLOCKS, Branch, Loop, Program, Region, Value, regions, uses, walk

LATENCIES = {
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
"""Latency of each operation in cycles on current CPUs; 1 for all others."""

ISSUE_RATE = 2.0
"""Operations that the modelled CPU starts per cycle. A measured optimum: with more, too many values are live at the
same time and are spilled to the stack."""

Heights = Mapping[Value, int]
"""Length of the longest dependency chain that starts at each value, in cycles."""


def put_in_order(program: Program) -> None:
    """Reorder the operations of a program in place, so that long dependency chains start early.

    Operations that write logs, and loops and branches with such operations, keep their order.
    """
    _order(program.body, {})


def _order(region: Region, after: Heights) -> None:
    region.values = _schedule(region.values, after)
    for value in region.values:
        if isinstance(value, Loop):
            iteration = [*value.params, *value.head.values, *value.body.values]
            heights = _heights(dependants(iteration), {})
            next_iteration: dict[Value, int] = {}
            for param, following in zip(value.params, value.following, strict=True):
                next_iteration[following] = max(next_iteration.get(following, 0), heights[param])
            _order(value.head, {})
            _order(value.body, next_iteration)
        elif isinstance(value, Branch):
            _order(value.then, {})
            _order(value.otherwise, {})


def _schedule(values: Sequence[Value], after: Heights) -> list[Value]:
    """Return a region's values in their new order.

    - `after`: length of the chains that continue after the region, by value.
    """
    users = dependants(values)
    heights = _heights(users, after)
    missing = dependency_counts(users)
    known_at = dict.fromkeys(values, 0.0)
    position = {value: k for k, value in enumerate(values)}
    coming = [(0.0, position[value], value) for value in values if not missing[value]]
    heapq.heapify(coming)
    ready: list[tuple[int, int, Value]] = []
    scheduled: list[Value] = []
    now = 0.0
    while coming or ready:
        while coming and coming[0][0] <= now:
            _, k, value = heapq.heappop(coming)
            heapq.heappush(ready, (-heights[value], k, value))
        if not ready:
            now = coming[0][0]
            continue
        value = heapq.heappop(ready)[2]
        scheduled.append(value)
        cycles = LATENCIES.get(value.op, 1)
        done = now + cycles
        if cycles:
            now += 1.0 / ISSUE_RATE
        for user in users[value]:
            known_at[user] = max(known_at[user], done)
            missing[user] -= 1
            if not missing[user]:
                heapq.heappush(coming, (known_at[user], position[user], user))
    assert len(scheduled) == len(values), "a value depends on itself"
    return scheduled


def _heights(users: Mapping[Value, Sequence[Value]], after: Heights) -> Heights:
    missing = dependency_counts(users)
    ready = [value for value, count in missing.items() if not count]
    # The list grows during the iteration, and ends in topological order.
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
        heights[value] = most + LATENCIES.get(value.op, 1)
    return heights


def dependency_counts(users: Mapping[Value, Sequence[Value]]) -> dict[Value, int]:
    """Return, for each value, the number of values that must come before it.

    - `users`: for each value, the values that must come after it, from `dependants`.
    """
    missing = dict.fromkeys(users, 0)
    for dependants_of_value in users.values():
        for user in dependants_of_value:
            missing[user] += 1
    return missing


def dependants(values: Sequence[Value]) -> dict[Value, list[Value]]:
    """Return, for each value of a region, the values of the region that must come after it, because they use it.

    Operations that write logs also depend on the previous one.
    """
    users: dict[Value, list[Value]] = {value: [] for value in values}
    last_store: Value | None = None
    for value in values:
        args, stores = value.args, value.op == "store"
        if value.op in BLOCKS:
            args, stores = _used_inside(value)
        for other in set(args) if len(args) > 1 else args:
            if other in users:
                users[other].append(value)
        if stores:
            if last_store is not None and last_store not in args:
                users[last_store].append(value)
            last_store = value
    return users


def _used_inside(block: Value) -> tuple[tuple[Value, ...], bool]:
    """Return all values that a block uses, including those in inner blocks, and True if it contains a store."""
    used, stores = set(uses(block)), False
    for region in regions(block):
        for inner in walk(region):
            used.update(uses(inner) if inner.op in BLOCKS else inner.args)
            stores |= inner.op == "store"
    return tuple(used), stores
