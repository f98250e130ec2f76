"""Levant's second-order differentiator, implicit in time, around the model's prediction."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.parts import PerJoint, Scalar, State, Vector, parameter

from .estimator import AbstractEstimator, Estimate

# Levant (2003) with (1.1, 1.5, 2) in the recursive form: λ0 = 2, λ1 = 1.5 √2, λ2 = 1.1 in the one below.
GAINS = (2.0, 2.12, 1.1)
NEWTON_STEPS = 5


class RobustDifferentiator(AbstractEstimator):
    """`σ̇0 = σ1 - λ0 L^⅓ sig^⅔(σ0)`, `σ̇1 = σ2 - λ1 L^⅔ sig^⅓(σ0)`, `σ̇2 ∈ -λ2 L Sgn(σ0) - d(push)/dt`, implicit in time.

    σ0, σ1, σ2 are the errors of position, velocity and push. They reach zero in finite time if the push changes no
    faster than L. Measured velocities are not used.

    With `r = q' - q_predicted`, `R = |r|/(L h³)` and the error left in the position, `σ0 = L h³ y³ sgn(r)`, a step of
    implicit Euler is `y³ + λ0 y² + λ1 y + λ2 s = R`, where `s = min(R/λ2, 1)` is selected from the set-valued sign.
    Then `q = q' - σ0`, `q̇ = q̇_predicted + L h² (λ1 y + 3/2 λ2 s) sgn(r)`, `push⁺ = push + L h λ2 s sgn(r)`. While
    `R <= λ2`, y is 0 and the estimate is the one whose error is gone after three samples, without chattering. The 3/2
    is 1 for the Euler step, whose velocity lags by half a period, and 1/2 for that half (Seeber): what is predicted
    exactly with a constant push is then estimated exactly.

    Source: Levant, Higher-order sliding modes, differentiation and output-feedback control, 2003; implicit in time:
    Acary, Brogliato, Orlov, 2012, and Mojallizadeh, Brogliato, Acary, 2021; without bias: Seeber, Proper implicit
    discretization of arbitrary-order robust exact differentiators, 2024.
    """

    title = "Levant's second-order differentiator, implicit in time, around the model's prediction."

    lipschitz: PerJoint = parameter("L, how fast the push may change", "rad/s³ or m/s³", "> 0", "(L, Levant, 2003)")

    def init(self, measured: State) -> tuple[()]:
        return ()

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: tuple[()]
    ) -> tuple[Estimate, tuple[()]]:
        """The estimate with the smallest position error that a change of the push can explain."""
        residual = measured.q - prior.state.q
        sign = jnp.sign(residual)
        # The bounds are out of reach of any arm; they keep the quotient finite for all numbers.
        scale = jnp.maximum(self.lipschitz * elapsed * elapsed * elapsed, 1e-290)
        ratio = jnp.minimum(jnp.abs(residual), 1e290 * scale) / scale
        _, l1, l2 = GAINS
        y = _root(jnp.maximum(ratio - l2, 0.0))
        selection = jnp.minimum(ratio, l2)
        pull = sign * scale
        usual = Estimate(
            state=State(
                q=measured.q - pull * y * y * y,
                dq=prior.state.dq + pull * (l1 * y + 1.5 * selection) / elapsed,
            ),
            push=prior.push + pull * selection / elapsed / elapsed,
        )
        # A step over a gap is as exact as any in the state; the push is not learnt from it.
        return Estimate(state=usual.state, push=jnp.where(missed, prior.push, usual.push)), ()


def _root(rest: Vector) -> Vector:
    """The y >= 0 with `y³ + λ0 y² + λ1 y = rest`, for `rest >= 0`.

    The left side is increasing and convex, so Newton's steps from above never pass the root. Each of the three terms
    alone would give a larger y; the least of these is at most 1.4 times the root.
    """
    l0, l1, _ = GAINS
    outside = rest > 0
    safe = jnp.where(outside, rest, 1.0)
    y = jnp.minimum(jnp.minimum(jnp.cbrt(safe), jnp.sqrt(safe / l0)), safe / l1)
    for _ in range(NEWTON_STEPS):
        # The next y itself and not a difference from the last: nothing cancels.
        y = (y * y * (2.0 * y + l0) + safe) / (y * (3.0 * y + 2.0 * l0) + l1)
    return jnp.where(outside, y, 0.0)
