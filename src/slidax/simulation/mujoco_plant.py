"""A plant with a robot that MuJoCo moves."""

from __future__ import annotations

from typing import Literal, get_args

from slidax.actuators import Actuator
from slidax.disturbances import AbstractDisturbance, Friction
from slidax.parts import AbstractPart, DefinitionError, Scalar, as_array, is_traced, parameter, piece, shown
from slidax.robots import AbstractRobot, Articulated, Load
from slidax.sensors import AbstractSensor

from .plant import Plant

MujocoIntegrator = Literal["implicitfast", "implicit", "euler", "rk4"]
"""MuJoCo's names of its integrators."""


class Table(AbstractPart):
    """A level, rigid, unbounded surface. The arm's tip and its payload meet it; the links pass through."""

    height: Scalar = parameter("above the base frame's origin, against gravity", "m")
    friction: Scalar = parameter("coefficient of what touches it", "", "> 0", default=0.5)


class MujocoPlant(AbstractPart):
    """A plant with a robot that MuJoCo moves, for `simulate` in held mode. The controller sees only its sensors.

    Masses, rotors and friction are those of `Plant`. With `dry`, Coulomb friction is MuJoCo's own: a joint sticks, and
    its friction jumps at a reversal, where `Plant` smooths it. A carried payload is part of the last link. A released
    one becomes a body of its own, the homogeneous box of equal mass and moments, which falls and meets the table.
    MuJoCo takes `substeps` steps per period, and holds torque and disturbance over each.
    """

    robot: AbstractRobot = piece("an `Articulated` arm")
    disturbance: AbstractDisturbance = piece("as in `Plant`")
    sensor: AbstractSensor | None = piece("as in `Plant`", default=None)
    actuator: Actuator | None = piece("as in `Plant`", default=None)
    load: Load | None = piece("as in `Plant`", default=None)
    surroundings: Table | None = piece("what stands around the arm; None for nothing", default=None)
    integrator: str = piece(
        'MuJoCo\'s, in place of that of `simulate`: "implicitfast", "implicit", "euler" or "rk4"',
        default="implicitfast",
        static=True,
    )
    dry: bool = piece("whether Coulomb friction is not smoothed", default=False, static=True)
    stops: bool = piece(
        "whether the joints have hard stops at the limits of their positions", default=False, static=True
    )
    tip_radius: Scalar = parameter("of the ball about the tip that meets the table", "m", "> 0", default=0.01)

    def __check_init__(self) -> None:
        if not isinstance(self.robot, Articulated):
            raise DefinitionError(
                f"MuJoCo takes an articulated arm, as from `slidax.robots.panda()`; got a {type(self.robot).__name__}"
            )
        if self.integrator not in get_args(MujocoIntegrator):
            names = ", ".join(f"`{name}`" for name in get_args(MujocoIntegrator))
            raise DefinitionError(f"`MujocoPlant.integrator` must be one of {names}; got {shown(self.integrator)}")
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
        """Return the plant with its robot moved by MuJoCo.

        Raises DefinitionError if the robot is not an `Articulated` arm.
        """
        parts = (plant.robot, plant.disturbance, plant.sensor, plant.actuator, plant.load)
        return cls(*parts, surroundings=surroundings, integrator=integrator, dry=dry, stops=stops)

    @property
    def own(self) -> Plant:
        """The plant with slidax's own equations of motion, without surroundings."""
        return Plant(self.robot, self.disturbance, self.sensor, self.actuator, self.load)

    @property
    def with_friction(self) -> Plant:
        """`own` with smoothed Coulomb friction as a disturbance, unless MuJoCo has it (`dry`)."""
        own = self.own
        if self.dry or not isinstance(self.robot, Articulated):
            return own
        friction = Friction(self.robot.coulomb, as_array(0.0), self.robot.smoothing)
        return Plant(own.robot, own.disturbance + friction, own.sensor, own.actuator, own.load)
