"""Plant: the true robot with its disturbance, sensor and actuator."""

from __future__ import annotations

from slidax.actuators import Actuator
from slidax.disturbances import AbstractDisturbance
from slidax.parts import AbstractPart, Scalar, State, Vector, piece
from slidax.robots import AbstractRobot, Articulated, Coupled, Load, Mismatch
from slidax.sensors import AbstractSensor


class Plant(AbstractPart):
    """The true robot, with forces that no controller knows, eq. (10)."""

    robot: AbstractRobot = piece("M, C, G, F")
    disturbance: AbstractDisturbance = piece("τ_d")
    sensor: AbstractSensor | None = piece(
        "what a controller measures of the state; None: all of it, at once", default=None
    )
    actuator: Actuator | None = piece("how the drives deliver a torque; None: unchanged and at once", default=None)
    load: Load | None = piece(
        "what the tip carries for some time; None for nothing, or for what is part of the robot", default=None
    )

    @classmethod
    def of_nominal(
        cls,
        nominal: Articulated | Coupled,
        mismatch: Mismatch,
        disturbance: AbstractDisturbance,
        sensor: AbstractSensor | None = None,
        actuator: Actuator | None = None,
    ) -> Plant:
        """Return the plant of a nominal arm and the true arm's mismatch, with its payload.

        Raises DefinitionError if the mismatch does not fit the arm.
        """
        return cls(mismatch.applied(nominal), disturbance, sensor, actuator, mismatch.load)

    def acceleration(self, t: Scalar, state: State, tau: Vector) -> Vector:
        """Acceleration `q̈ = M⁻¹ (τ + τ_d - C q̇ - G - F)`, [n], rad/s² or m/s²."""
        return self.at(t).acceleration(state, tau + self.disturbance(t, state))

    def at(self, t: Scalar) -> AbstractRobot:
        """The robot with its payload at time t [s]."""
        return self.robot if self.load is None else self.load.on(self.robot, t)
