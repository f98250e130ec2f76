"""Sliding-mode controllers in printed form: the paper's law, Slotine and Li's, super-twisting, and terminal modes.

The paper is Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w; numbers such as [7] are its references, and
tables are its tables. `sig^a(x) = |x|^a sgn(x)`, and `Sig^a` for each entry of a vector. M0, C0 and G0 are the nominal
arm's inertia matrix, Coriolis matrix and gravity torque.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from slidax.core.linear_algebra import inverse_norm, matvec
from slidax.core.parameter import parameter, piece
from slidax.core.powers import power, saturation, sig, sig_and_slope, unit_vector, vector_norm
from slidax.core.types import Command, Envelope, Memory, PerJoint, Reference, Scalar, State, Vector

from .controllers import AbstractModelBased, AbstractSurfaceBased
from .implicit_steps import SlidingStep, TwistingStep
from .reaching_laws import AbstractReaching, SaturatedReaching
from .steps import AbstractStep, Recovery
from .surfaces import sliding_variable
from .torque_bounds import AbstractBound, FixedBound


class SlidingMode(AbstractSurfaceBased):
    """The paper's law `τ = τ0 + τ1 + τ2`, eq. (41), with `e = q - q_d` and the surface `s = B⁻¹ε2 + φ(ε1)`, eq. (40).

    `τ0 = M0 (q̈_d - Ȧ e - A ė) + C0 q̇ + G0`, eq. (42);
    `τ1 = -K0 Sig^r(s) - M0 φ'(ε1) ε2`, eq. (43), with `Sig^r(s) = |s|^r sgn(s)`;
    `τ2 = -u s/(‖s‖ + s0)`, eqs. (44), (51), with u of (45). A and B are those of `TransformedError`.

    Signals: `s` [n], `eps1` [n], `eps2` [n], `u`.
    """

    reaching: AbstractReaching = piece("reaching law, which drives s to zero: K0, r and s0")
    bound: AbstractBound = piece("u, the size of the robust torque")

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        now = sliding_variable(self.transformation, self.surface, t, state, reference_now, memory)
        m0 = self.nominal.mass(state.q)
        tau0 = matvec(m0, now.feedforward) + self.nominal.bias(state.q, state.dq)
        tau1 = -self.reaching.continuous_term(now.s) - matvec(m0, now.phi_rate)
        u = self.bound(state, tau0 + tau1)
        tau2 = -u * self.reaching.switching_direction(now.s)
        return Command(tau=tau0 + tau1 + tau2, memory=memory, signals={**now.signals, "u": u})

    def implicit_step(self, recovery: Recovery | None, slopes: bool) -> AbstractStep:
        return SlidingStep(self.nominal, self.transformation, self.surface, recovery, self.reaching, self.bound, slopes)


class SlotineLi(AbstractSurfaceBased):
    """`τ = M0 q̈_r + C0 q̇_r + G0 - K_D s - K sat(s/φ)` with the reference velocity `q̇_r = q̇ - s`.

    On the linear surface `s = ė + Λ e` it is the textbook law, `q̇_r = q̇_d - Λ e`, `q̈_r = q̈_d - Λ ė`. On any other
    surface, with any transformation, `s = ė + A e + φ(ε1)` as in the paper's eq. (40) and
    `q̈_r = q̈_d - Ȧ e - A ė - φ'(ε1) ε2`. C0 is in Christoffel form, for which `Ṁ0 - 2 C0` is skew-symmetric. In
    `sat(s/φ)` φ is the half-width of the boundary layer.

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
        full_bias, along_s = jax.jvp(bias, (dq,), (s,))
        model = matvec(self.nominal.mass(q), now.equivalent) + full_bias - 0.5 * along_s
        tau = model - self.damping * s - self.gain * saturation(s, self.layer)
        return Command(tau=tau, memory=memory, signals=now.signals)

    def implicit_step(self, recovery: Recovery | None, slopes: bool) -> AbstractStep:
        """Return the law as an implicit step; its robust torque is `u = ‖K‖`, and each joint's share of it K/u."""
        gain = jnp.broadcast_to(self.gain, (self.joints,))
        size = vector_norm(gain)
        reaching = SaturatedReaching(self.damping, gain / jnp.where(size > 0, size, 1.0), self.layer)
        return SlidingStep(
            self.nominal, self.transformation, self.surface, recovery, reaching, FixedBound(size), slopes
        )


