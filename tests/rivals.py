"""The schemes that the paper compares with, and textbook schemes, built by hand from the spec's tables."""

from __future__ import annotations

from typing import Any

from slidax.law import (
    AbstractSurface,
    AbstractTransformation,
    AdaptiveNonsingularFastTerminal,
    ComputedTorque,
    GravityCompensatedPD,
    JointPID,
    Linear,
    NonsingularFastTerminal,
    PrescribedPerformance,
    SlidingMode,
    SlotineLi,
    StateBound,
    SuperTwisting,
    UncertaintyBound,
    Unconstrained,
    ftsmc,
    ftsmppc,
    sfsmc,
)
from tests.paper_examples import ENVELOPE_4_1, ENVELOPE_4_2, SCARA, TWO_LINK_NOMINAL

BOUND_4_1 = UncertaintyBound(inverse_inertia_min=0.09, inverse_inertia_max=0.2, b0=12.0, b1=2.2, b2=2.8, margin=1.0)
WITHOUT_B1 = UncertaintyBound(inverse_inertia_min=0.09, inverse_inertia_max=0.2, b0=12.0, b1=0.0, b2=2.8, margin=1.0)
TABLE_2_SFSMC = UncertaintyBound(inverse_inertia_min=0.9, inverse_inertia_max=1.1, b0=12.0, b1=0.0, b2=2.2, margin=1.0)
AROUND_4_1 = PrescribedPerformance(ENVELOPE_4_1, 0.2)
AROUND_4_2 = PrescribedPerformance(ENVELOPE_4_2, 0.2)


def ftsmc_4_1(**changes: Any) -> SlidingMode:
    """FTSMC with Table 1; `changes` go to `ftsmc`."""
    return ftsmc(TWO_LINK_NOMINAL, **({"bound": WITHOUT_B1} | changes))


def ftsmppc_4_1(**changes: Any) -> SlidingMode:
    """FTSMPPC with Table 1; `changes` go to `ftsmppc`."""
    parts: dict[str, Any] = {"performance": ENVELOPE_4_1, "overshoot": 0.2, "bound": BOUND_4_1}
    return ftsmppc(TWO_LINK_NOMINAL, **(parts | changes))


def sfsmc_4_2(**changes: Any) -> SlidingMode:
    """SFSMC with Table 2; `changes` go to `sfsmc`."""
    return sfsmc(SCARA, **({"bound": TABLE_2_SFSMC} | changes))


def nftsmc_4_2(**changes: Any) -> NonsingularFastTerminal:
    """NFTSMC with Table 2; `changes` go to its class."""
    return NonsingularFastTerminal(SCARA, **({"bound": StateBound(12.0, 2.2, 2.8)} | changes))


def anftsmc_4_2(**changes: Any) -> AdaptiveNonsingularFastTerminal:
    """ANFTSMC with Table 2 except its α; `changes` go to its class."""
    return AdaptiveNonsingularFastTerminal(SCARA, **changes)


def computed_torque_4_1(**changes: Any) -> ComputedTorque:
    """Computed torque on the two-link arm; `changes` go to its class."""
    return ComputedTorque(TWO_LINK_NOMINAL, **changes)


def gravity_pd_4_1(**changes: Any) -> GravityCompensatedPD:
    """PD with gravity compensation on the two-link arm; `changes` go to its class."""
    return GravityCompensatedPD(TWO_LINK_NOMINAL, **changes)


def pid_4_1(**changes: Any) -> JointPID:
    """A PID at each joint of the two-link arm; `changes` go to its class."""
    return JointPID(TWO_LINK_NOMINAL, **changes)


def slotine_li_4_1(
    transformation: AbstractTransformation | None = None, surface: AbstractSurface | None = None, **changes: Any
) -> SlotineLi:
    """Slotine-Li on the two-link arm; `changes` go to its class."""
    parts: dict[str, Any] = {"damping": [20.0, 10.0], "gain": [20.0, 15.0], "layer": 0.05}
    return SlotineLi(TWO_LINK_NOMINAL, transformation or Unconstrained(), surface or Linear(5.0), **(parts | changes))


def super_twisting_4_2(
    transformation: AbstractTransformation | None = None, surface: AbstractSurface | None = None, **changes: Any
) -> SuperTwisting:
    """Super-twisting on the SCARA arm; `changes` go to its class."""
    parts: dict[str, Any] = {"k1": [10.0, 12.0, 11.0], "k2": 70.0}
    return SuperTwisting(SCARA, transformation or Unconstrained(), surface or Linear(5.0), **(parts | changes))


USERS_LAW = """
from slidax.core import Command, PerJoint, matvec, parameter
from slidax.law import AbstractModelBased


class Mine(AbstractModelBased):
    kp: PerJoint = parameter("kp", "1/s²", "> 0", default=400.0)
    inertia: PerJoint = parameter("added inertia", "kg m²", "> 0", default=0.1)

    def __call__(self, t, state, now, following, memory):
        wanted = now.ddq - self.kp * (state.q - now.q) - 40.0 * (state.dq - now.dq)
        tau = matvec(self.nominal.mass(state.q), wanted) + self.inertia * wanted
        return Command(tau=tau + self.nominal.bias(state.q, state.dq), memory=memory, signals={})
"""
"""A law in a file of a user's own."""
