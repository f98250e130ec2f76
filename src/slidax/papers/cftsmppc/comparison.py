"""The paper's statements, each with evidence from the runs and a verdict."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax import metrics
from slidax.reports import significant

from .bounds import inverse_inertia, settling_bound
from .measured import step_ratio, worst_after_deadline
from .runs import EXAMPLES, Case, Runs
from .verdicts import REPRODUCED, Verdict, claim, unchecked

CONTINUOUS = "the torque is continuous and free of chattering"


@dataclass(frozen=True)
class Claim:
    """A printed statement.

    - `place`, `says`: where it is printed, and what it says.
    - `evidence`, `verdicts`: by reading of the disturbance, or by another choice that the paper leaves open.
    """

    place: str
    says: str
    evidence: dict[str, str]
    verdicts: dict[str, Verdict]


def claims(runs: Runs) -> list[Claim]:
    """Return the claims about the curves.

    - `runs`: all runs.
    """
    return [make(runs, example) for make in (_inside, _settled, _continuous) for example in EXAMPLES]


def promises(runs: Runs) -> list[Claim]:
    """Return the claims about the parameters, for any disturbance.

    - `runs`: for their scenarios.
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
    verdicts: dict[str, Verdict] = {}
    for reading in runs.readings:
        run = runs[Case(example, reading)]
        outside, margin = metrics.envelope_violations(run), metrics.envelope_margin(run)
        margin = np.zeros(1) if margin is None else margin
        evidence[reading] = (
            f"{outside} samples outside; nearest to a bound: {significant(100 * float(margin.min()), 3)} % of the width"
        )
        verdicts[reading] = claim(run.outcome.ok and outside == 0)
    return Claim(f"{figure}, Example\u00a0{example}", "the errors stay inside the envelope", evidence, verdicts)


def _settled(runs: Runs, example: str) -> Claim:
    evidence: dict[str, str] = {}
    verdicts: dict[str, Verdict] = {}
    for reading in runs.readings:
        case = Case(example, reading)
        worst = worst_after_deadline(runs.scenarios[case], runs[case])
        if worst is None:
            evidence[reading], verdicts[reading] = "–", unchecked("the run ends before T")
            continue
        times = ", ".join(significant(time, 3) for time in metrics.settling_time(runs[case], 1e-3))
        evidence[reading] = (
            f"|e| after T_i at most {significant(max(worst), 2)} of the final radius; last time above 1e-3: {times} s"
        )
        verdicts[reading] = claim(max(worst) < 1.0)
    says = "from T_i on the error is inside the final radius of the envelope"
    return Claim(f"Theorem\u00a01\u00a0(2), Example\u00a0{example}", says, evidence, verdicts)


def _continuous(runs: Runs, example: str) -> Claim:
    figure = {"4.1": "Fig. 4", "4.2": "Fig. 10"}[example]
    evidence: dict[str, str] = {}
    verdicts: dict[str, Verdict] = {}
    for reading in runs.readings:
        case = Case(example, reading)
        steps, ways = step_ratio(runs[case], runs[case.halved])
        largest = metrics.max_torque_step(runs[case])
        unit = runs.scenarios[case].plant.robot.torque_units[int(np.argmax(largest))]
        evidence[reading] = (
            f"largest step between samples {significant(float(largest.max()), 2)} {unit}, at half the period at most "
            f"{significant(max(steps), 3)} times as large; AICE then within "
            f"{significant(100 * max(abs(way - 1) for way in ways), 2)} %"
        )
        smooth = runs[case].outcome.ok and max(steps) < 0.6 and all(abs(way - 1) <= REPRODUCED for way in ways)
        verdicts[reading] = claim(smooth)
    return Claim(f"{figure}, Example\u00a0{example}", CONTINUOUS, evidence, verdicts)


def _range(values: list[float]) -> str:
    low, high = (significant(value, 3) for value in values)
    return low if low == high else f"{low} to {high}"
