"""Adaptation laws for rotor inertia and Coulomb friction."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from slidax.arms.arm import AbstractRobot
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import Matrix, Memory, PerJoint, Scalar, State, Vector

LEAST_SHARE = 0.01
"""Least diagonal entry of M̂ where J < 0, over the entry without rotor `M0_ii - J0`: M̂ stays positive definite."""


class Believed(AbstractRobot):
    """Nominal arm with other rotor inertia: its inertia matrix is `M̂ = S (M0 + diag(max(J, 0) - J0)) S`.

    M0 and J0 are the nominal inertia matrix and rotor inertia, J is the estimated rotor inertia. Bias and friction are
    nominal. S is diagonal. Its entry is 1 where `J >= 0`. Where `J < 0` it scales the joint's row and column so that
    the diagonal entry becomes `M0_ii + J - J0`, but at least 1 % of `M0_ii - J0`.

    M̂ is positive definite if every J is positive, since the links' part `M0 - diag(J0)` is positive semidefinite. The
    congruence with S does not change that.
    """

    joint_units: tuple[str, ...] = piece('"rad" or "m" for each joint', static=True)
    joint_names: tuple[str, ...] = piece("names of the joints", static=True)
    nominal: AbstractRobot = piece("the robot as the law knows it")
    rotor: Vector = parameter("J, inertia on the diagonal in addition to that of the links", "kg m² or kg")
    counted: PerJoint = parameter("J0, rotor inertia that the nominal arm has", "kg m² or kg", ">= 0")

    @classmethod
    def of(cls, nominal: AbstractRobot, rotor: Vector, counted: PerJoint) -> Believed:
        """Return a nominal arm with the rotor inertia J in place of J0.

        - `rotor`, `counted`: J [n] and J0, kg m² or kg.
        """
        return cls(
            joint_units=nominal.joint_units,
            joint_names=nominal.joint_names,
            nominal=nominal,
            rotor=rotor,
            counted=counted,
        )

    def mass(self, q: Vector) -> Matrix:
        return with_rotors(self.nominal.mass(q), self.rotor, self.counted)

    def bias(self, q: Vector, dq: Vector) -> Vector:
        return self.nominal.bias(q, dq)

    def friction(self, dq: Vector) -> Vector:
        return self.nominal.friction(dq)

    def potential(self, q: Vector) -> Scalar:
        return self.nominal.potential(q)

    def tip(self, q: Vector) -> Float[Array, "3"]:
        return self.nominal.tip(q)


# Traced once, and one function in exported C, as the functions of `Articulated`.
@jax.jit
def with_rotors(mass: Matrix, rotor: Vector, counted: PerJoint) -> Matrix:
    """Return the inertia matrix with the rotor inertia J in place of J0, [n n], as in `Believed`.

    - `mass`: M0 of the nominal arm [n n].
    - `rotor`, `counted`: J [n] and J0, kg m² or kg.
    """
    diagonal = jnp.eye(mass.shape[0], dtype=bool)
    heavier = mass + jnp.where(diagonal, (jnp.maximum(rotor, 0.0) - counted)[:, None], 0.0)
    entry = jnp.diagonal(heavier)
    scale = jnp.sqrt(jnp.maximum((entry + jnp.minimum(rotor, 0.0)) / entry, LEAST_SHARE))
    return heavier * scale[:, None] * scale[None, :]


class Experience(eqx.Module):
    """Input of an adaptation law at one sample.

    - `q`: measured positions [n], rad or m.
    - `dq`: estimated velocities [n], rad/s or m/s.
    - `tau`: torque that acted in the period before the measurement [n], N m or N.
    - `mass`: inertia matrix of the nominal arm at this state [n n].
    - `bias`: C0 q̇ + G0 of the nominal arm at this state [n], N m or N.
    - `period`: h [s].
    - `missed`: True if samples were lost before this one.
    - `nominal`: the nominal arm; None for an adaptation that needs only `mass` and `bias`.
    """

    q: Vector
    dq: Vector
    tau: Vector
    mass: Matrix
    bias: Vector
    period: Scalar
    missed: Bool[Array, ""]
    nominal: AbstractRobot | None = None


class LearnedParameters(eqx.Module):
    """Estimated parameters of the joints.

    - `rotor`: inertia on the diagonal in addition to that of the links [n], kg m² or kg; negative if the links are
      lighter than the nominal ones.
    - `coulomb`: Coulomb friction [n], N m or N.
    """

    rotor: Vector
    coulomb: Vector


class AbstractAdaptation(AbstractPart):
    """Correction of an arm's nominal model: inertia `M̂ = M0 + diag(J - J0)` and Coulomb friction `f tanh(q̇/v_s)`.

    J and f are the estimated rotor inertia and Coulomb friction. M0 and J0 are nominal. J < 0 means that the links are
    lighter than the nominal ones. Rows and columns of M0 are then scaled, so that M̂ is positive definite (`Believed`).
    """

    moves_bias: ClassVar[bool] = False
    """True if the adaptation also changes the model's bias `C q̇ + G` and its viscous friction."""

    counted: PerJoint = parameter("J0, rotor inertia that the nominal arm has", "kg m² or kg", ">= 0", default=0.0)
    smoothing: PerJoint = parameter(
        "v_s, velocity scale of the smoothed Coulomb friction", "rad/s or m/s", "> 0", default=0.02
    )

    @abstractmethod
    def init(self, measured: State) -> Memory:
        """Return the initial memory, any pytree of arrays, from the first measurement."""

    @abstractmethod
    def __call__(self, experience: Experience, memory: Memory) -> Memory:
        """Return the memory after a sample.

        - `experience`: motion and torque at this sample.
        - `memory`: from `init` or the last sample.
        """

    @abstractmethod
    def learnt(self, memory: Memory) -> LearnedParameters:
        """Return the estimated parameters of the joints."""

    def per_joint(self) -> AbstractAdaptation:
        """Return a copy that keeps only parameters of one number, or one for each joint.

        `SampledData` compares the shapes in this copy with the number of joints.
        """
        return self

    def signals(self, memory: Memory) -> dict[str, Array]:
        """Return the estimates by name, for logs: `rotor` (J) and `coulomb` (f) [n]."""
        learnt = self.learnt(memory)
        return {"rotor": learnt.rotor, "coulomb": learnt.coulomb}

    def share(self, memory: Memory) -> Scalar:
        """Return the weight of the learnt model in the law's model, from 0 (not used) to 1 (fully used)."""
        return jnp.ones(())

    def settled(self, memory: Memory) -> Bool[Array, ""]:
        """True while the law uses the learnt model with its full weight, 1."""
        return jnp.ones((), bool)

    def robot(self, nominal: AbstractRobot, memory: Memory) -> Believed:
        """Return the nominal arm with the estimated rotor inertias J."""
        return Believed.of(nominal, self.learnt(memory).rotor, self.counted)

    def changed_links(self, memory: Memory) -> Bool[Array, ""]:
        """True if the last sample may have changed payload or links of the model.

        It is read only if `moves_bias`: where learning changes C q̇ + G of the model, too.
        """
        return jnp.ones((), bool)

    def filter_inertia(self, robot: AbstractRobot, q: Vector, memory: Memory) -> Vector:
        """Return the inertia from which each joint's estimator bandwidth is computed, [n], kg m² or kg.

        It is `M̂_ii(q)` by default.

        - `robot`: the arm with the estimated parameters.
        """
        return jnp.diagonal(robot.mass(q))

    def frozen(self, memory: Memory) -> AbstractAdaptation:
        """Return a constant adaptation with the current estimates; its own memory is zeros [n]."""
        learnt = self.learnt(memory)
        return KnownJoints(rotor=learnt.rotor, coulomb=learnt.coulomb, counted=self.counted, smoothing=self.smoothing)

    def mass_at_start(self, mass: Matrix) -> Matrix:
        """Return the inertia matrix M̂ that the law uses before the first sample, [n n]; `mass`: the nominal M0."""
        nothing = jnp.zeros(mass.shape[0])
        rotor = self.learnt(self.init(State(q=nothing, dq=nothing))).rotor
        return with_rotors(mass, rotor, self.counted)

    def friction(self, memory: Memory, dq: Vector) -> Vector:
        """Return the Coulomb friction to compensate, `f tanh(q̇/v_s)` [n], N m or N.

        - `dq`: velocities of the reference [n], which have no noise.
        """
        return self.learnt(memory).coulomb * jnp.tanh(dq / self.smoothing)


