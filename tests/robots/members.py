"""Every robot: one line here enrols a new one in `tests/laws/test_robots.py`."""

from slidax.robots import AbstractRobot
from tests.paper import SCARA, TWO_LINK, TWO_LINK_NOMINAL

ROBOTS: list[tuple[str, AbstractRobot]] = [
    ("two_link", TWO_LINK),
    ("two_link_nominal", TWO_LINK_NOMINAL),
    ("scara", SCARA),
]
