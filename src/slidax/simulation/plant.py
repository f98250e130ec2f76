"""The true robot, what acts on it, and what stands between it and a controller."""

from __future__ import annotations

import equinox as eqx

from slidax._types import Scalar, State, Vector
from slidax.actuators import Actuator
from slidax.disturbances import AbstractDisturbance
from slidax.robots import AbstractRobot
from slidax.sensors import AbstractSensor


class Plant(eqx.Module):
    """The robot that moves, with the forces on it that no controller knows, eq. (10).

    - `robot`: M, C, G.
    - `disturbance`: τ_d.
    - `sensor`: what a controller gets to know of the state; None: all of it, at once.
    - `actuator`: what becomes of its torque; None: the joints get it as it is, at once.
    """

    robot: AbstractRobot
    disturbance: AbstractDisturbance
    sensor: AbstractSensor | None = None
    actuator: Actuator | None = None

    def acceleration(self, t: Scalar, state: State, tau: Vector) -> Vector:
        """`q̈ = M⁻¹ (τ + τ_d - C q̇ - G)`, [n], rad/s² or m/s².

        - `t`: time [s].
        - `state`: positions and velocities.
        - `tau`: torque on the joints [n], N m or N.
        """
        return self.robot.acceleration(state, tau + self.disturbance(t, state))