class KnownJoints(AbstractAdaptation):
    """Constant J and f, from an identification or an earlier run."""

    title = "Known rotor inertia and friction, constant during the run."

    rotor: PerJoint = parameter(
        "J, inertia on the diagonal in addition to that of the links", "kg m² or kg", default=0.0
    )
    coulomb: PerJoint = parameter("f, Coulomb friction that is compensated", "N m or N", ">= 0", default=0.0)

    def init(self, measured: State) -> Vector:
        return jnp.zeros_like(measured.q)

    def __call__(self, experience: Experience, memory: Vector) -> Vector:
        return memory

    def learnt(self, memory: Vector) -> LearnedParameters:
        return LearnedParameters(rotor=memory + self.rotor, coulomb=memory + self.coulomb)


LOUDEST = 1e6
"""rad/s²: upper limit of the result of `noise_of`; such noise hides every inertia."""

STAGES = 5
"""Stages of the band-pass: two high-passes and three low-passes of first order."""


def filter_step(
    stages: Float[Array, "5 k n"], signals: Float[Array, "k n"], low: Scalar, high: Scalar, period: Scalar
) -> Float[Array, "5 k n"]:
    """Return the states of the band-pass after a sample; the last stage is its output.

    Two high-passes of first order at `low` remove slow signals, such as weight that the model does not know. Three
    low-passes at `high` then bound the second difference of rounded positions.

    - `stages`: states before the sample: two low-passed parts that are subtracted, then three low-passes.
    - `signals`: k signals of each joint at this sample.
    - `low`, `high`: ends of the band [rad/s].
    - `period`: h [s].
    """
    a, b = -jnp.expm1(-low * period), -jnp.expm1(-high * period)
    slow = stages[0] + a * (signals - stages[0])
    once = signals - slow
    slower = stages[1] + a * (once - stages[1])
    first = stages[2] + b * (once - slower - stages[2])
    second = stages[3] + b * (first - stages[3])
    return jnp.stack([slow, slower, first, second, stages[4] + b * (second - stages[4])])


