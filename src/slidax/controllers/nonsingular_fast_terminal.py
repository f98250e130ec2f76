"""Nonsingular fast terminal sliding mode control, [7] in the paper."""

from __future__ import annotations

from slidax._types import Command, Reference
from slidax.numerics import inverse_norm, matvec, sig, sig_and_slope, unit_vector
from slidax.parts import Memory, PerJoint, Scalar, State, parameter, piece
from slidax.reaching import AbstractBound

from .model_based import AbstractModelBased


class NonsingularFastTerminal(AbstractModelBased):
    """Nonsingular fast terminal sliding mode control (NFTSMC), [7].

    `s = e + sig^Γ1(e) + sig^Γ2(ė)`; `η = ‖M0⁻¹‖ (b0 + b1‖q‖ + b2‖q̇‖²)`;
    `τ = C0 q̇ + G0 + M0 (q̈_d - Γ2⁻¹ (I + Γ1 |e|^(Γ1-1)) sig^(2-Γ2)(ė) - M2 s - (η + M1) s/(‖s‖ + s0))`.
    Nonsingular since 1 < Γ2 < 2. The matrix norm is the spectral one.

    The paper prints its parameters, not its law; this law comes from public code with the same names and values. Its
    identity with [7] has medium to high confidence. Defaults are those of Table 2, which lists no boundary layer, hence
    the unit vector; the printed accuracy is about that of a run with `layer=3e-4`.

    Signals: `s` [n], `u`, the size `η + M1` of the robust acceleration.
    """

    bound: AbstractBound = piece("b0, b1, b2: `b0 + b1‖q‖ + b2‖q̇‖²`, in the law as it is printed")
    gamma1: PerJoint = parameter("diagonal of Γ1", "", "> gamma2", "([7])", default=2.0, source="Table 2")
    gamma2: PerJoint = parameter(
        "diagonal of Γ2", "", "(1, 2)", "so that τ is finite ([7])", default=5.0 / 3.0, source="Table 2"
    )
    reach: Scalar = parameter(
        "M1, what the robust acceleration is larger by",
        "rad/s² or m/s²",
        "> 0",
        "(M1, [7])",
        default=2.0,
        source="Table 2",
    )
    gain: PerJoint = parameter("diagonal of M2, gain of s", "1/s²", "> 0", "(M2, [7])", default=2.0, source="Table 2")
    layer: Scalar = parameter(
        "s0, width of the boundary layer", "rad or m", ">= 0", "(s0; 0 gives the unit vector)", default=0.0
    )

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        q, dq = state.q, state.dq
        e, de = q - reference_now.q, dq - reference_now.dq
        far, slope = sig_and_slope(e, self.gamma1)
        s = e + far + sig(de, self.gamma2)
        m0 = self.nominal.mass(q)
        bias = self.nominal.bias(q, dq)
        smooth = reference_now.ddq - (1.0 + slope) * sig(de, 2.0 - self.gamma2) / self.gamma2 - self.gain * s
        u = inverse_norm(m0) * self.bound(state, matvec(m0, smooth) + bias) + self.reach
        tau = matvec(m0, smooth - u * unit_vector(s, self.layer)) + bias
        return Command(tau=tau, memory=memory, signals={"s": s, "u": u})
