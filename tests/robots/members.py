"""Every robot: one line here enrols a new one in `tests/laws/test_robots.py`; ready ones are found by themselves."""

from slidax.robots import AbstractRobot, ready
from tests.paper import SCARA, TWO_LINK, TWO_LINK_NOMINAL
from tests.robots.trees import tree

ROBOTS: list[tuple[str, AbstractRobot]] = [
    ("two_link", TWO_LINK),
    ("two_link_nominal", TWO_LINK_NOMINAL),
    ("scara", SCARA),
    ("tree", tree()),
    *((name, ready.read(name).robot) for name in ready.names()),
]

LIKE_TREE = tuple(ready.names())
"""The same class with other numbers, and without branches and sliding joints: these run in the long version."""