def settled_stages(signals: Float[Array, "k n"]) -> Float[Array, "5 k n"]:
    """Return the states of the band-pass after a long time with constant signals: the output is 0."""
    nothing = jnp.zeros_like(signals)
    return jnp.stack([signals] + [nothing] * (STAGES - 1))


def noise_of(deviation: float, low: float, high: float, period: float) -> float:
    """Return the standard deviation of a measured acceleration in the band, rad/s², for white position noise.

    `σ √(h/π ∫ |D(ω) F(ω)|² dω)` up to `π/h`, with D and F the frequency responses of the second difference and
    the band-pass (`filter_step`).

    - `deviation`: σ, standard deviation of a measured position, rad; `r/√12` for a resolution r.
    - `low`, `high`: ends of the band [rad/s].
    - `period`: h [s].
    """
    delay = np.exp(-1j * np.linspace(1e-6, math.pi, 4096))
    a, b = -math.expm1(-low * period), -math.expm1(-high * period)
    below, above = (share / (1 - (1 - share) * delay) for share in (a, b))
    # In units of 1/h², so that no period is too short.
    response = (1 - delay) ** 2 * (1 - below) ** 2 * above**3
    size = math.sqrt(float(np.mean(np.abs(response) ** 2)))
    return min(deviation / period * size / period, LOUDEST)
