"""Rotors and friction that are known, and stay as they are."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import PerJoint, State, Vector, parameter

from .adaptation import AbstractAdaptation, Experience, Learnt


class KnownJoints(AbstractAdaptation):
    """What was learnt before, or identified: it is used, and nothing is learnt."""

    title = "Rotors and friction that are known, and stay as they are."

    rotor: PerJoint = parameter("J, inertia on the diagonal beside that of the links", "kg m² or kg", default=0.0)
    coulomb: PerJoint = parameter("f, Coulomb friction that is compensated", "N m or N", ">= 0", default=0.0)

    def init(self, measured: State) -> Vector:
        """Zeros, one per joint, so that the number of joints is known.

        - `measured`: the first measurement.
        """
        return jnp.zeros_like(measured.q)

    def __call__(self, experience: Experience, memory: Vector) -> Vector:
        """The same.

        - `experience`: not used.
        - `memory`: zeros.
        """
        return memory

    def learnt(self, memory: Vector) -> Learnt:
        """What is known.

        - `memory`: zeros.
        """
        return Learnt(rotor=memory + self.rotor, coulomb=memory + self.coulomb)
