"""A user's scheme that enters the benchmark."""

from __future__ import annotations

from slidax.core import PerJoint, matvec, parameter
from slidax.core.types import Command
from slidax.law import Preset
from slidax.law.controllers import AbstractModelBased


class Stiff(AbstractModelBased):
    """Computed torque without the velocity products."""

    kp: PerJoint = parameter("Kp", "1/s²", "> 0", default=400.0)
    kd: PerJoint = parameter("Kd", "1/s", "> 0", default=40.0)
    damping: PerJoint = parameter("D", "N m s/rad or N s/m", ">= 0", default=1.0)

    def __call__(self, t, state, reference_now, reference_next, memory):
        e, de = state.q - reference_now.q, state.dq - reference_now.dq
        wanted = reference_now.ddq - self.kp * e - self.kd * de
        tau = matvec(self.nominal.mass(state.q), wanted) + self.nominal.gravity(state.q) - self.damping * de
        return Command(tau=tau, memory=memory, signals={"e": e})


stiffer = Preset(Stiff, "The same, stiffer.", kp=900.0, kd=60.0, damping=2.0)

NOT_A_SCHEME = 3