class TwistingMemory(eqx.Module):
    """The memory of `SuperTwisting`.

    - `start`: memory of the error transformation.
    - `v`: the integral `-k2 ∫ sgn(s) dt` [n], rad/s² or m/s².
    """

    start: Memory
    v: Vector


class SuperTwisting(AbstractSurfaceBased):
    """`τ = M0 (q̈_d - Ȧe - Aė - φ'(ε1) ε2 - k1 sig^½(s) + v) + C0 q̇ + G0`, `v̇ = -k2 sgn(s)`, `v(0) = 0`.

    With the surface `s = ė + A e + φ(ε1)` of the paper's eq. (40); on the linear one and without an envelope
    `s = ė + Λ e`. With the exact model `ṡ = -k1 sig^½(s) + v + d`, where d is the disturbance as an acceleration, and s
    reaches zero in finite time if `|ḋ| <= L`, for `k1 = 1.5 √L`, `k2 = 1.1 L`. `sig^½(s) = √|s| sgn(s)`.

    Source: Levant, Sliding order and sliding accuracy in sliding mode control, 1993, with the gains of his 1998 paper
    on differentiation; stability by the quadratic function of Moreno and Osorio, 2012.

    Signals: `s` [n], `eps1` [n], `eps2` [n], `v` [n].
    """

    k1: PerJoint = parameter(
        "gain of the square root of s; `1.5 √L`", "rad^½/s^(3/2) or m^½/s^(3/2)", "> 0", "(Moreno and Osorio, 2012)"
    )
    k2: PerJoint = parameter(
        "gain of the integral of the sign of s; `1.1 L`", "rad/s³ or m/s³", "> 0", "(Moreno and Osorio, 2012)"
    )

    def init(self, t: Scalar, state: State, reference: Reference) -> TwistingMemory:
        e = state.q - reference.q
        return TwistingMemory(start=self.transformation.init(t, e), v=jnp.zeros_like(e))

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: TwistingMemory
    ) -> Command:
        now = sliding_variable(self.transformation, self.surface, t, state, reference_now, memory.start)
        wanted = now.equivalent - self.k1 * sig(now.s, jnp.asarray(0.5)) + memory.v
        still = jax.tree.map(jnp.zeros_like, memory.start)
        return Command(
            tau=matvec(self.nominal.mass(state.q), wanted) + self.nominal.bias(state.q, state.dq),
            memory=memory,
            signals={**now.signals, "v": memory.v},
            rate=TwistingMemory(start=still, v=-self.k2 * jnp.sign(now.s)),
        )

    def envelope(self, t: Scalar, memory: TwistingMemory) -> Envelope | None:
        return self.transformation.envelope(t, memory.start)

    def implicit_step(self, recovery: Recovery | None, slopes: bool) -> AbstractStep:
        return TwistingStep(self.nominal, self.transformation, self.surface, recovery, self.k1, self.k2)


