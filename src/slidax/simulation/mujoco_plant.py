"""A plant whose robot MuJoCo simulates."""

from __future__ import annotations

from typing import Literal, get_args

from slidax.actuators import Actuator
from slidax.disturbances import AbstractDisturbance, Friction
from slidax.parts import AbstractPart, DefinitionError, Scalar, as_array, is_traced, parameter, piece, shown
from slidax.robots import AbstractRobot, Articulated, Load
from slidax.sensors import AbstractSensor

from .plant import Plant

MujocoIntegrator = Literal["implicitfast", "implicit", "euler", "rk4"]
"""MuJoCo's own names of its integrators."""


class Table(AbstractPart):
    """A level and rigid surface without end. The arm's tip and what it carries meet it; its links pass through."""

    height: Scalar = parameter("above the base frame's origin, against gravity", "m")
    friction: Scalar = parameter("coefficient of what touches it", "", "> 0", default=0.5)


class MujocoPlant(AbstractPart):
    """A plant whose robot is moved by MuJoCo, for `simulate` in held mode; the controller sees its sensors alone.

    Masses, rotors and friction are those of `Plant`. With `dry` the Coulomb friction is MuJoCo's own: a joint really
    sticks, and its friction jumps as it turns round, where that of `Plant` is smoothed. A load is a part of the last
    link while it is carried; let go, it is a body of its own, the box of even density with the same mass and moments,
    which falls and meets the table. MuJoCo takes `substeps` steps a period; torque and disturbance are held over each.
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
