"""The control law of the paper, eqs. (40)-(45) and (51)."""

from __future__ import annotations

from slidax._types import Command, Reference
from slidax.numerics import matvec
from slidax.parts import Memory, Scalar, State, piece
from slidax.reaching import AbstractBound, AbstractReaching
from slidax.surfaces import sliding_variable

from .model_based import AbstractSurfaceBased
from .steps import AbstractStep, Recovery, SlidingStep


class SlidingMode(AbstractSurfaceBased):
    """`τ = τ0 + τ1 + τ2`, eq. (41), with `e = q - q_d` and the surface `s = B⁻¹ε2 + pull(ε1)`, eq. (40).

    `τ0 = M0 (q̈_d - Ȧ e - A ė) + C0 q̇ + G0`, eq. (42);
    `τ1 = -K0 Sig^r(s) - M0 slope(ε1) ε2`, eq. (43);
    `τ2 = -u s/(‖s‖ + s0)`, eqs. (44), (51), with u of (45).

    Signals: `s` [n], `eps1` [n], `eps2` [n], `u`.
    """

    reaching: AbstractReaching = piece("how s is driven to zero: K0, r and s0")
    bound: AbstractBound = piece("u, the size of the robust torque")

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        now = sliding_variable(self.transformation, self.surface, t, state, reference_now, memory)
        m0 = self.nominal.mass(state.q)
        tau0 = matvec(m0, now.feedforward) + self.nominal.bias(state.q, state.dq)
        tau1 = -self.reaching.continuous_term(now.s) - matvec(m0, now.descent)
        u = self.bound(state, tau0 + tau1)
        tau2 = -u * self.reaching.switching_direction(now.s)
        return Command(tau=tau0 + tau1 + tau2, memory=memory, signals={**now.signals, "u": u})

    def implicit_step(self, recovery: Recovery | None, slopes: bool) -> AbstractStep:
        return SlidingStep(self.nominal, self.transformation, self.surface, recovery, self.reaching, self.bound, slopes)
