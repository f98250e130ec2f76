"""Computed torque with PD feedback."""

from __future__ import annotations

from slidax._types import Command, Reference
from slidax.numerics import matvec
from slidax.parts import Memory, PerJoint, Scalar, State, parameter

from .model_based import AbstractModelBased


class ComputedTorque(AbstractModelBased):
    """`τ = M0 (q̈_d - Kp e - Kd ė) + C0 q̇ + G0`: with the exact model each joint is an independent linear oscillator.

    Source: Siciliano et al., Robotics: Modelling, Planning and Control, 2009, section 8.5.2 (inverse dynamics control).

    Signals: `e` [n], `de` [n].
    """

    kp: PerJoint = parameter("diagonal of Kp", "1/s²", "> 0", "so that the error oscillator is stable", default=100.0)
    kd: PerJoint = parameter(
        "diagonal of Kd; `2 √kp` damps critically", "1/s", "> 0", "so that the error oscillator is stable", default=20.0
    )

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        e, de = state.q - reference_now.q, state.dq - reference_now.dq
        wanted = reference_now.ddq - self.kp * e - self.kd * de
        tau = matvec(self.nominal.mass(state.q), wanted) + self.nominal.bias(state.q, state.dq)
        return Command(tau=tau, memory=memory, signals={"e": e, "de": de})
