"""Every robot: one line here enrols a new one in `tests/laws/test_robots.py`."""

from slidax.robots import AbstractRobot, gen3, iiwa14, panda, ur5e, xarm7
from tests.paper import SCARA, TWO_LINK, TWO_LINK_NOMINAL
from tests.robots.trees import tree

ROBOTS: list[tuple[str, AbstractRobot]] = [
    ("two_link", TWO_LINK),
    ("two_link_nominal", TWO_LINK_NOMINAL),
    ("scara", SCARA),
    ("tree", tree()),
    ("panda", panda()),
    ("ur5e", ur5e()),
    ("iiwa14", iiwa14()),
    ("xarm7", xarm7()),
    ("gen3", gen3()),
]

LIKE_PANDA = ("ur5e", "iiwa14", "xarm7", "gen3")
"""The same class with other numbers: these run in the long version."""
