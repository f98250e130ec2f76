"""Assumptions of all certificates of printed laws in continuous time."""

from __future__ import annotations

import numpy as np

from slidax.actuators import TorqueLimits

from ..extent import starts_of
from ..verdict import Assumption, Status
from .law import PrintedLaw


def continuous_premises(printed: PrintedLaw, *, unit_vector: bool = True) -> tuple[Assumption, ...]:
    """Assumptions: continuous time, exact measurements, unlimited torque, a start inside, and (44) if needed.

    - `unit_vector`: True if the layer of (51) invalidates the certificate.
    """
    scenario, plant = printed.scenario, printed.scenario.plant
    own = getattr(plant, "own", plant)
    assumptions = []
    if unit_vector:
        layer = printed.layer
        held = layer == 0.0
        text = "the unit vector is that of (44)"
        if not held:
            text += "; the scheme has no such vector" if layer is None else f"; here its layer is s0 = {layer:.3g} (51)"
        assumptions.append(Assumption(text, "proved" if held else "fails", layer))
    if printed.held:
        text = f"the torque follows the state at once; here it is held for {1e3 * scenario.period:.3g} ms"
        assumptions.append(Assumption(text, "fails", scenario.period))
    else:
        assumptions.append(Assumption("the torque follows the state at once: simulation.mode is continuous", "proved"))
    if own.sensor is not None:
        assumptions.append(
            Assumption("positions and velocities are measured exactly; the scenario has a sensor", "fails")
        )
    limits: TorqueLimits | None = None if own.actuator is None else getattr(own.actuator, "limits", None)
    if limits is None or bool(np.isinf(np.asarray(limits.torque)).all()):
        assumptions.append(Assumption("the drives deliver any torque: no limit is given", "assumed"))
    else:
        assumptions.append(Assumption("the torque stays within the drives' limits, see `torque_budget`", "assumed"))
    if printed.performance is not None:
        starts = starts_of(scenario)
        reference = np.asarray(scenario.state0.q) - printed.start[0]
        error = np.maximum(np.abs(starts.lower - reference), np.abs(starts.upper - reference))
        share = np.max(error / printed.radius(np.zeros(1))[0])
        status: Status = "proved" if share < 1.0 else "fails"
        assumptions.append(Assumption(f"{starts.all_are} inside the envelope, |e(0)| < ρ0", status, float(share)))
    return tuple(assumptions)
