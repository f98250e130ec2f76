"""Super-twisting: a continuous torque that rejects disturbances of bounded rate."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from slidax._types import Command, Envelope, Reference
from slidax.numerics import matvec, sig
from slidax.parts import Memory, PerJoint, Scalar, State, Vector, parameter
from slidax.surfaces import sliding_variable

from .model_based import AbstractSurfaceBased
from .steps import AbstractStep, Recovery, TwistingStep


class Integral(eqx.Module):
    """The memory of `SuperTwisting`.

    - `start`: memory of the transformation.
    - `v`: the integral of the sign [n], rad/s² or m/s².
    """

    start: Memory
    v: Vector


class SuperTwisting(AbstractSurfaceBased):
    """`τ = M0 (q̈_d - Ȧe - Aė - slope(ε1) ε2 - k1 sig^½(s) + v) + C0 q̇ + G0`, `v̇ = -k2 sgn(s)`, `v(0) = 0`.

    With the surface `s = ė + A e + pull(ε1)` of (40); on the linear one and without an envelope `s = ė + Λ e`. With the
    exact model `ṡ = -k1 sig^½(s) + v + d`, where d is the disturbance as an acceleration, and s reaches zero in finite
    time if `|ḋ| <= L`, for `k1 = 1.5 √L`, `k2 = 1.1 L`.

    Source: Levant, Sliding order and sliding accuracy in sliding mode control, 1993, with the gains of his 1998 paper
    on differentiation; stability by the quadratic function of Moreno and Osorio, 2012.

    Signals: `s` [n], `eps1` [n], `eps2` [n], `v` [n].
    """

    k1: PerJoint = parameter(
        "gain of the square root of s; `1.5 √L`", "rad^½/s^(3/2) or m^½/s^(3/2)", "> 0", "(Moreno and Osorio, 2012)"
    )
    k2: PerJoint = parameter(
        "gain of the integral of its sign; `1.1 L`", "rad/s³ or m/s³", "> 0", "(Moreno and Osorio, 2012)"
    )

    def init(self, t: Scalar, state: State, reference: Reference) -> Integral:
        e = state.q - reference.q
        return Integral(start=self.transformation.init(t, e), v=jnp.zeros_like(e))

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Integral
    ) -> Command:
        now = sliding_variable(self.transformation, self.surface, t, state, reference_now, memory.start)
        wanted = now.equivalent - self.k1 * sig(now.s, jnp.asarray(0.5)) + memory.v
        still = jax.tree.map(jnp.zeros_like, memory.start)
        return Command(
            tau=matvec(self.nominal.mass(state.q), wanted) + self.nominal.bias(state.q, state.dq),
            memory=memory,
            signals={**now.signals, "v": memory.v},
            rate=Integral(start=still, v=-self.k2 * jnp.sign(now.s)),
        )

    def envelope(self, t: Scalar, memory: Integral) -> Envelope | None:
        return self.transformation.envelope(t, memory.start)

    def implicit_step(self, recovery: Recovery | None, slopes: bool) -> AbstractStep:
        return TwistingStep(self.nominal, self.transformation, self.surface, recovery, self.k1, self.k2)
