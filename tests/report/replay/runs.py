"""Short runs of the arms in replay tests."""

import jax.numpy as jnp
import numpy as np

from slidax.arms import Joint, assemble, couple
from slidax.core.types import State
from slidax.law import ComputedTorque
from slidax.motions import Sinusoid
from slidax.plant import Actuator, Constant, TorqueLimits
from slidax.scenarios import load
from slidax.simulation import MujocoPlant, Plant, simulate
from tests.arms.trees import small_tree


def two_link():
    return load("example-4.1", {"simulation.t1": 0.5, "simulation.log_every": 10})


def scara():
    return load("example-4.2", {"simulation.t1": 0.5, "simulation.log_every": 10})


def crane(*, height=0.3):
    """A tilted boom with a prismatic joint along it; the boom's joint is at `height` [m] above the ground."""
    body = {"mass": 1.0, "inertia": 0.1 * np.eye(3)}
    lean = np.array([[np.cos(0.4), 0, np.sin(0.4)], [0, 1, 0], [-np.sin(0.4), 0, np.cos(0.4)]])
    turn = {"name": "turn", "kind": "revolute", "parent": None, "link": "boom", "torque": 20.0, **body}
    slide = {"name": "slide", "kind": "prismatic", "parent": "turn", "link": "hand", "torque": 40.0, **body}
    y, z, x = np.array([0.0, 1.0, 0.0]), np.array([0, 0, height]), np.array([1.0, 0.0, 0.0])
    joints = (
        Joint(**turn, rotation=lean, translation=z, axis=y),
        Joint(**slide, rotation=np.eye(3), translation=0.5 * x, axis=x),
    )
    return assemble(list(joints), tip="hand")


def crane_run(*, torque, load=None, table=None, mujoco=False):
    """A swing of the crane, with a drive limit [N m, N], a payload, a table; MuJoCo moves it if `mujoco`."""
    robot = crane()
    drive = Actuator(TorqueLimits(torque=torque))
    plant = Plant(robot, Constant(np.zeros(2)), actuator=drive, load=load)
    if mujoco:
        plant = MujocoPlant.of(plant, surroundings=table)
    sway = Sinusoid(offset=np.full(2, 0.3), amplitude=np.full(2, 0.2), frequency=np.full(2, 2.0))
    law = ComputedTorque(robot, kp=20.0, kd=8.0)
    start = State(q=jnp.full(2, 0.4), dq=jnp.zeros(2))
    return plant, simulate(plant, law, sway, start, t1=0.3, period=2e-3, progress=False)


def coupled_run():
    """A swing of an arm whose third joint follows the first."""
    robot = couple(small_tree(), {"arm": ("waist", -2.0, 0.2)})
    sway = Sinusoid(offset=np.zeros(2), amplitude=np.full(2, 0.3), frequency=np.full(2, 2.0))
    law = ComputedTorque(robot, kp=20.0, kd=8.0)
    start = State(q=jnp.zeros(2), dq=jnp.zeros(2))
    plant = Plant(robot, Constant(np.zeros(2)))
    return plant, simulate(plant, law, sway, start, t1=0.3, period=2e-3, progress=False)