class NonsingularFastTerminal(AbstractModelBased):
    """Nonsingular fast terminal sliding mode control (NFTSMC), the paper's reference [7].

    `s = e + sig^Γ1(e) + sig^Γ2(ė)`; `η = ‖M0⁻¹‖ (b0 + b1‖q‖ + b2‖q̇‖²)`;
    `τ = C0 q̇ + G0 + M0 (q̈_d - Γ2⁻¹ (I + Γ1 |e|^(Γ1-1)) sig^(2-Γ2)(ė) - M2 s - (η + M1) s/(‖s‖ + s0))`.
    Nonsingular since 1 < Γ2 < 2. The matrix norm is the spectral one. `sig^a(x) = |x|^a sgn(x)`.

    The paper prints its parameters, not its law; this law comes from public code with the same names and values. It is
    the law of [7] with medium to high confidence. Defaults are those of Table 2, which lists no boundary layer, hence
    the unit vector; the printed accuracy is about that of a run with `layer=3e-4`.

    Signals: `s` [n], `u`, the size `η + M1` of the robust acceleration.
    """

    bound: AbstractBound = piece("bound of the uncertainty; as printed `b0 + b1‖q‖ + b2‖q̇‖²`")
    gamma1: PerJoint = parameter("diagonal of Γ1", "", "> gamma2", "([7])", default=2.0, source="Table 2")
    gamma2: PerJoint = parameter(
        "diagonal of Γ2", "", "(1, 2)", "so that τ is finite ([7])", default=5.0 / 3.0, source="Table 2"
    )
    reach: Scalar = parameter(
        "M1, addition to the robust acceleration",
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


Adapted = Float[Array, "3"]
"""b̂0, b̂1, b̂2: adapted bound of the uncertainty; rad/s², 1/s², 1/rad."""


class AdaptiveNonsingularFastTerminal(AbstractModelBased):
    """Adaptive nonsingular fast terminal sliding mode control (ANFTSMC), the paper's reference [10].

    `s = e + k1 sig^α(e) + k2 sig^β(ė)`;
    `τ = C0 q̇ + G0 + M0 (q̈_d - (1 + k1 α |e|^(α-1)) sig^(2-β)(ė)/(k2 β) - k s - (b̂0 + b̂1‖q‖ + b̂2‖q̇‖² + η) sat(s/φ))`;
    `b̂0' = λ0 W`, `b̂1' = λ1 W ‖q‖`, `b̂2' = λ2 W ‖q̇‖²`, `W = Σ_i |s_i| |ė_i|^(β-1)`. `sig^a(x) = |x|^a sgn(x)`.

    The paper prints its parameters, not its law; this structure comes from a re-implementation of a follow-up paper.
    It is uncertain that k = 250 belongs to s: with it joint 3 of Example 4.2 starts at 215 N, where the paper prints
    39.44 N. Defaults are those of Table 2 except α: the printed 0.2 is singular at e = 0 and does not converge, so it
    is refused here. The follow-up's α = 2 gives settling times within 0.05 s of the printed ones. Table 2 lists no
    boundary layer, hence the sign.

    Signals: `s` [n], `u`, the size of the robust acceleration, `b` [3], the adapted gains.
    """

    k1: PerJoint = parameter("diagonal of the gain of e's power", "", "> 0", "([10])", default=1.0, source="Table 2")
    k2: PerJoint = parameter("diagonal of the gain of ė's power", "", "> 0", "([10])", default=1.0, source="Table 2")
    alpha: PerJoint = parameter(
        "α, exponent of the error",
        "",
        "> beta",
        "([10]; the 0.2 of Table 2 is singular at e = 0)",
        default=2.0,
        source="a follow-up of [10]",
    )
    beta: PerJoint = parameter(
        "β, exponent of the velocity error",
        "",
        "(1, 2)",
        "so that τ is finite ([10])",
        default=5.0 / 3.0,
        source="Table 2",
    )
    gain: PerJoint = parameter("diagonal of k, gain of s", "1/s²", "> 0", "(k, [10])", default=250.0, source="Table 2")
    margin: Scalar = parameter(
        "η, addition to the robust acceleration",
        "rad/s² or m/s²",
        "> 0",
        "(η, [10])",
        default=0.5,
        source="Table 2",
    )
    adaptation: Float[Array, "3"] = parameter(
        "λ0, λ1, λ2: adaptation rates of b̂0, b̂1, b̂2",
        "",
        ">= 0",
        "(λ0, λ1, λ2, [10])",
        default=(0.01, 0.01, 0.01),
        source="Table 2",
    )
    initial: Float[Array, "3"] = parameter(
        "b̂0, b̂1, b̂2 at the start",
        "",
        ">= 0",
        "(b̂0, b̂1, b̂2 at the start, [10])",
        default=(0.0, 0.0, 0.0),
        source="Table 2",
    )
    layer: PerJoint = parameter(
        "φ, half-width of the boundary layer per joint",
        "rad or m",
        ">= 0",
        "(the boundary layer φ; 0 gives the sign)",
        default=0.0,
    )

    def init(self, t: Scalar, state: State, reference: Reference) -> Adapted:
        return self.initial

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Adapted
    ) -> Command:
        q, dq = state.q, state.dq
        e, de = q - reference_now.q, dq - reference_now.dq
        far, slope = sig_and_slope(e, self.alpha)
        s = e + self.k1 * far + self.k2 * sig(de, self.beta)
        sizes = jnp.stack([jnp.ones(()), vector_norm(q), jnp.sum(dq * dq)])
        u = jnp.sum(memory * sizes) + self.margin
        wanted = (
            reference_now.ddq
            - (1.0 + self.k1 * slope) * sig(de, 2.0 - self.beta) / (self.k2 * self.beta)
            - self.gain * s
            - u * saturation(s, self.layer)
        )
        drive = jnp.sum(jnp.abs(s) * power(jnp.abs(de), self.beta - 1.0))
        return Command(
            tau=matvec(self.nominal.mass(q), wanted) + self.nominal.bias(q, dq),
            memory=memory,
            signals={"s": s, "u": u, "b": memory},
            rate=self.adaptation * drive * sizes,
        )
