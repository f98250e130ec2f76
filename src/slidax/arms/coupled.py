"""Coupled: an arm in which some joints follow others, by a belt, a parallelogram or a screw."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.core.errors import DefinitionError, as_array
from slidax.core.parameter import parameter, piece
from slidax.core.types import Matrix, Scalar, Vector

from .arm import AbstractRobot, JointLimits
from .articulated import Articulated


class Coupled(AbstractRobot):
    """An arm of m joints in which some follow others: `q_a = S q + s₀`.

    q_a are the positions of all joints, q those of the n leaders. S is constant with one entry in each row: the ratio
    of a joint's velocity to its leader's, 1 for a leader. M_a, C_a, G_a and F_a belong to `arm`, whose joints are all
    independent. So `M = Sᵀ M_a(S q + s₀) S`, and `C q̇ + G` and F are `Sᵀ` times those of `arm` at `S q + s₀`, `S q̇`.
    Torques act on the leaders; followers have no drives.

    `from_urdf` returns one for a file with `<mimic>`; `couple` derives one from an articulated arm.
    """

    arm: Articulated = piece("the arm with all joints independent")
    ratios: Vector = parameter("velocity of each joint for a unit velocity of its leader; 1 for a leader")
    offsets: Vector = parameter("position of each joint at leader position 0; 0 for a leader", "rad or m")
    limits: JointLimits = piece("limits of the leaders that also keep the followers within theirs")
    leaders: tuple[int, ...] = piece("index of each joint's leader among the leading joints", static=True)
    joint_names: tuple[str, ...] = piece("names of the leading joints", static=True)
    joint_units: tuple[str, ...] = piece('"rad" or "m" for each leading joint', static=True)

    def __check_init__(self) -> None:
        m, n = self.arm.joints, len(self.joint_names)
        sizes = (np.size(self.ratios), np.size(self.offsets), len(self.leaders))
        if any(size != m for size in sizes):
            raise DefinitionError(
                f"`ratios`, `offsets` and `leaders` of a Coupled arm must have one entry for each of the {m} joints of "
                f"{self.arm.name}; got {', '.join(map(str, sizes))}"
            )
        if set(self.leaders) != set(range(n)) or len(self.joint_units) != n:
            raise DefinitionError(
                f"`leaders` must contain the index of each of the {n} leading joints, and `joint_units` {n} units; got "
                f"{self.leaders} and {self.joint_units}"
            )

    @property
    def name(self) -> str:
        """Name of the arm."""
        return self.arm.name

    @property
    def followers(self) -> tuple[str, ...]:
        """Names of the joints that follow others."""
        return tuple(name for name in self.arm.joint_names if name not in self.joint_names)

    @property
    def armature(self) -> Vector:
        """Rotor inertia at the leaders, including that of their followers [n], kg m² or kg."""
        return jnp.sum(self._ratio_matrix() ** 2 * self.arm.armature[:, None], axis=0)

    @property
    def viscous(self) -> Vector:
        """Viscous friction at the leaders, including that of their followers [n], N m s/rad or N s/m."""
        return jnp.sum(self._ratio_matrix() ** 2 * self.arm.viscous[:, None], axis=0)

    @property
    def coulomb(self) -> Vector:
        """Coulomb friction at the leaders, including that of their followers [n], N m or N."""
        return jnp.sum(jnp.abs(self._ratio_matrix()) * self.arm.coulomb[:, None], axis=0)

    def positions(self, q: Vector) -> Float[Array, " m"]:
        """Return the positions of all joints, `S q + s₀`, rad or m, from those of the leaders [n]."""
        return self.ratios * q[np.asarray(self.leaders)] + self.offsets

    def velocities(self, dq: Vector) -> Float[Array, " m"]:
        """Return the velocities of all joints, `S q̇`, rad/s or m/s, from those of the leaders [n]."""
        return self.ratios * dq[np.asarray(self.leaders)]

    def mass(self, q: Vector) -> Matrix:
        """Return `Sᵀ M_a S`, [n n], kg m², or with prismatic joints also kg m and kg."""
        s = self._ratio_matrix()
        half = jnp.sum(s[:, :, None] * self.arm.mass(self.positions(q))[:, None, :], axis=0)
        return jnp.sum(half[:, :, None] * s[None], axis=1)

    def bias(self, q: Vector, dq: Vector) -> Vector:
        """Return `Sᵀ (C_a S q̇ + G_a)`, [n], N m or N."""
        return self._onto_leaders(self.arm.bias(self.positions(q), self.velocities(dq)))

    def friction(self, dq: Vector) -> Vector:
        """Return `Sᵀ F_a(S q̇)`, [n], N m or N."""
        return self._onto_leaders(self.arm.friction(self.velocities(dq)))

    def potential(self, q: Vector) -> Scalar:
        return self.arm.potential(self.positions(q))

    def tip(self, q: Vector) -> Float[Array, "3"]:
        return self.arm.tip(self.positions(q))

    def tip_frame(self, q: Vector) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        """Return the tip's axes, as columns, and its position in the base frame, [3 3] and [3], m."""
        return self.arm.tip_frame(self.positions(q))

    def _ratio_matrix(self) -> Float[Array, "m n"]:
        chosen = np.asarray(self.leaders)[:, None] == np.arange(len(self.joint_names))
        return jnp.where(chosen, self.ratios[:, None], 0.0)

    def _onto_leaders(self, forces: Float[Array, " m"]) -> Vector:
        return jnp.sum(self._ratio_matrix() * forces[:, None], axis=0)


