"""Another convention of a log, which may explain its torques, and the search for it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from slidax.robots import Articulated

from .torque_model import Match

EACH = 0.15
"""The score that each changed joint costs, so that the simpler of two conventions is preferred."""


@dataclass(frozen=True, eq=False)
class Repair:
    """Another convention of a log.

    - `sentence`: the convention, to go after "with".
    - `option`: of the command, which applies it.
    - `joints`: how many joints it changes.
    - `match`: with it.
    """

    sentence: str
    option: str
    joints: int
    match: Match

    @property
    def score(self) -> float:
        """The match's score, and the cost of the changes."""
        return self.match.score + EACH * self.joints


def improved(
    start: np.ndarray, match_of: Callable[[np.ndarray], Match], others: Callable[[np.ndarray], Iterator[np.ndarray]]
) -> tuple[np.ndarray, Match]:
    """The best after changes of one entry after another, as long as the match gets better.

    - `start`: entries to begin with [n].
    - `match_of`: the match with some entries.
    - `others`: entries that differ in one place, or are exchanged.
    """
    best, match = start, match_of(start)
    for _ in range(len(start)):
        scored = [(match_of(other), other) for other in others(best)]
        candidate, other = min(scored, key=lambda pair: pair[0].score)
        if candidate.score > match.score - EACH:
            break
        best, match = other, candidate
    return best, match


def flips(sign: np.ndarray) -> Iterator[np.ndarray]:
    """Signs of which one differs.

    - `sign`: of each joint [n].
    """
    for joint in range(len(sign)):
        other = sign.copy()
        other[joint] *= -1.0
        yield other


def exchanges(order: np.ndarray) -> Iterator[np.ndarray]:
    """Orders in which two entries are exchanged.

    - `order`: numbers of the joints [n].
    """
    for a, b in itertools.combinations(range(len(order)), 2):
        other = order.copy()
        other[[a, b]] = order[[b, a]]
        yield other


def order_option(robot: Articulated, order: np.ndarray, earlier: Sequence[str]) -> str:
    """An option's list: for each joint of the log as read, the joint that its values belong to.

    - `order`: for each joint, the column that has its values [n].
    - `earlier`: names by which the columns were ordered already; none if empty.
    """
    names = list(robot.joint_names)
    belongs = {names[column]: names[joint] for joint, column in enumerate(order)}
    labels = list(earlier) or names
    return ",".join(belongs[label] for label in labels)


def named(robot: Articulated, which: np.ndarray) -> str:
    """The names of some joints for a message.

    - `which`: True for each of them [n].
    """
    names = [f"`{name}`" for name, chosen in zip(robot.joint_names, which, strict=True) if chosen]
    return "all joints" if len(names) == robot.joints and len(names) > 1 else ", ".join(names)


def listed(values: np.ndarray, digits: int = 3) -> str:
    """Numbers with commas between them, as an option takes them.

    - `values`: the numbers.
    - `digits`: of each.
    """
    return ",".join(f"{value + 0.0:.{digits}g}" for value in values)


def same_or_listed(values: np.ndarray) -> str:
    """As `listed`, or one number where all are the same.

    - `values`: the numbers.
    """
    return listed(values[:1] if (values == values[0]).all() else values)
