"""The classical sliding-mode law of Slotine and Li."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from slidax._types import Command, Reference
from slidax.numerics import matvec, saturation, vector_norm
from slidax.parts import Memory, PerJoint, Scalar, State, Vector, parameter
from slidax.reaching import FixedBound, SaturatedReaching
from slidax.surfaces import sliding_variable

from .model_based import AbstractSurfaceBased
from .steps import AbstractStep, Recovery, SlidingStep


class SlotineLi(AbstractSurfaceBased):
    """`τ = M0 q̈_r + C0 q̇_r + G0 - K_D s - K sat(s/φ)` with the reference velocity `q̇_r = q̇ - s`.

    On the linear surface `s = ė + Λ e` it is the textbook law, `q̇_r = q̇_d - Λ e`, `q̈_r = q̈_d - Λ ė`. On any other
    surface, with any transformation, `s = ė + A e + pull(ε1)` as in (40) and `q̈_r = q̈_d - Ȧ e - A ė - slope(ε1) ε2`.
    C0 is in Christoffel form, for which `Ṁ0 - 2 C0` is skew-symmetric.

    Source: Slotine and Li, Applied Nonlinear Control, 1991, chapters 7 (boundary layer) and 9 (robots).

    Signals: `s` [n], `eps1` [n], `eps2` [n].
    """

    damping: PerJoint = parameter("diagonal of K_D", "N m s/rad or N s/m", ">= 0", "(K_D; Slotine and Li, 1991)")
    gain: PerJoint = parameter("K, size of the robust torque", "N m or N", ">= 0", "(K; Slotine and Li, 1991)")
    layer: PerJoint = parameter(
        "φ, half-width of the boundary layer", "rad/s or m/s", ">= 0", "(the boundary layer φ; 0 gives the sign)"
    )

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        now = sliding_variable(self.transformation, self.surface, t, state, reference_now, memory)
        q, dq, s = state.q, state.dq, now.s

        def bias(dq: Vector) -> Vector:
            return self.nominal.bias(q, dq)

        # C q̇ is quadratic in q̇, so half its derivative along s is C s in Christoffel form: no matrix is needed.
        whole, along_s = jax.jvp(bias, (dq,), (s,))
        model = matvec(self.nominal.mass(q), now.equivalent) + whole - 0.5 * along_s
        tau = model - self.damping * s - self.gain * saturation(s, self.layer)
        return Command(tau=tau, memory=memory, signals=now.signals)

    def implicit_step(self, recovery: Recovery | None, slopes: bool) -> AbstractStep:
        """Return the law as an implicit step, with `u = ‖K‖` and each joint's share of u."""
        gain = jnp.broadcast_to(self.gain, (self.joints,))
        size = vector_norm(gain)
        reaching = SaturatedReaching(self.damping, gain / jnp.where(size > 0, size, 1.0), self.layer)
        return SlidingStep(
            self.nominal, self.transformation, self.surface, recovery, reaching, FixedBound(size), slopes
        )
