"""Every scheme, with the arm, motion and start that it is tried on: one line enrols a new one in the laws' battery."""

from typing import NamedTuple

from slidax._types import State
from slidax.controllers import AbstractController
from slidax.robots import AbstractRobot
from slidax.trajectories import AbstractTrajectory
from tests.paper import (
    MOTION_4_1,
    MOTION_4_2,
    SCARA,
    START_4_1,
    START_4_2,
    TWO_LINK,
    law_4_1,
    law_4_2,
)


class Case(NamedTuple):
    """A scheme at work."""

    controller: AbstractController
    robot: AbstractRobot
    trajectory: AbstractTrajectory
    start: State


CONTROLLERS: list[tuple[str, Case]] = [
    ("cftsmppc_4_1", Case(law_4_1(), TWO_LINK, MOTION_4_1, START_4_1)),
    ("cftsmppc_4_1_unit_vector", Case(law_4_1(layer=0.0), TWO_LINK, MOTION_4_1, START_4_1)),
    ("cftsmppc_4_2", Case(law_4_2(), SCARA, MOTION_4_2, START_4_2)),
    ("cftsmppc_4_2_unit_vector", Case(law_4_2(layer=0.0), SCARA, MOTION_4_2, START_4_2)),
]
