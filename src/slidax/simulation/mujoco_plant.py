"""A plant whose robot MuJoCo simulates."""

from __future__ import annotations

from typing import Literal, get_args

import equinox as eqx

from slidax._errors import DefinitionError, as_array, is_traced, known, require, require_shape
from slidax._types import Scalar
from slidax.actuators import Actuator
from slidax.disturbances import AbstractDisturbance, Friction
from slidax.robots import AbstractRobot, Articulated, Load
from slidax.sensors import AbstractSensor

from .plant import Plant

MujocoIntegrator = Literal["implicitfast", "implicit", "euler", "rk4"]
"""MuJoCo's own names of its integrators."""


class Table(eqx.Module):
    """A level and rigid surface without end. The arm's tip and what it carries meet it; its links pass through.

    - `height`: above the base frame's origin, against gravity, m.
    - `friction`: coefficient of what touches it, > 0.

    Raises DefinitionError if one of them is out of its range.
    """

    height: Scalar = eqx.field(converter=as_array)
    friction: Scalar = eqx.field(converter=as_array, default=0.5)

    def __check_init__(self) -> None:
        require_shape(self, (), "height", "friction")
        require(self, "height", True, "must be finite")
        require(self, "friction", known(self.friction) > 0, "must be > 0")


class MujocoPlant(eqx.Module):
    """A plant whose robot is moved by MuJoCo, for `simulate` in held mode; the controller sees its sensors alone.

    Masses, rotors and friction are those of `Plant`. With `dry` the Coulomb friction is MuJoCo's own: a joint really
    sticks, and its friction jumps as it turns round, where that of `Plant` is smoothed. A load is a part of the last
    link while it is carried; let go, it is a body of its own, the box of even density with the same mass and moments,
    which falls and meets the table. MuJoCo takes `substeps` steps a period; torque and disturbance are held over each.

    - `robot`: an `Articulated` arm.
    - `disturbance`, `sensor`, `actuator`, `load`: as in `Plant`.
    - `surroundings`: what stands around the arm; None for nothing.
    - `integrator`: MuJoCo's, in place of that of `simulate`: "implicitfast", "implicit", "euler" or "rk4".
    - `dry`: whether Coulomb friction is not smoothed.
    - `stops`: whether the joints have hard stops at the limits of their positions.
    - `tip_radius`: of the ball about the tip that meets the table, m.

    Raises DefinitionError if the robot is of another kind, or a number is out of its range.
    """

    robot: AbstractRobot
    disturbance: AbstractDisturbance
    sensor: AbstractSensor | None = None
    actuator: Actuator | None = None
    load: Load | None = None
    surroundings: Table | None = None
    integrator: str = eqx.field(static=True, default="implicitfast")
    dry: bool = eqx.field(static=True, default=False)
    stops: bool = eqx.field(static=True, default=False)
    tip_radius: Scalar = eqx.field(converter=as_array, default=0.01)

    def __check_init__(self) -> None:
        if not isinstance(self.robot, Articulated):
            raise DefinitionError(
                f"MuJoCo takes an articulated arm, as from `slidax.robots.panda()`; got a {type(self.robot).__name__}"
            )
        if self.integrator not in get_args(MujocoIntegrator):
            names = ", ".join(f"`{name}`" for name in get_args(MujocoIntegrator))
            raise DefinitionError(f"`MujocoPlant.integrator` must be one of {names}; got {self.integrator!r}")
        require_shape(self, (), "tip_radius")
        require(self, "tip_radius", known(self.tip_radius) > 0, "must be > 0 m")
        if self.load is not None and not is_traced(self.load):
            from .mujoco.box import require_rigid

            require_rigid(self.load.payload)

    @classmethod
    def of(
        cls,
        plant: Plant,
        *,
        surroundings: Table | None = None,
        integrator: str = "implicitfast",
        dry: bool = False,
        stops: bool = False,
    ) -> MujocoPlant:
        """MuJoCo in place of a plant of ours.

        - `plant`: with an `Articulated` arm.
        - `surroundings`, `integrator`, `dry`, `stops`: as above.

        Raises DefinitionError if its robot is of another kind.
        """
        parts = (plant.robot, plant.disturbance, plant.sensor, plant.actuator, plant.load)
        return cls(*parts, surroundings=surroundings, integrator=integrator, dry=dry, stops=stops)

    @property
    def own(self) -> Plant:
        """The same with a robot that we move ourselves, and nothing around it."""
        return Plant(self.robot, self.disturbance, self.sensor, self.actuator, self.load)

    @property
    def pushed(self) -> Plant:
        """`own` with all that pushes its joints and is not MuJoCo's among the disturbances."""
        own = self.own
        if self.dry or not isinstance(self.robot, Articulated):
            return own
        friction = Friction(self.robot.coulomb, as_array(0.0), self.robot.smoothing)
        return Plant(own.robot, own.disturbance + friction, own.sensor, own.actuator, own.load)
