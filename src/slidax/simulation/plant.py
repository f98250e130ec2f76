"""Plants: the true robot with disturbance, sensor and actuator. Its motion comes from slidax itself or from MuJoCo."""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from slidax.arms.arm import AbstractRobot, Payload
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.arms.mismatch import Mismatch, TimedPayload
from slidax.core.errors import DefinitionError, as_array, is_traced, short_repr
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import Scalar, State, Vector
from slidax.plant.actuators import Actuator
from slidax.plant.disturbances import AbstractDisturbance, Friction
from slidax.plant.sensors import AbstractSensor
from slidax.plant.transmissions import Load, Transmission, TransmissionState


class Plant(AbstractPart):
    """The true robot, with disturbances that no controller knows, eq. (10) of the paper."""

    robot: AbstractRobot = piece("the true arm, with M, C, G, F")
    disturbance: AbstractDisturbance = piece("disturbance τ_d")
    sensor: AbstractSensor | None = piece("sensor; None measures the true state without delay", default=None)
    actuator: Actuator | None = piece(
        "drives; None applies each torque command unchanged and without delay", default=None
    )
    load: TimedPayload | None = piece(
        "payload that the tip carries for some time; None without one, or if it is part of the robot", default=None
    )
    transmission: Transmission | None = piece("LuGre friction and elastic joints; None without both", default=None)

    @classmethod
    def of_nominal(
        cls,
        nominal: Articulated | Coupled,
        mismatch: Mismatch,
        disturbance: AbstractDisturbance,
        sensor: AbstractSensor | None = None,
        actuator: Actuator | None = None,
    ) -> Plant:
        """Return the plant whose true arm is the nominal arm changed by a mismatch, with the mismatch's payload.

        Raises DefinitionError if the mismatch does not fit the arm.
        """
        return cls(mismatch.applied(nominal), disturbance, sensor, actuator, mismatch.load)

    def acceleration(self, t: Scalar, state: State, tau: Vector) -> Vector:
        """Return the acceleration `q̈ = M⁻¹ (τ + τ_d - C q̇ - G - F)`, eq. (10), [n], rad/s² or m/s², at time t [s].

        - `state`: true state of the arm.
        - `tau`: τ, torque on the joints [n], N m or N. τ_d is the disturbance and F the friction.
        """
        return self.at(t).acceleration(state, tau + self.disturbance(t, state))

    def at(self, t: Scalar) -> AbstractRobot:
        """Return the robot with the payload that it carries at time t [s]."""
        return self.robot if self.load is None else self.load.on(self.robot, t)

    def step(
        self, t: Scalar, state: State, own: TransmissionState, tau: Vector, h: Scalar
    ) -> tuple[State, TransmissionState]:
        """Return the states of arm and transmission one step after t [s].

        - `state`: state of the arm at t.
        - `own`: state of the transmission at t; the plant must have a transmission.
        - `tau`: torque of the drives [n], N m or N.
        - `h`: step [s].
        """
        assert self.transmission is not None
        robot = self.at(t)
        rotors = rotors_of(robot)
        force = self.disturbance(t, state) - robot.bias(state.q, state.dq)
        return self.transmission.step(state, own, tau, Load(robot.mass(state.q), rotors, force, robot.friction), h)


def rotors_of(robot: AbstractRobot) -> Vector:
    """Return the rotor inertias in the diagonal of a robot's M(q) [n], kg m² or kg; 0 for a class without rotors."""
    if isinstance(robot, Articulated | Coupled):
        return robot.armature
    return jnp.zeros(robot.joints)


MujocoIntegrator = Literal["implicitfast", "implicit", "euler", "rk4"]
"""MuJoCo's names for its integrators."""


class Table(AbstractPart):
    """A level, rigid, unbounded surface. The arm's tip and its payload collide with it; the links do not."""

    height: Scalar = parameter("height above the base frame's origin, against gravity", "m")
    friction: Scalar = parameter("friction coefficient of contacts", "", "> 0", default=0.5)


