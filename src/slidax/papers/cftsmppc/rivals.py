"""The numbers behind the report's sentences on the schemes that the paper compares with."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax import metrics
from slidax.simulation import Run

from .. import indices
from .bounds import settling_bound
from .measured import chatter, table_3
from .numbers import energy_share
from .printed import TABLE_3
from .runs import EXAMPLES, Case, Runs
from .schemes import COMPARED, SCHEMES

PRINTED_ALPHA = 0.2
"""ANFTSMC's α in Table 2."""

QUANTITIES = ("settling_time", "steady_error", "peak_torque")


def compared(runs: Runs) -> list[dict[str, Any]]:
    """Every scheme's metrics, with the boundary layer as listed and with the other one.

    - `runs`: all runs.
    """
    return [
        {
            "example": example,
            "reading": reading,
            "scheme": case.name,
            "listed": case.layer is None,
            "settling_time": table_3(runs[case], "settling_time", 1e-3),
            "steady_error": _listed(metrics.steady_error(runs[case])),
            "peak_torque": metrics.peak_torque(runs[case]).tolist(),
            **{name: getattr(indices, name)(runs[case]).tolist() for name in ("iae", "eci", "aice")},
            "chatters": any(chatter(runs[case], runs[case.halved])) if case.layer is None else None,
        }
        for example in EXAMPLES
        for reading in runs.readings
        for scheme in COMPARED[example]
        for case in (Case(example, reading, scheme=scheme), Case(example, reading, scheme=scheme).relayered)
    ]


def bands(runs: Runs) -> list[dict[str, Any]]:
    """For each row of Table 3, the settling times at every band in every reading, and which of them come nearest.

    - `runs`: all runs.
    """
    result = []
    for scheme, items in TABLE_3.items():
        printed = items[0].values
        lines: list[dict[str, Any]] = []
        for reading in runs.readings:
            case = Case("4.2", reading, scheme=scheme)
            for item in (case, case.relayered):
                for band in np.asarray(runs[item].windows.bands):
                    times = table_3(runs[item], "settling_time", float(band))
                    away = [
                        None if time is None else time / wish - 1 for time, wish in zip(times, printed, strict=True)
                    ]
                    worst = None if None in away else max(abs(part) for part in away if part is not None)
                    lines.append(
                        {
                            "reading": reading,
                            "scheme": item.name,
                            "layer": item.layer,
                            "band": float(band),
                            "times": times,
                            "worst": worst,
                        }
                    )
        # A run does not settle to a band that is narrower than the error it ends with.
        error = max(items[1].values)
        settled = [line for line in lines if line["worst"] is not None]
        possible = [line for line in settled if line["band"] > error]
        result.append(
            {
                "scheme": SCHEMES[scheme].name,
                "printed": list(printed),
                "band": SCHEMES[scheme].band,
                "printed_error": error,
                "lines": lines,
                "nearest": min(possible, key=_worst) if possible else None,
                "nearest_any": min(settled, key=_worst) if settled else None,
            }
        )
    return result


def sensitivity(runs: Runs) -> list[dict[str, Any]]:
    """Changes of each scheme's numbers at half the step, with a held torque, and with another boundary layer.

    - `runs`: all runs.
    """
    lines = []
    for example in EXAMPLES:
        for scheme in COMPARED[example]:
            case, band = runs.nearest(example, scheme), SCHEMES[scheme].band if example == "4.2" else 1e-3
            ways = {"step": case, "half": case.halved, "held": case.held, "layer": case.relayered}
            for quantity in QUANTITIES:
                lines.append(
                    {
                        "example": example,
                        "scheme": SCHEMES[scheme].name,
                        "reading": case.reading,
                        "listed_layer": SCHEMES[scheme].listed,
                        "other_layer": SCHEMES[scheme].other,
                        "quantity": quantity,
                        "band": band,
                        "values": {way: table_3(runs[item], quantity, band) for way, item in ways.items()},
                    }
                )
    return lines


