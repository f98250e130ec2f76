"""Short runs of the arms that are looked at."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from slidax.arms import Articulated, Joint, TimedPayload, assemble
from slidax.core.types import State
from slidax.law import ComputedTorque
from slidax.motions import Sinusoid
from slidax.plant import Actuator, Constant, TorqueLimits
from slidax.scenarios import Scenario, load
from slidax.simulation import MujocoPlant, Plant, Run, Table, simulate


def two_link() -> Scenario:
    return load("example-4.1", {"simulation.t1": 0.5, "simulation.log_every": 10})


def scara() -> Scenario:
    return load("example-4.2", {"simulation.t1": 0.5, "simulation.log_every": 10})


def crane(*, height: float = 0.3) -> Articulated:
    """A boom that leans, with a slide along it.

    - `height`: of its joint above the ground, m.
    """
    body = {"mass": 1.0, "inertia": 0.1 * np.eye(3), "torque": 20.0}
    lean = np.array([[np.cos(0.4), 0, np.sin(0.4)], [0, 1, 0], [-np.sin(0.4), 0, np.cos(0.4)]])
    turn = Joint(
        name="turn",
        kind="revolute",
        parent=None,
        link="boom",
        rotation=lean,
        translation=np.array([0, 0, height]),
        axis=np.array([0.0, 1.0, 0.0]),
        **body,
    )
    slide = Joint(
        name="slide",
        kind="prismatic",
        parent="turn",
        link="hand",
        rotation=np.eye(3),
        translation=np.array([0.5, 0, 0]),
        axis=np.array([1.0, 0.0, 0.0]),
        **{**body, "torque": 40.0},
    )
    return assemble([turn, slide], tip="hand")


def crane_run(
    *, torque: float, load: TimedPayload | None = None, table: Table | None = None, mujoco: bool = False
) -> tuple[Plant | MujocoPlant, Run]:
    """A sway of the crane.

    - `torque`: what its drives can do, N m and N.
    - `load`, `table`: what it carries, and what is below it; None for nothing.
    - `mujoco`: whether that moves it.
    """
    robot = crane()
    drive = Actuator(TorqueLimits(torque=torque))
    plant: Plant | MujocoPlant = Plant(robot, Constant(np.zeros(2)), actuator=drive, load=load)
    if mujoco:
        plant = MujocoPlant.of(plant, surroundings=table)
    sway = Sinusoid(offset=np.full(2, 0.3), amplitude=np.full(2, 0.2), frequency=np.full(2, 2.0))
    law = ComputedTorque(robot, kp=20.0, kd=8.0)
    start = State(q=jnp.full(2, 0.4), dq=jnp.zeros(2))
    return plant, simulate(plant, law, sway, start, t1=0.3, period=2e-3, progress=False)
