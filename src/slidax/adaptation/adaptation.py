"""What every adaptation is: from what a sample shows to what is believed of the arm."""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.parts import AbstractPart, Matrix, Memory, PerJoint, Scalar, State, Vector, parameter
from slidax.robots import AbstractRobot

from .believed import Believed, with_rotors


class Experience(eqx.Module):
    """What one sample shows of the arm.

    - `q`: measured positions [n], rad or m.
    - `dq`: estimated velocities [n], rad/s or m/s.
    - `tau`: torque that acted in the period before the measurement [n], N m or N.
    - `mass`: inertia matrix of the nominal arm there [n n].
    - `bias`: C0 q̇ + G0 of the nominal arm there [n], N m or N.
    - `period`: h [s].
    - `missed`: whether samples were lost before this one.
    """

    q: Vector
    dq: Vector
    tau: Vector
    mass: Matrix
    bias: Vector
    period: Scalar
    missed: Bool[Array, ""]


class Learnt(eqx.Module):
    """What is believed of the joints.

    - `rotor`: inertia on the diagonal beside that of the links [n], kg m² or kg; a negative one says that the links are
      lighter than the nominal ones.
    - `coulomb`: Coulomb friction [n], N m or N.
    """

    rotor: Vector
    coulomb: Vector


class AbstractAdaptation(AbstractPart):
    """What is believed of an arm beside its nominal model, `M̂ = M0 + diag(J - J0)` and `F̂ = f tanh(q̇/v_s)`.

    J0 is the rotors' inertia that the nominal model counts already; where `J < 0` the links themselves are lighter, and
    rows and columns of M0 are scaled, so that M̂ is positive definite (`Believed`).
    """

    counted: PerJoint = parameter("J0, rotor inertia that the nominal arm has", "kg m² or kg", ">= 0", default=0.0)
    smoothing: PerJoint = parameter(
        "v_s, velocity within which Coulomb friction turns", "rad/s or m/s", "> 0", default=0.02
    )

    @abstractmethod
    def init(self, measured: State) -> Memory:
        """What is kept between two samples, from the first measurement: any pytree of arrays.

        - `measured`: the first measurement.
        """

    @abstractmethod
    def __call__(self, experience: Experience, memory: Memory) -> Memory:
        """The memory after a sample.

        - `experience`: what it shows.
        - `memory`: what `init` or the last sample returned.
        """

    @abstractmethod
    def learnt(self, memory: Memory) -> Learnt:
        """What is believed of the joints.

        - `memory`: what `init` or a sample returned.
        """

    def robot(self, nominal: AbstractRobot, memory: Memory) -> AbstractRobot:
        """The arm as it is believed to be, without its friction.

        - `nominal`: the robot as the law knows it.
        - `memory`: what `init` or a sample returned.
        """
        return Believed.of(nominal, self.learnt(memory).rotor, self.counted)

    def mass_at_start(self, mass: Matrix) -> Matrix:
        """M̂ before anything is learnt, [n n].

        - `mass`: M0 there [n n].
        """
        nothing = jnp.zeros(mass.shape[0])
        rotor = self.learnt(self.init(State(q=nothing, dq=nothing))).rotor
        return with_rotors(mass, rotor, self.counted)

    def friction(self, memory: Memory, dq: Vector) -> Vector:
        """`f tanh(q̇/v_s)`, the Coulomb friction that is compensated [n], N m or N.

        - `memory`: what `init` or a sample returned.
        - `dq`: velocities [n]; those of the reference, which has no noise.
        """
        return self.learnt(memory).coulomb * jnp.tanh(dq / self.smoothing)
