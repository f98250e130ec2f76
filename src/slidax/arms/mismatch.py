"""Differences between the true arm and the nominal one, and payloads that change during a run."""

from __future__ import annotations

from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax.core.errors import DefinitionError, each_of
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import PerJoint, Scalar, Vector

from .arm import AbstractRobot, Payload
from .articulated import Articulated
from .coupled import Coupled


class TimedPayload(AbstractPart):
    """The tip carries `payload` for `attached <= t < released`.

    Joint velocities are continuous: just before it is attached, the payload already has the tip's velocity, for
    example 0, and it has the tip's velocity when it is released.
    """

    payload: Payload = piece("the payload")
    attached: Scalar = parameter("time of attachment", "s", default=0.0)
    released: Scalar = parameter("time of release", "s", "(attached, inf]", default=float("inf"))

    def on(self, robot: AbstractRobot, t: Scalar) -> AbstractRobot:
        """Return the arm at time t [s], with this payload in addition to its permanent one.

        Raises DefinitionError for an arm without a tip frame.
        """
        if isinstance(robot, Coupled):
            return eqx.tree_at(lambda coupled: coupled.arm, robot, self.on(robot.arm, t))
        if not isinstance(robot, Articulated):
            raise DefinitionError(f"a {type(robot).__name__} has no tip to carry a payload; use an articulated arm")
        carried = jnp.where((t >= self.attached) & (t < self.released), 1.0, 0.0)
        return eqx.tree_at(lambda arm: arm.payload, robot, robot.payload.joined(self.payload.times(carried)))


INERTIAL = 11
"""Number of inertial parameters per joint: ten for its body, and its rotor inertia."""


Arm = TypeVar("Arm", bound=Articulated | Coupled)


class Mismatch(AbstractPart):
    """The true arm: the nominal one with other masses, other friction, and a payload at its tip.

    With a `mass_factor` of 0.85 the arm's links are 15 % lighter than in its model. Friction and rotor inertia replace
    those of the nominal arm; a field that is None keeps the nominal value. `inertial` is added last. The inertial
    parameters of the link with the tip then include those of the nominal arm's payload.
    """

    title = "Differences between the true arm and its nominal model."

    mass_factor: PerJoint = parameter("factor on the links' masses", "", "> 0", default=1.0)
    inertia_factor: PerJoint | None = parameter(
        "factor on the links' inertias about their centres of mass; by default `mass_factor`", "", "> 0", default=None
    )
    viscous: PerJoint | None = parameter("viscous friction", "N m s/rad or N s/m", ">= 0", default=None)
    coulomb: PerJoint | None = parameter("Coulomb friction", "N m or N", ">= 0", default=None)
    armature: PerJoint | None = parameter("rotor inertias at the joints", "kg m² or kg", ">= 0", default=None)
    inertial: Float[Array, "m n"] | None = parameter(
        "change of each joint's inertial parameters, as rows: mass, mass times centre (x, y, z), inertia about the "
        "joint's origin (xx, yy, zz, xy, xz, yz), rotor inertia; the link with the tip includes its permanent payload",
        "kg, kg m, kg m²",
        default=None,
    )
    load: TimedPayload | None = piece("payload at the tip, with its times; None for no payload", default=None)

    def applied(self, nominal: Arm) -> Arm:
        """Return the true arm for a nominal one, without the payload `load`, which changes during a run.

        Raises DefinitionError unless each list has an entry for each joint, also for those that follow another joint,
        and `inertial` has 11 rows.
        """
        if isinstance(nominal, Coupled):
            return eqx.tree_at(lambda coupled: coupled.arm, nominal, self._true(nominal.arm))
        return self._true(nominal)  # type: ignore[return-value]  # the same class, which mypy does not see

    def _true(self, nominal: Articulated) -> Articulated:
        factor = self._each("mass_factor", nominal, jnp.ones(()))
        true = eqx.tree_at(
            lambda arm: (arm.masses, arm.inertias, arm.viscous, arm.coulomb, arm.armature),
            nominal,
            (
                nominal.masses * factor,
                nominal.inertias * self._each("inertia_factor", nominal, factor)[:, None, None],
                *(self._each(name, nominal, getattr(nominal, name)) for name in ("viscous", "coulomb", "armature")),
            ),
        )
        return true if self.inertial is None else self._with_change(true, self.inertial)

    def _with_change(self, arm: Articulated, change: Float[Array, "m n"]) -> Articulated:
        """Add `change` to the inertial parameters; the payload becomes part of the link that carries it."""
        if change.shape != (INERTIAL, arm.joints):
            raise DefinitionError(
                f"`Mismatch.inertial` must have {INERTIAL} rows with one number for {each_of(arm.joints, 'joint')}; "
                f"got shape {list(change.shape)}"
            )
        load, turn = arm.payload, arm.tip_rotation
        carried = arm.tip_translation + turn @ load.center
        masses = arm.masses.at[arm.tip_joint].add(load.mass)
        first = (arm.masses[:, None] * arm.centers).at[arm.tip_joint].add(load.mass * carried)
        second = arm.inertias + arm.masses[:, None, None] * _about_origin(arm.centers)
        second = second.at[arm.tip_joint].add(turn @ load.inertia @ turn.T + load.mass * _about_origin(carried))
        xx, yy, zz, xy, xz, yz = change[4:10]
        masses, first = masses + change[0], first + change[1:4].T
        second = second + jnp.stack([jnp.stack([xx, xy, xz]), jnp.stack([xy, yy, yz]), jnp.stack([xz, yz, zz])]).T
        centers = first / masses[:, None]
        return eqx.tree_at(
            lambda arm: (arm.masses, arm.centers, arm.inertias, arm.armature, arm.payload),
            arm,
            (
                masses,
                centers,
                second - masses[:, None, None] * _about_origin(centers),
                arm.armature + change[10],
                load.times(jnp.zeros(())),
            ),
        )

    def _each(self, field: str, nominal: Articulated, otherwise: PerJoint) -> Vector:
        """Return a field with one number for each joint, or `otherwise` if it is None."""
        value = getattr(self, field)
        if value is None:
            return otherwise
        if value.shape not in ((), (nominal.joints,)):
            raise DefinitionError(
                f"`Mismatch.{field}` must be one number or one for {each_of(nominal.joints, 'joint')} of "
                f"{nominal.name}, {', '.join(nominal.joint_names)}; got {value.shape[0]}"
            )
        return jnp.broadcast_to(value, (nominal.joints,))


def _about_origin(center: Float[Array, "... 3"]) -> Float[Array, "... 3 3"]:
    """Return the inertia of a unit point mass about the origin."""
    square = jnp.sum(center * center, axis=-1)[..., None, None]
    return square * jnp.eye(3) - center[..., :, None] * center[..., None, :]
