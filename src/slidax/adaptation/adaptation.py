"""Base class of adaptation laws, with their input and their result."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.parts import AbstractPart, Matrix, Memory, PerJoint, Scalar, State, Vector, parameter
from slidax.robots import AbstractRobot

from .believed import Believed, with_rotors


class Experience(eqx.Module):
    """Input of an adaptation law at one sample.

    - `q`: measured positions [n], rad or m.
    - `dq`: estimated velocities [n], rad/s or m/s.
    - `tau`: torque that acted in the period before the measurement [n], N m or N.
    - `mass`: inertia matrix of the nominal arm there [n n].
    - `bias`: C0 q̇ + G0 of the nominal arm there [n], N m or N.
    - `period`: h [s].
    - `missed`: True if samples were lost before this one.
    """

    q: Vector
    dq: Vector
    tau: Vector
    mass: Matrix
    bias: Vector
    period: Scalar
    missed: Bool[Array, ""]


class Learnt(eqx.Module):
    """Estimated parameters of the joints.

    - `rotor`: inertia on the diagonal in addition to that of the links [n], kg m² or kg; negative if the links are
      lighter than the nominal ones.
    - `coulomb`: Coulomb friction [n], N m or N.
    """

    rotor: Vector
    coulomb: Vector


class AbstractAdaptation(AbstractPart):
    """Correction of an arm's nominal model, `M̂ = M0 + diag(J - J0)` and `F̂ = f tanh(q̇/v_s)`.

    J0 is the rotor inertia that the nominal model contains already. Where `J < 0` the links themselves are lighter, and
    rows and columns of M0 are scaled, so that M̂ is positive definite (`Believed`).
    """

    counted: PerJoint = parameter("J0, rotor inertia that the nominal arm has", "kg m² or kg", ">= 0", default=0.0)
    smoothing: PerJoint = parameter(
        "v_s, velocity within which Coulomb friction turns", "rad/s or m/s", "> 0", default=0.02
    )

    @abstractmethod
    def init(self, measured: State) -> Memory:
        """Return the initial memory, any pytree of arrays, from the first measurement."""

    @abstractmethod
    def __call__(self, experience: Experience, memory: Memory) -> Memory:
        """Return the memory after a sample.

        - `memory`: from `init` or the last sample.
        """

    @abstractmethod
    def learnt(self, memory: Memory) -> Learnt:
        """Return the estimated parameters of the joints."""

    def robot(self, nominal: AbstractRobot, memory: Memory) -> AbstractRobot:
        """Return the nominal arm with the estimated inertias; its friction stays nominal."""
        return Believed.of(nominal, self.learnt(memory).rotor, self.counted)

    def mass_at_start(self, mass: Matrix) -> Matrix:
        """Return M̂ before the first sample, [n n], from M0 [n n]."""
        nothing = jnp.zeros(mass.shape[0])
        rotor = self.learnt(self.init(State(q=nothing, dq=nothing))).rotor
        return with_rotors(mass, rotor, self.counted)

    def friction(self, memory: Memory, dq: Vector) -> Vector:
        """Return the Coulomb friction to compensate, `f tanh(q̇/v_s)` [n], N m or N.

        - `dq`: velocities of the reference [n], which have no noise.
        """
        return self.learnt(memory).coulomb * jnp.tanh(dq / self.smoothing)
