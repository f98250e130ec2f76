"""The textbook reaching law: damping, and a saturated torque for each joint."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from slidax.numerics import matvec, saturation, solve_symmetric, tangent_mask
from slidax.parts import Matrix, PerJoint, Scalar, Vector, parameter

from .reaching import AbstractReaching

SWEEPS = 2000
"""At most so many sweeps; for arms ten to fifty are enough."""

PRECISION = 2e-13
"""The residual that is reached, relative to 1 and the push."""


class SaturatedReaching(AbstractReaching):
    """`-K_D s - u w ∘ sat(s/φ)`; with φ = 0 the sign, set-valued at 0 in the implicit step.

    Source: Slotine and Li, Applied Nonlinear Control, 1991, chapters 7 and 9, where `u w = K`.
    """

    title = "The textbook reaching law: damping, and a saturated torque for each joint."

    damping: PerJoint = parameter("diagonal of K_D", "N m s/rad or N s/m", ">= 0", "(K_D; Slotine and Li, 1991)")
    weights: PerJoint = parameter("w, each joint's share of u, ‖w‖ <= 1", "", "[0, 1]", "a joint's share of u")
    layer: PerJoint = parameter(
        "φ, half-width of the boundary layer", "rad/s or m/s", ">= 0", "(the boundary layer φ; 0 gives the sign)"
    )

    def continuous_term(self, s: Vector) -> Vector:
        """`K_D s`, [n], N m or N."""
        return self.damping * s

    def switching_direction(self, s: Vector) -> Vector:
        """`w ∘ sat(s/φ)`, [n]."""
        return self.weights * saturation(s, self.layer)

    def implicit(self, metric: Matrix, s: Vector, u: Scalar) -> Vector:
        """The implicit step, [n], by exact sweeps over the joints, which converge for every SPD A."""
        return _step(self, metric, s, u)


class _Sweep(eqx.Module):
    s: Vector
    change: Scalar
    count: Int[Array, ""]


def _parts(law: SaturatedReaching, u: Scalar, n: int) -> tuple[Vector, Vector, Vector]:
    """K_D, K and φ, each [n]."""
    damping, gain, layer = (jnp.broadcast_to(x, (n,)) for x in (law.damping, u * law.weights, law.layer))
    return damping, gain, layer


@eqx.filter_custom_jvp
def _step(law: Any, metric: Matrix, s: Vector, u: Scalar) -> Vector:
    n = s.shape[0]
    damping, gain, layer = _parts(law, u, n)
    push = matvec(metric, s)
    stiffness = jnp.diagonal(metric) + damping
    edge = gain + stiffness * layer
    inner = jnp.where(layer > 0, 1.0 / (stiffness + gain / jnp.where(layer > 0, layer, 1.0)), 0.0)
    tolerance = 0.1 * PRECISION * (1.0 + jnp.max(jnp.abs(push)))

    def sweep(now: _Sweep) -> _Sweep:
        x = [now.s[i] for i in range(n)]
        change = jnp.zeros(())
        for i in range(n):
            rest = push[i] - sum((metric[i, j] * x[j] for j in range(n) if j != i), start=jnp.zeros(()))
            outer = (rest - jnp.sign(rest) * gain[i]) / stiffness[i]
            new = jnp.where(jnp.abs(rest) <= edge[i], rest * inner[i], outer)
            change = jnp.maximum(change, stiffness[i] * jnp.abs(new - x[i]))
            x[i] = new
        return _Sweep(jnp.stack(x), change, now.count + 1)

    def unfinished(now: _Sweep) -> Bool[Array, ""]:
        return (now.change > tolerance) & (now.count < SWEEPS)

    first = _Sweep(jnp.zeros_like(s), jnp.full((), jnp.inf), jnp.zeros((), int))
    return jax.lax.while_loop(unfinished, sweep, first).s


@_step.def_jvp  # type: ignore[untyped-decorator]
def _step_jvp(primals: Any, tangents: Any) -> tuple[Vector, Vector]:
    mask = tangent_mask(primals, tangents)
    moving, still = eqx.partition(primals, mask)
    root = _step(*primals)

    def residual(moving: Any) -> Vector:
        law, metric, s, u = eqx.combine(moving, still)
        return matvec(metric, root - s) + law.continuous_term(root) + u * law.switching_direction(root)

    _, change = jax.jvp(residual, (moving,), (eqx.filter(tangents, mask),))
    law, metric, _, u = primals
    damping, gain, layer = _parts(law, u, root.shape[0])
    stuck = (root == 0) & (layer <= 0)
    within = (jnp.abs(root) < layer) & ~stuck
    slope = damping + jnp.where(within, gain / jnp.where(within, layer, 1.0), 0.0)
    # A joint that is stuck at 0 stays there: its row and column are those of the identity.
    free = ~stuck
    both = free[:, None] & free[None, :]
    jacobian = jnp.where(both, metric, 0.0) + jnp.diag(jnp.where(free, slope, 1.0))
    return root, -solve_symmetric(jacobian, jnp.where(free, change, 0.0))