def settling_bounds(runs: Runs) -> list[dict[str, Any]]:
    """(48)-(50) for every fixed-time scheme, beside its deadlines and the time that its run takes.

    - `runs`: all runs.
    """
    first = runs.readings[0]
    lines = []
    for example in EXAMPLES:
        for scheme in COMPARED[example]:
            case = Case(example, first, scheme=scheme)
            bound = settling_bound(runs.scenarios[case])
            if bound is not None:
                observed = table_3(runs[case], "settling_time", 1e-2)
                lines.append({"example": example, "scheme": case.name, **bound, "observed": observed})
    return lines


def jumps(runs: Runs) -> list[dict[str, Any]] | None:
    """When |e| of FTSMC with a boundary layer enters the core of (78), whose slope jumps, and how the torque jumps.

    - `runs`: all runs.

    None if a joint never enters it.
    """
    case = Case("4.1", runs.readings[0], scheme="ftsmc").relayered
    run, delta = runs[case], 1e-2
    times = table_3(run, "settling_time", delta)
    if run.log is None or None in times:
        return None
    t, tau = np.asarray(run.log.t), np.asarray(run.log.tau)
    steps = np.abs(np.diff(tau, axis=0))
    result = []
    for i, time in enumerate(times):
        near = np.abs(t[1:] - (time or 0.0)) < 3 * (t[1] - t[0])
        usual = float(np.median(steps[np.abs(t[1:] - (time or 0.0)) < 0.05, i]))
        result.append({"joint": i + 1, "t": time, "step": float(steps[near, i].max()), "usual": usual})
    return result


def layers(runs: Runs, scheme: str) -> dict[str, Any]:
    """A scheme of Example 4.1 with its boundary layer as listed and with the other one.

    - `runs`: all runs.
    - `scheme`: which.
    """
    case = Case("4.1", runs.readings[0], scheme=scheme)
    ways = {
        name: {"aice": indices.aice(runs[item]).tolist(), "steady_error": _listed(metrics.steady_error(runs[item]))}
        for name, item in (("listed", case), ("other", case.relayered))
    }
    return {"layer": SCHEMES[scheme].other, **ways}


def printed_alpha(runs: Runs) -> dict[str, Any]:
    """Run of ANFTSMC with the printed α, which the class refuses and which is set without its check.

    - `runs`: all runs.
    """
    case = runs.nearest("4.2", "anftsmc")
    scenario = runs.scenarios[case]
    changed = eqx.tree_at(lambda law: law.alpha, scenario.controller, jnp.asarray(PRINTED_ALPHA))
    run = replace(scenario, controller=changed).simulate(progress=False)
    return {
        "reading": case.reading,
        "alpha": PRINTED_ALPHA,
        "used": float(np.max(np.asarray(getattr(scenario.controller, "alpha", np.nan)))),
        "outcome": run.outcome.kind,
        "message": run.outcome.message,
        "t": run.outcome.t,
        "settling_time": table_3(run, "settling_time", 1e-3),
        "steady_error": _listed(metrics.steady_error(run)),
        "peak_torque": metrics.peak_torque(run).tolist(),
        "error_before": _last_error(run),
    }


def energy(runs: Runs) -> dict[str, Any]:
    """The share of energy by reading, NFTSMC as listed and with a boundary layer.

    - `runs`: all runs.
    """
    return {
        reading: {
            "listed": energy_share(runs, reading, False),
            "layer": energy_share(runs, reading, True),
        }
        for reading in runs.readings
    }


def _worst(line: dict[str, Any]) -> float:
    return float(line["worst"])


def _last_error(run: Run) -> list[float] | None:
    return None if run.log is None else np.abs(np.asarray(run.log.e)[-1]).tolist()


def _listed(values: np.ndarray | None) -> list[float] | None:
    return None if values is None else values.tolist()
