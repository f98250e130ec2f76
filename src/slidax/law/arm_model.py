"""Parameters of an arm that a law can learn, and the arm model with these parameters."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from slidax.arms.adjusted import PAYLOAD, Adjusted
from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.core.errors import DefinitionError
from slidax.core.linear_algebra import solve_symmetric
from slidax.core.parameter import parameter, piece
from slidax.core.types import Matrix, PerJoint, Scalar, State, Vector

from .adaptation import AbstractAdaptation, Believed, Experience, LearnedParameters

FRICTION_SPEEDS = 0.01, 0.04
"""rad/s or m/s: v_1 and v_2 in the two shapes `tanh(q̇/v)` of Coulomb friction; the true arm's v may lie between."""


class ArmParameters(eqx.Module):
    """Differences of an arm from its nominal model, in 10 + 5 n numbers.

    - `payload`: body added at the tip, in the frame of the joint that carries the tip [10]: mass, mass times centre,
      inertia about the origin (xx, yy, zz, xy, xz, yz), kg, kg m, kg m².
    - `factors`: relative change of each link's mass and inertia [n].
    - `viscous`: viscous friction [n], N m s/rad or N s/m.
    - `first`, `second`: Coulomb friction, as coefficients of `tanh(q̇/v_1)` and `tanh(q̇/v_2)`, with v_1 and v_2 from
      `FRICTION_SPEEDS` [n], N m or N.
    - `rotor`: change of each rotor's inertia [n], kg m² or kg.
    - `more`: coefficients of further torques of the drives (`TorqueShapes`) [m n], N m or N; None if there are none.
    """

    payload: Float[Array, "10"]
    factors: Vector
    viscous: Vector
    first: Vector
    second: Vector
    rotor: Vector
    more: Float[Array, "m n"] | None = None

    @classmethod
    def of(cls, vector: Float[Array, " p"], more: int = 0) -> ArmParameters:
        """Return the parameters from one vector, in the order of the fields, except that `rotor` is last.

        - `more`: number m of further torque coefficients for each joint.
        """
        payload = vector[:PAYLOAD]
        factors, viscous, first, second, *shapes, rotor = vector[PAYLOAD:].reshape(5 + more, -1)
        return cls(payload, factors, viscous, first, second, rotor, jnp.stack(shapes) if more else None)

    def vector(self) -> Float[Array, " p"]:
        """Return all parameters as one vector, in the order of `of`."""
        friction = self.viscous, self.first, self.second
        return jnp.concatenate([self.payload, self.factors, *friction, *self._more(), self.rotor])

    def _more(self) -> list[Vector]:
        return [] if self.more is None else list(self.more)

    def friction(self, dq: Vector) -> Vector:
        """Return the friction at a velocity, [n], N m or N."""
        slow, fast = friction_shapes(dq)
        return self.viscous * dq + self.first * slow + self.second * fast

    @property
    def coulomb(self) -> Vector:
        """Coulomb friction of both shapes [n], N m or N."""
        return self.first + self.second


def friction_shapes(dq: Vector) -> tuple[Vector, Vector]:
    """Return `tanh(q̇/v_1)` and `tanh(q̇/v_2)`, [n] each, with v_1 and v_2 from `FRICTION_SPEEDS`."""
    # As `v_2 = 4 v_1`, the first follows by two double-angle steps.
    second = jnp.tanh(dq / FRICTION_SPEEDS[1])
    half = 2.0 * second / (1.0 + second * second)
    return 2.0 * half / (1.0 + half * half), second


