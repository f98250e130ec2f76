"""PD feedback with gravity compensation."""

from __future__ import annotations

from slidax._types import Command, Reference
from slidax.parts import Memory, PerJoint, Scalar, State, parameter

from .model_based import AbstractModelBased

STABLE_POSTURE = "so that the posture is stable (Takegaki and Arimoto, 1981)"


class GravityCompensatedPD(AbstractModelBased):
    """`τ = -Kp e - Kd ė + G0(q)`: brings an arm to rest at a posture, and lags behind a motion.

    Only the gravity of the nominal robot is used.
    Source: Takegaki and Arimoto, 1981; Siciliano et al., Robotics: Modelling, Planning and Control, 2009, sec. 8.5.1.

    Signals: `e` [n], `de` [n].
    """

    kp: PerJoint = parameter("diagonal of Kp", "N m/rad or N/m", "> 0", STABLE_POSTURE, default=400.0)
    kd: PerJoint = parameter("diagonal of Kd", "N m s/rad or N s/m", "> 0", STABLE_POSTURE, default=100.0)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        e, de = state.q - reference_now.q, state.dq - reference_now.dq
        tau = self.nominal.gravity(state.q) - self.kp * e - self.kd * de
        return Command(tau=tau, memory=memory, signals={"e": e, "de": de})
