"""Known rotor inertia and friction, which stay constant."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import PerJoint, State, Vector, parameter

from .adaptation import AbstractAdaptation, Experience, Learnt


class KnownJoints(AbstractAdaptation):
    """Constant J and f, from an identification or an earlier run."""

    title = "Rotors and friction that are known, and stay as they are."

    rotor: PerJoint = parameter("J, inertia on the diagonal beside that of the links", "kg m² or kg", default=0.0)
    coulomb: PerJoint = parameter("f, Coulomb friction that is compensated", "N m or N", ">= 0", default=0.0)

    def init(self, measured: State) -> Vector:
        return jnp.zeros_like(measured.q)

    def __call__(self, experience: Experience, memory: Vector) -> Vector:
        return memory

    def learnt(self, memory: Vector) -> Learnt:
        return Learnt(rotor=memory + self.rotor, coulomb=memory + self.coulomb)
