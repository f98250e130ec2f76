"""Verdicts on the paper's statements, and the values in the report's sentences.

Some printed values are nearer to runs without the disturbance that the text states. So there are two readings of the
disturbance (`READINGS`): as stated, or off. Each boundary layer is also compared with an alternative (`Scheme.other`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax import analysis
from slidax.analysis import index_sums
from slidax.report.page import significant
from slidax.simulation.run import Run

from .examples import COMPARED, EXAMPLES, PROPOSED, READINGS, SCHEMES, Case, Runs
from .numbers import (
    chatter,
    energy_share,
    expected_error,
    inverse_inertia,
    printed_steady_error,
    settling_bound,
    table_3,
    torque_step_ratio,
    worst_after_deadline,
)
from .printed import REPRODUCED, STEADY_LIMIT, TABLE_3, PrintedComparison, claim, mark_unchecked

CONTINUOUS = "the torque is continuous and free of chattering"


@dataclass(frozen=True)
class Claim:
    """A statement in the paper.

    - `place`, `says`: place of the statement in the paper, and its content.
    - `evidence`: computed values in words, by reading of the disturbance or by matrix norm that the paper may mean; the
      key is empty if there is only one.
    - `verdicts`: verdicts by the same keys.
    """

    place: str
    says: str
    evidence: dict[str, str]
    verdicts: dict[str, PrintedComparison]


def claims(runs: Runs) -> list[Claim]:
    """Check the paper's claims about the curves of both examples, and return each with its verdicts.

    The errors stay in the envelope and settle in time, and the torque is continuous.
    """
    return [make(runs, example) for make in (_inside, _settled, _continuous) for example in EXAMPLES]


def parameter_claims(runs: Runs) -> list[Claim]:
    """Check the paper's claims that do not depend on the disturbance, and return each with its verdicts.

    These are the bounds of ‖M⁻¹‖, and T_i ≥ T_max. T_i is the deadline of a joint's envelope, T_max the bound of the
    settling time.

    - `runs`: all runs; only their scenarios are used.
    """
    result = []
    for example, table in zip(EXAMPLES, ("Table 1", "Table 2"), strict=True):
        inertia = inverse_inertia(runs.scenarios[Case(example, runs.readings[0])])
        m1, m2 = inertia["m1"], inertia["m2"]
        norms = {"spectral norm": inertia["spectral"], "Frobenius norm": inertia["frobenius"]}
        result.append(
            Claim(
                f"(47), {table}",
                f"m1 ≤ ‖M⁻¹(q)‖ ≤ m2 with m1 = {m1:g}, m2 = {m2:g}",
                {norm: f"{_range(values)} over all q" for norm, values in norms.items()},
                {norm: claim(m1 <= values[0] and values[1] <= m2) for norm, values in norms.items()},
            )
        )
    for example in EXAMPLES:
        bound = settling_bound(runs.scenarios[Case(example, runs.readings[0])])
        if bound is None or bound["deadlines"] is None:
            continue
        deadlines = [f"{deadline:g}" for deadline in bound["deadlines"]]
        result.append(
            Claim(
                f"(48)–(50), Section\u00a05, Example\u00a0{example}",
                "T_i ≥ T_max, the condition for calling T_i a predefined time",
                {"": f"T_max = {significant(bound['bound'], 3)} s, T = {', '.join(deadlines)} s"},
                {"": claim(min(bound["deadlines"]) >= bound["bound"])},
            )
        )
    return result


def _inside(runs: Runs, example: str) -> Claim:
    figure = {"4.1": "Fig. 3", "4.2": "Fig. 7(a)"}[example]
    evidence: dict[str, str] = {}
    verdicts: dict[str, PrintedComparison] = {}
    for reading in runs.readings:
        run = runs[Case(example, reading)]
        outside, margin = analysis.envelope_violations(run), analysis.envelope_margin(run)
        margin = np.zeros(1) if margin is None else margin
        evidence[reading] = (
            f"{outside} samples outside; least margin: {significant(100 * float(margin.min()), 3)} % of the width"
        )
        verdicts[reading] = claim(run.outcome.ok and outside == 0)
    return Claim(f"{figure}, Example\u00a0{example}", "the errors stay inside the envelope", evidence, verdicts)


def _settled(runs: Runs, example: str) -> Claim:
    evidence: dict[str, str] = {}
    verdicts: dict[str, PrintedComparison] = {}
    for reading in runs.readings:
        case = Case(example, reading)
        worst = worst_after_deadline(runs.scenarios[case], runs[case])
        if worst is None:
            evidence[reading], verdicts[reading] = "–", mark_unchecked("the run ends before T")
            continue
        times = ", ".join(significant(time, 3) for time in analysis.settling_time(runs[case], 1e-3))
        evidence[reading] = (
            f"|e| after T_i at most {significant(max(worst), 2)} of the final radius; last time above 1e-3: {times} s"
        )
        verdicts[reading] = claim(max(worst) < 1.0)
    says = "from T_i on the error is inside the final radius of the envelope"
    return Claim(f"Theorem\u00a01\u00a0(2), Example\u00a0{example}", says, evidence, verdicts)


def _continuous(runs: Runs, example: str) -> Claim:
    figure = {"4.1": "Fig. 4", "4.2": "Fig. 10"}[example]
    evidence: dict[str, str] = {}
    verdicts: dict[str, PrintedComparison] = {}
    for reading in runs.readings:
        case = Case(example, reading)
        steps, totals = torque_step_ratio(runs[case], runs[case.halved])
        largest = analysis.max_torque_step(runs[case])
        unit = runs.scenarios[case].plant.robot.torque_units[int(np.argmax(largest))]
        evidence[reading] = (
            f"largest step between samples {significant(float(largest.max()), 2)} {unit}, at half the period at most "
            f"{significant(max(steps), 3)} times as large; AICE then within "
            f"{significant(100 * max(abs(total - 1) for total in totals), 2)} %"
        )
        smooth = runs[case].outcome.ok and max(steps) < 0.6 and all(abs(total - 1) <= REPRODUCED for total in totals)
        verdicts[reading] = claim(smooth)
    return Claim(f"{figure}, Example\u00a0{example}", CONTINUOUS, evidence, verdicts)


def _range(values: list[float]) -> str:
    low, high = (significant(value, 3) for value in values)
    return low if low == high else f"{low} to {high}"


PRINTED_ALPHA = 0.2
"""α of ANFTSMC in Table 2."""

QUANTITIES = ("settling_time", "steady_error", "peak_torque")


def compare_schemes(runs: Runs) -> list[dict[str, Any]]:
    """Return the metrics of every scheme in both examples, an item for each reading and each boundary layer.

    In an item `listed` is True for the boundary layer of the paper's table, and False for the alternative one.
    """
    return [
        {
            "example": example,
            "reading": reading,
            "scheme": case.name,
            "listed": case.layer is None,
            "settling_time": table_3(runs[case], "settling_time", 1e-3),
            "steady_error": _listed(analysis.steady_error(runs[case])),
            "peak_torque": analysis.peak_torque(runs[case]).tolist(),
            **{name: getattr(index_sums, name)(runs[case]).tolist() for name in ("iae", "eci", "aice")},
            "chatters": any(chatter(runs[case], runs[case.halved])) if case.layer is None else None,
        }
        for example in EXAMPLES
        for reading in runs.readings
        for scheme in COMPARED[example]
        for case in (Case(example, reading, scheme=scheme), Case(example, reading, scheme=scheme).relayered)
    ]


def bands(runs: Runs) -> list[dict[str, Any]]:
    """Compare the settling times of Table 3 with those for every settling band, reading and boundary layer.

    The paper does not print its settling band. Return an item for each scheme of Table 3, with

    - `printed`, `lines`: the printed times, and the times for each band, reading and layer;
    - `nearest`: the line nearest to the printed times, among bands wider than the printed steady error;
    - `nearest_any`: the line nearest to the printed times, among all bands.
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
        # A band below the printed steady error is impossible.
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
    """Return the quantities of Table 3, computed in four ways, an item for each scheme and quantity.

    The keys of an item's `values` are `step` for the paper's integration step, `half` for half the step, `held` for a
    torque that is held between samples, and `layer` for the alternative boundary layer.
    """
    lines = []
    for example in EXAMPLES:
        for scheme in COMPARED[example]:
            case, band = runs.nearest(example, scheme), SCHEMES[scheme].band if example == "4.2" else 1e-3
            variants = {"step": case, "half": case.halved, "held": case.held, "layer": case.relayered}
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
                        "values": {name: table_3(runs[item], quantity, band) for name, item in variants.items()},
                    }
                )
    return lines


