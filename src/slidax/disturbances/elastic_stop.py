"""A stiff surface on one side of a joint, such as a table below a vertical axis."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from slidax.parts import PerJoint, Scalar, State, Vector, parameter

from .disturbance import AbstractDisturbance, Floats, Samples, largest


class ElasticStop(AbstractDisturbance):
    """`τ_d = -k z max(0, 1 + c q̇)`, `z = max(0, q - a)`: pushes back, never pulls, and takes energy from an impact.

    Source: Hunt and Crossley, Coefficient of restitution interpreted as damping in vibroimpact, 1975, with exponent 1.
    """

    title = "A stiff surface on one side of a joint, such as a table below a vertical axis."

    stiffness: PerJoint = parameter("k; 0 for a joint that meets nothing", "N m/rad or N/m", ">= 0")
    position: PerJoint = parameter("a, from which on the joint is in contact", "rad or m")
    damping: PerJoint = parameter("c, damping over stiffness", "s/rad or s/m", ">= 0", default=0.0)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The force, [n], N m or N."""
        deep = jnp.maximum(0.0, state.q - self.position)
        return -self.stiffness * deep * jnp.maximum(0.0, 1.0 + self.damping * state.dq)

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """Largest change of the force in a period in which the joint may touch the surface; else zero."""
        deepest = np.maximum(0.0, samples.q + samples.way - np.asarray(self.position))
        fastest = np.abs(samples.dq) + samples.turn
        damping, stiffness = largest(self.damping, upper.damping), largest(self.stiffness, upper.stiffness)
        moved = np.minimum(samples.way, deepest) * (1.0 + damping * fastest)
        return stiffness * (moved + deepest * damping * samples.turn)
