"""All metrics of a run, ready for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax.simulation import Run

from .effort import (
    aice,
    eci,
    initial_torque,
    max_torque_step,
    peak_torque,
    steady_torque_step,
    steady_torque_step_rms,
)
from .envelope import envelope_margin, envelope_violations
from .error import iae, settling_time, steady_error


def summary(run: Run) -> dict[str, Any]:
    """Every metric by name; lists have one entry per joint.

    - `run`: a finished run.
    """
    return {
        "settling_time": {_name(band): settling_time(run, band).tolist() for band in np.asarray(run.windows.bands)},
        "steady_error": _listed(steady_error(run)),
        "peak_torque": peak_torque(run).tolist(),
        "initial_torque": initial_torque(run).tolist(),
        "max_torque_step": max_torque_step(run).tolist(),
        "steady_torque_step": _listed(steady_torque_step(run)),
        "steady_torque_step_rms": _listed(steady_torque_step_rms(run)),
        "iae": iae(run).tolist(),
        "eci": eci(run).tolist(),
        "aice": aice(run).tolist(),
        "envelope_violations": envelope_violations(run),
        "envelope_margin": _listed(envelope_margin(run)),
    }


def _listed(values: np.ndarray | None) -> list[float] | None:
    return None if values is None else values.tolist()


def _name(band: float) -> str:
    """`1e-3` rather than `0.001`."""
    mantissa, exponent = f"{band:e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
