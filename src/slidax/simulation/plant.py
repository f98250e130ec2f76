"""The true robot, what acts on it, and what stands between it and a controller."""

from __future__ import annotations

import equinox as eqx

from slidax._types import Scalar, State, Vector
from slidax.actuators import Actuator
from slidax.disturbances import AbstractDisturbance
from slidax.robots import AbstractRobot, Articulated, Load, Mismatch
from slidax.sensors import AbstractSensor


class Plant(eqx.Module):
    """The robot that moves, with the forces on it that no controller knows, eq. (10).

    - `robot`: M, C, G, F.
    - `disturbance`: τ_d.
    - `sensor`: what a controller gets to know of the state; None: all of it, at once.
    - `actuator`: what becomes of its torque; None: the joints get it as it is, at once.
    - `load`: what the tip carries for some time; None for nothing, or for what is part of the robot.
    """

    robot: AbstractRobot
    disturbance: AbstractDisturbance
    sensor: AbstractSensor | None = None
    actuator: Actuator | None = None
    load: Load | None = None

    @classmethod
    def of_nominal(
        cls,
        nominal: Articulated,
        mismatch: Mismatch,
        disturbance: AbstractDisturbance,
        sensor: AbstractSensor | None = None,
        actuator: Actuator | None = None,
    ) -> Plant:
        """The true arm of a nominal one.

        - `nominal`: as the law knows it.
        - `mismatch`: how the true arm differs, with what it carries.
        - `disturbance`, `sensor`, `actuator`: as above.

        Raises DefinitionError if the mismatch does not fit the arm.
        """
        return cls(mismatch.applied(nominal), disturbance, sensor, actuator, mismatch.load)

    def acceleration(self, t: Scalar, state: State, tau: Vector) -> Vector:
        """`q̈ = M⁻¹ (τ + τ_d - C q̇ - G - F)`, [n], rad/s² or m/s².

        - `t`: time [s].
        - `state`: positions and velocities.
        - `tau`: torque on the joints [n], N m or N.
        """
        return self.at(t).acceleration(state, tau + self.disturbance(t, state))

    def at(self, t: Scalar) -> AbstractRobot:
        """The robot with what it carries at a time.

        - `t`: time [s].
        """
        return self.robot if self.load is None else self.load.on(self.robot, t)