def settling_bounds(runs: Runs) -> list[dict[str, Any]]:
    """Return the settling-time bound (48)-(50) of each fixed-time scheme, with its deadlines.

    `observed` has the computed settling times to |e| <= 0.01.
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
    """Return the torque jumps of FTSMC with a boundary layer when a joint's |e| falls below δ of eq. (78).

    The slope of (78) is discontinuous there. Each item has the joint, the time, and the largest and the usual step of
    the torque. The result is None if |e| of a joint is above δ at the end, or the run has no log.
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
    """Return AICE, eq. (82), and the steady error of a scheme in Example 4.1, for two boundary layers.

    `listed` has the values for the boundary layer of the paper's table, and `other` those for the alternative one,
    whose half width is `layer`.

    - `scheme`: key of the scheme.
    """
    case = Case("4.1", runs.readings[0], scheme=scheme)
    variants = {
        name: {"aice": index_sums.aice(runs[item]).tolist(), "steady_error": _listed(analysis.steady_error(runs[item]))}
        for name, item in (("listed", case), ("other", case.relayered))
    }
    return {"layer": SCHEMES[scheme].other, **variants}


def run_with_printed_alpha(runs: Runs) -> dict[str, Any]:
    """Run the scheme ANFTSMC with its parameter α of Table 2, and return the outcome and the quantities of Table 3.

    The class of ANFTSMC refuses this α; the check is bypassed. `used` is the α of all other runs. Here
    `steady_error` is the largest error over the last quarter, and `settling_time` is for a band of 1e-3.
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
        "steady_error": _listed(analysis.steady_error(run)),
        "peak_torque": analysis.peak_torque(run).tolist(),
        "error_before": _last_error(run),
    }


def energy(runs: Runs) -> dict[str, Any]:
    """Return CFTSMPPC's control effort, ECI (81), in percent of NFTSMC's, by reading of the disturbance.

    `listed` is for NFTSMC with the boundary layer of the paper's table, `layer` for the alternative one.
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


