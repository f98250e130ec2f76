"""Robots for `tests/laws/test_robots.py`: a new class needs a line here; built-in arms are added automatically."""

from slidax.arms import AbstractRobot, built_in_arm, built_in_names, couple
from tests.arms.trees import small_tree, tree
from tests.paper_examples import SCARA, TWO_LINK, TWO_LINK_NOMINAL

ROBOTS: list[tuple[str, AbstractRobot]] = [
    ("two_link", TWO_LINK),
    ("two_link_nominal", TWO_LINK_NOMINAL),
    ("scara", SCARA),
    ("small_tree", small_tree()),
    ("tree", tree()),
    ("coupled", couple(small_tree(), {"arm": ("waist", -2.0, 0.2)})),
    *((name, built_in_arm(name).robot) for name in built_in_names()),
]

LIKE_OTHERS = ("small_tree", "coupled", "two_link_nominal", "tree", *built_in_names())
"""The same classes with other parameters or more joints, for the long tests."""