def couple(arm: Articulated, following: Mapping[str, tuple[str, float, float]]) -> Coupled:
    """Return an arm in which some joints follow others.

    A leader's range and velocity limit are reduced to keep its followers within theirs; its torque limit is unchanged.

    - `following`: by follower's name, the leader's name, the ratio of their velocities, and the follower's position at
      leader position 0, rad or m.

    Raises DefinitionError if a name is not a joint of the arm, a leader is a follower, a ratio is 0 or not finite, or a
    follower's range excludes its leader's.
    """
    names = arm.joint_names
    for follower, (leader, ratio, offset) in following.items():
        for name in (follower, leader):
            if name not in names:
                raise DefinitionError(f"joint `{name}` is not a joint of {arm.name}, which has {', '.join(names)}")
        if leader in following:
            raise DefinitionError(f"joint `{follower}` must follow an independent joint; `{leader}` is a follower")
        if not (np.isfinite([ratio, offset]).all() and ratio != 0.0):
            raise DefinitionError(
                f"the ratio of joint `{follower}` must be finite and not 0, and its offset finite; got {ratio:g} and "
                f"{offset:g}"
            )
    leading = [name for name in names if name not in following]
    how = {name: (name, 1.0, 0.0) for name in leading} | dict(following)
    return Coupled(
        arm=arm,
        ratios=as_array([how[name][1] for name in names]),
        offsets=as_array([how[name][2] for name in names]),
        limits=_limits(arm, how, leading),
        leaders=tuple(leading.index(how[name][0]) for name in names),
        joint_names=tuple(leading),
        joint_units=tuple(arm.joint_units[names.index(name)] for name in leading),
    )


def _limits(arm: Articulated, how: Mapping[str, tuple[str, float, float]], leading: list[str]) -> JointLimits:
    sheet = arm.limits
    own = [arm.joint_names.index(name) for name in leading]
    lower, upper = np.full(len(leading), -np.inf), np.full(len(leading), np.inf)
    velocity = np.full(len(leading), np.inf)
    for i, name in enumerate(arm.joint_names):
        leader, ratio, offset = how[name]
        j = leading.index(leader)
        ends = sorted((float(end) - offset) / ratio for end in (sheet.lower[i], sheet.upper[i]))
        lower[j], upper[j] = max(lower[j], ends[0]), min(upper[j], ends[1])
        velocity[j] = min(velocity[j], float(sheet.velocity[i]) / abs(ratio))
        if not lower[j] < upper[j]:
            raise DefinitionError(
                f"the range of joint `{name}` and that of joint `{leader}`, which it follows at the ratio {ratio:g} "
                f"and the offset {offset:g}, do not overlap"
            )
    return JointLimits(
        lower=as_array(lower),
        upper=as_array(upper),
        velocity=as_array(velocity),
        torque=sheet.torque[np.array(own)],
        torque_rate=sheet.torque_rate[np.array(own)],
    )
