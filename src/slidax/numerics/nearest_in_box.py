"""Projection onto a box in a weighted norm."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from slidax._types import Matrix, Vector

from .ldl import solve_symmetric

SWEEPS = 30
"""Sweeps over the joints; each divides the distance to the answer, for arms by two or more."""


def nearest_in_box(wanted: Vector, lower: Vector, upper: Vector, mass: Matrix) -> Vector:
    """The x in the box that minimises `(x - wanted)ᵀ M⁻¹ (x - wanted)`, [n].

    Of all torques within their limits, these give the accelerations nearest to the wanted ones, weighted by the inertia
    (Gauss's principle of least constraint, 1829). A joint that is not at its limit gets its wanted acceleration,
    although another joint lacks torque. Clipping each torque separately would disturb the coupled joints.

    - `wanted`: [n].
    - `lower`, `upper`: the box [n]; may be infinite.
    - `mass`: M, symmetric positive definite [n n].
    """

    def project() -> Vector:
        n = wanted.shape[0]
        inverse: Matrix = jax.vmap(solve_symmetric, in_axes=(None, 0))(mass, jnp.eye(n))
        least, most = lower - wanted, upper - wanted

        def sweep(_: Int[Array, ""], x: Vector) -> Vector:
            for i in range(n):
                pull = jnp.sum(inverse[i] * x) - inverse[i, i] * x[i]
                x = x.at[i].set(jnp.clip(-pull / inverse[i, i], least[i], most[i]))
            return x

        start = jnp.clip(jnp.zeros_like(wanted), least, most)
        # The sum may round away from the limit that it is to be at.
        return jnp.clip(wanted + jax.lax.fori_loop(0, SWEEPS, sweep, start), lower, upper)

    inside = jnp.all((wanted >= lower) & (wanted <= upper))
    return jax.lax.cond(inside, lambda: wanted, project)