BAND = SCHEMES[PROPOSED].band


def findings(runs: Runs) -> dict[str, Any]:
    """Return all values in the sentences of the report, ready for JSON."""
    accuracy = {
        reading: printed_steady_error(runs[Case("4.2", reading)]) if reading in runs.readings else None
        for reading in READINGS
    }
    printed = {item.quantity: list(item.values) for item in TABLE_3[PROPOSED]}
    first = runs.readings[0]
    return {
        "printed": printed | {"steady_limit": float(STEADY_LIMIT)},
        "accuracy": accuracy,
        "expected": _expected(runs),
        "truncation": _truncation(runs),
        "settling": {
            reading: analysis.summary(runs[Case("4.2", reading)])["settling_time"] for reading in runs.readings
        },
        "peaks": {reading: table_3(runs[Case("4.2", reading)], "peak_torque", BAND) for reading in runs.readings},
        "sampling": [_sampled(runs, case) for case in runs.sampled],
        "inertia": {example: inverse_inertia(runs.scenarios[Case(example, first)]) for example in EXAMPLES},
        "bounds": {example: settling_bound(runs.scenarios[Case(example, first)]) for example in EXAMPLES},
        "compared": compare_schemes(runs),
        "bands": bands(runs),
        "sensitivity": sensitivity(runs),
        "settling_bounds": settling_bounds(runs),
        "jumps": jumps(runs),
        "alpha": run_with_printed_alpha(runs),
        "energy": energy(runs),
        "ftsmc": layers(runs, "ftsmc"),
        "nftsmc_layer": SCHEMES["nftsmc"].other,
        "rows": {
            reading: {case.name: printed_steady_error(runs[case]) for case in runs.compared("4.2", reading).values()}
            for reading in runs.readings
        },
        "last_above_1e-3": max(
            float(analysis.settling_time(runs[Case(example, first)], 1e-3).max()) for example in EXAMPLES
        ),
    }


def _expected(runs: Runs) -> list[float] | None:
    if "stated" not in runs.readings:
        return None
    case = Case("4.2", "stated")
    return expected_error(runs.scenarios[case], runs[case])


def _truncation(runs: Runs) -> dict[str, list[float]] | None:
    """Return the steady error without disturbance at the paper's step and at half the step, and the ratio of both."""
    if "off" not in runs.readings:
        return None
    case = Case("4.2", "off")
    full, half = printed_steady_error(runs[case]), printed_steady_error(runs[case.halved])
    if full is None or half is None:
        return None
    return {"step": full, "half": half, "factor": (np.asarray(full) / np.asarray(half)).tolist()}


def _sampled(runs: Runs, case: Case) -> dict[str, Any]:
    """Return the outcome of a run at a longer period or with a held torque, and its AICE over that of the example."""
    run = runs[case]
    reference = runs[Case(case.example, case.reading)]
    return {
        "example": case.example,
        "mode": case.mode,
        "period": case.period,
        "outcome": run.outcome.kind,
        "message": run.outcome.message,
        "t": run.outcome.t,
        "aice": index_sums.aice(run).tolist(),
        "aice_ratio": _ratio(run, reference),
    }


def _ratio(run: Run, reference: Run) -> list[float] | None:
    return (index_sums.aice(run) / index_sums.aice(reference)).tolist() if run.outcome.ok else None