class TorqueShapes(eqx.Module):
    """Stribeck friction and position ripple of the drives, linear in the coefficients c_0, c_1 and c_2.

    Stribeck friction is `c_0 exp(-(q̇/v_st)²) tanh(q̇/v_1)`. Ripple is `c_1 cos(N q) + c_2 sin(N q)`.

    - `stribeck`: v_st; None without Stribeck friction.
    - `ripple`: N, periods per turn; None without ripple.
    """

    stribeck: PerJoint | None
    ripple: PerJoint | None

    @property
    def count(self) -> int:
        """Number of coefficients for each joint."""
        return (self.stribeck is not None) + 2 * (self.ripple is not None)

    def signals(self, coefficients: Float[Array, "m n"] | None) -> dict[str, Vector]:
        """Return the coefficients by name, [n] each; empty for None."""
        names = ["static_excess"] * (self.stribeck is not None)
        names += ["ripple_cosine", "ripple_sine"] * (self.ripple is not None)
        return {} if coefficients is None else dict(zip(names, coefficients, strict=True))

    def of(self, q: Vector, dq: Vector) -> list[Vector]:
        """Return the torques for coefficients of 1, [n] each: Stribeck friction, cosine and sine of the ripple."""
        return [*self._slow(dq), *self._waves(q)]

    def friction(self, dq: Vector, coefficients: Float[Array, "m n"]) -> Vector:
        """Return Stribeck friction, [n], N m or N; `coefficients` in the order of `of`."""
        slow = self._slow(dq)
        return coefficients[0] * slow[0] if slow else jnp.zeros_like(dq)

    def ripple_torque(self, q: Vector, coefficients: Float[Array, "m n"]) -> Vector:
        """Return the torque that compensates ripple, [n], N m or N; `coefficients` in the order of `of`."""
        cosine, sine = self._waves(q)
        return coefficients[-2] * cosine + coefficients[-1] * sine

    def _slow(self, dq: Vector) -> list[Vector]:
        if self.stribeck is None:
            return []
        return [jnp.exp(-((dq / self.stribeck) ** 2)) * jnp.tanh(dq / FRICTION_SPEEDS[0])]

    def _waves(self, q: Vector) -> list[Vector]:
        return [] if self.ripple is None else [jnp.cos(self.ripple * q), jnp.sin(self.ripple * q)]


class Rippled(AbstractRobot):
    """An arm with position-dependent torque ripple; its bias contains the torque that compensates the ripple."""

    joint_units: tuple[str, ...] = piece('"rad" or "m" for each joint', static=True)
    joint_names: tuple[str, ...] = piece("names of the joints", static=True)
    arm: AbstractRobot = piece("the arm without ripple")
    shapes: TorqueShapes = piece("shapes of the ripple")
    coefficients: Float[Array, "m n"] = parameter("coefficients of the shapes", "N m or N")

    def mass(self, q: Vector) -> Matrix:
        return self.arm.mass(q)

    def bias(self, q: Vector, dq: Vector) -> Vector:
        return self.arm.bias(q, dq) + self.shapes.ripple_torque(q, self.coefficients)

    def friction(self, dq: Vector) -> Vector:
        return self.arm.friction(dq)

    def potential(self, q: Vector) -> Scalar:
        cosine, sine = self.coefficients[-2:]
        assert self.shapes.ripple is not None
        phase = self.shapes.ripple * q
        return self.arm.potential(q) + jnp.sum((cosine * jnp.sin(phase) - sine * jnp.cos(phase)) / self.shapes.ripple)

    def tip(self, q: Vector) -> Float[Array, "3"]:
        return self.arm.tip(q)


def coupled_inertia(mass: Matrix, share: Scalar) -> Vector:
    """Return the inertia from which each joint's estimator bandwidth is computed, [n], kg m² or kg.

    It is the geometric mean of `M_ii` and `1/√(Σ_j (M⁻¹)_ij²)` with the weights 1 - α and α. The second is the joint's
    effective inertia under independent random torques of equal variance on all joints. The coupling by a payload makes
    it much smaller than `M_ii`.

    - `mass`: inertia matrix M [n n].
    - `share`: α, weight of the learnt arm model in the law's model.
    """
    inverse = jax.vmap(solve_symmetric, (None, 0))(mass, jnp.eye(mass.shape[0]))
    diagonal = jnp.diagonal(mass)
    smaller = jnp.log(jnp.sum(inverse * inverse, axis=1) * diagonal * diagonal)
    return diagonal * jnp.exp(-0.5 * share * smaller)