class MujocoPlant(AbstractPart):
    """A plant with a robot that MuJoCo moves, for `simulate` in held mode. The controller sees only its sensors.

    Masses, rotors and friction are those of `Plant`. With `dry`, Coulomb friction is MuJoCo's own: joints stick, and
    friction jumps when a joint reverses, whereas `Plant` smooths this jump. A carried payload is part of the last link.
    A released payload becomes a separate body, the homogeneous box of equal mass and moments of inertia, which can fall
    onto the table. MuJoCo takes `substeps` steps per period, with constant torque and disturbance in each.
    """

    robot: AbstractRobot = piece("an `Articulated` arm")
    disturbance: AbstractDisturbance = piece("as in `Plant`")
    sensor: AbstractSensor | None = piece("as in `Plant`", default=None)
    actuator: Actuator | None = piece("as in `Plant`", default=None)
    load: TimedPayload | None = piece("as in `Plant`", default=None)
    surroundings: Table | None = piece("table near the arm; None without one", default=None)
    integrator: str = piece(
        'MuJoCo\'s integrator, used instead of that of `simulate`: "implicitfast", "implicit", "euler" or "rk4"',
        default="implicitfast",
        static=True,
    )
    dry: bool = piece("True for Coulomb friction without smoothing", default=False, static=True)
    stops: bool = piece("True for hard stops at the position limits", default=False, static=True)
    tip_radius: Scalar = parameter("radius of the ball at the tip, which can touch the table", "m", "> 0", default=0.01)

    def __check_init__(self) -> None:
        if not isinstance(self.robot, Articulated):
            raise DefinitionError(
                f"a MujocoPlant needs an `Articulated` arm, as from `slidax.arms.panda()`; got a "
                f"{type(self.robot).__name__}"
            )
        if self.integrator not in get_args(MujocoIntegrator):
            names = ", ".join(f"`{name}`" for name in get_args(MujocoIntegrator))
            raise DefinitionError(f"`MujocoPlant.integrator` must be one of {names}; got {short_repr(self.integrator)}")
        if self.load is not None and not is_traced(self.load):
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
        """Return the plant with its robot moved by MuJoCo; the other arguments are fields of `MujocoPlant`.

        Raises DefinitionError if the robot is not an `Articulated` arm, or the plant has a transmission.
        """
        if plant.transmission is not None:
            raise DefinitionError(
                "MuJoCo simulates neither LuGre friction nor elastic joints here: set `simulation.plant` to `own`, or "
                "leave `transmission` out"
            )
        parts = (plant.robot, plant.disturbance, plant.sensor, plant.actuator, plant.load)
        return cls(*parts, surroundings=surroundings, integrator=integrator, dry=dry, stops=stops)

    @property
    def own(self) -> Plant:
        """The plant with slidax's own equations of motion, without surroundings."""
        return Plant(self.robot, self.disturbance, self.sensor, self.actuator, self.load)

    @property
    def with_friction(self) -> Plant:
        """The plant `own`, with smoothed Coulomb friction as a disturbance; without it if `dry`.

        With `dry`, MuJoCo itself simulates this friction.
        """
        own = self.own
        if self.dry or not isinstance(self.robot, Articulated):
            return own
        friction = Friction(self.robot.coulomb, as_array(0.0), self.robot.smoothing)
        return Plant(own.robot, own.disturbance + friction, own.sensor, own.actuator, own.load)


ROUNDING = 1e-6
"""Allowed relative excess of the largest principal moment over the sum of the others, for rounded data."""

DENSITY = 2700.0
"""Density of aluminium, kg/m³: a released point mass becomes a cube of this density."""

THIN = 1e-3
"""Smallest half thickness of a box [m]."""


class Principal(NamedTuple):
    """Principal moments [3], kg m², and axes as columns [3 3], right-handed."""

    moments: np.ndarray
    axes: np.ndarray


def principal(inertia: np.ndarray) -> Principal:
    """Return the principal moments and axes of an inertia about the centre of mass [3 3], kg m²."""
    moments, axes = np.linalg.eigh(0.5 * (inertia + inertia.T))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    moments = np.maximum(moments, 0.0)
    # The moments are in increasing order. MuJoCo rejects even a tiny excess of the last one over the others' sum.
    moments[2] = min(moments[2], moments[0] + moments[1])
    return Principal(moments, axes)


class Box(NamedTuple):
    """A homogeneous box along its principal axes: half sides [3], m, and moments [3], kg m²."""

    sides: np.ndarray
    moments: np.ndarray


def box_like(mass: float, moments: np.ndarray) -> Box:
    """Return the homogeneous box with these moments, with a minimum thickness so that it can fall and roll.

    - `mass`: kg.
    - `moments`: principal moments [3], kg m²; all 0 for a point mass, which becomes a cube.
    """
    if moments.any():
        squares = 1.5 / mass * (moments.sum() - 2.0 * moments)
        sides = np.maximum(np.sqrt(np.maximum(squares, 0.0)), THIN)
    else:
        sides = np.full(3, 0.5 * (mass / DENSITY) ** (1.0 / 3.0))
    return Box(sides, mass / 3.0 * ((sides**2).sum() - sides**2))


def require_rigid(payload: Payload) -> None:
    """Raise a DefinitionError if no rigid body has the payload's moments."""
    moments = np.linalg.eigvalsh(np.asarray(payload.inertia))
    if moments[2] > (moments[0] + moments[1]) * (1.0 + ROUNDING):
        listed = ", ".join(f"{moment:.3g}" for moment in moments)
        raise DefinitionError(
            f"no rigid body has this `Payload.inertia`: the largest of its principal moments {listed} kg m² is more "
            "than the sum of the others"
        )


class FreeBody(eqx.Module):
    """Pose of a released payload at the m samples that were logged since its release.

    The payload's frame is the tip's frame at the release; the payload's centre and inertia are relative to this frame.

    - `t`: times [m], s.
    - `rotation`: axes of the payload's frame as columns, in the base frame [m 3 3].
    - `position`: origin of the payload's frame, in the base frame [m 3], m.
    """

    t: Float[np.ndarray, " m"]
    rotation: Float[np.ndarray, "m 3 3"]
    position: Float[np.ndarray, "m 3"]
