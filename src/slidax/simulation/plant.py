"""The true robot and what acts on it."""

from __future__ import annotations

import equinox as eqx

from slidax._types import Scalar, State, Vector
from slidax.disturbances import AbstractDisturbance
from slidax.robots import AbstractRobot


class Plant(eqx.Module):
    """The robot that moves, with the forces on it that no controller knows, eq. (10).

    - `robot`: M, C, G.
    - `disturbance`: τ_d.
    """

    robot: AbstractRobot
    disturbance: AbstractDisturbance

    def acceleration(self, t: Scalar, state: State, tau: Vector) -> Vector:
        """`q̈ = M⁻¹ (τ + τ_d - C q̇ - G)`, [n], rad/s² or m/s².

        - `t`: time [s].
        - `state`: positions and velocities.
        - `tau`: torque of the controller [n], N m or N.
        """
        return self.robot.acceleration(state, tau + self.disturbance(t, state))