def parameter_count(joints: int, more: int = 0) -> int:
    """Return the number of parameters of an arm with `more` further torque coefficients for each joint."""
    return PAYLOAD + (5 + more) * joints


def arm_with(nominal: AbstractRobot, share: Scalar, parameters: ArmParameters) -> Adjusted:
    """Return a nominal arm with changed payload and links; its rotors and friction stay nominal.

    - `share`: factor of the changes, 0 to 1.
    - `parameters`: the changes; only `payload` and `factors` are used.

    Raises DefinitionError if the arm is not an articulated one.
    """
    if not isinstance(nominal, Articulated):
        raise DefinitionError(
            f"the payload and the links of a {type(nominal).__name__} cannot be learnt, only those of an articulated "
            "arm: use `joint_learning`, or describe the arm by its links"
        )
    return Adjusted.of(nominal, share * parameters.factors, share * parameters.payload)


def articulated(arm: AbstractRobot | None) -> Articulated:
    """Return the same arm with the type `Articulated`, for a caller that has checked it by `arm_with`."""
    assert isinstance(arm, Articulated)
    return arm


def link_body(arm: Articulated) -> Float[Array, "10"]:
    """Return the nominal body of the link that carries the tip, with its payload [10], as `ArmParameters.payload`."""
    bodies, at = arm.bodies(), arm.tip_joint
    return jnp.concatenate([bodies.mass[at][None], bodies.moment[:, at], bodies.inertia[:, at]])


class KnownArm(AbstractAdaptation):
    """Constant differences from the nominal arm, from an identification or an earlier run of `ArmLearning`."""

    title = "Known payload, link masses, friction and rotor inertia, constant during the run."
    moves_bias: ClassVar[bool] = True

    payload: Float[Array, "10"] = parameter(
        "body added at the tip, in the frame of the joint that carries the tip: mass, mass times centre, inertia "
        "about the origin (xx, yy, zz, xy, xz, yz)",
        "kg, kg m, kg m²",
        default=(0.0,) * PAYLOAD,
    )
    factors: PerJoint = parameter("relative change of each link's mass and inertia", "", "> -1", default=0.0)
    viscous: PerJoint = parameter("viscous friction that is compensated", "N m s/rad or N s/m", default=0.0)
    first: PerJoint = parameter("Coulomb friction with the shape tanh(q̇/0.01)", "N m or N", default=0.0)
    second: PerJoint = parameter("Coulomb friction with the shape tanh(q̇/0.04)", "N m or N", default=0.0)
    rotor: PerJoint = parameter("J, rotor inertia", "kg m² or kg", default=0.0)

    def per_joint(self) -> AbstractAdaptation:
        known: AbstractAdaptation = eqx.tree_at(lambda own: own.payload, self, None)
        return known

    def init(self, measured: State) -> Vector:
        return jnp.zeros_like(measured.q)

    def __call__(self, experience: Experience, memory: Vector) -> Vector:
        return memory

    def parameters(self, memory: Vector) -> ArmParameters:
        """Return the differences from the nominal arm."""
        friction = memory + self.viscous, memory + self.first, memory + self.second
        return ArmParameters(self.payload, memory + self.factors, *friction, memory + self.rotor - self.counted)

    def changed_links(self, memory: Vector) -> Bool[Array, ""]:
        return jnp.zeros((), bool)

    def learnt(self, memory: Vector) -> LearnedParameters:
        return LearnedParameters(rotor=memory + self.rotor, coulomb=memory + self.first + self.second)

    def robot(self, nominal: AbstractRobot, memory: Vector) -> Believed:
        arm = arm_with(nominal, jnp.ones(()), self.parameters(memory))
        return Believed.of(arm, self.learnt(memory).rotor, self.counted)

    def friction(self, memory: Vector, dq: Vector) -> Vector:
        return self.parameters(memory).friction(dq)
