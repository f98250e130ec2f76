"""What the paper prints beside what the runs gave, with a verdict on each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slidax import metrics
from slidax.reports import significant

from .bounds import inverse_inertia, settling_bound
from .measured import steady_error, step_ratio, table_3, worst_after_deadline
from .printed import BAND, STEADY_LIMIT, TABLE_3
from .runs import EXAMPLES, Case, Runs
from .verdicts import REPRODUCED, Verdict, below, claim, compare, unchecked

CONTINUOUS = "the torque is continuous and free of chattering"


@dataclass(frozen=True)
class Row:
    """A printed number.

    - `quantity`: its key, as in `printed`, or `limit`.
    - `place`, `name`: where it is printed, and what it is called there.
    - `joint`: which joint, as text.
    - `unit`: of both numbers.
    - `printed`: as printed.
    - `compared_with`: what was computed.
    - `computed`, `verdicts`: by reading of the disturbance.
    """

    quantity: str
    place: str
    name: str
    joint: str
    unit: str
    printed: str
    compared_with: str
    computed: dict[str, float | None]
    verdicts: dict[str, Verdict]


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


def numbers(runs: Runs) -> list[Row]:
    """Table 3's row of CFTSMPPC, and the limit of the error that the text gives.

    - `runs`: all runs.
    """
    robot = runs.scenarios[Case("4.2", runs.readings[0])].plant.robot
    rows = []
    for item in TABLE_3:
        computed = {reading: table_3(runs[Case("4.2", reading)], item.quantity) for reading in runs.readings}
        for i, text in enumerate(item.texts):
            unit = {"settling_time": "s", "steady_error": robot.joint_units[i], "peak_torque": robot.torque_units[i]}
            values: dict[str, float | None] = {reading: joints[i] for reading, joints in computed.items()}
            verdicts: dict[str, Verdict] = {
                reading: compare(float(text), value, _absent(runs, reading, item.quantity))
                for reading, value in values.items()
            }
            rows.append(
                Row(
                    item.quantity,
                    item.place,
                    item.name,
                    str(i + 1),
                    unit[item.quantity],
                    text,
                    item.compared_with,
                    values,
                    verdicts,
                )
            )
    errors = {reading: steady_error(runs[Case("4.2", reading)]) for reading in runs.readings}
    worst: dict[str, float | None] = {
        reading: None if joints is None else max(joints) for reading, joints in errors.items()
    }
    rows.append(
        Row(
            "limit",
            "Section 4",
            "|e_i| in steady state",
            "all",
            "rad, m",
            f"< {STEADY_LIMIT}",
            "largest |e| over the second half of the run",
            worst,
            {reading: below(float(STEADY_LIMIT), value) for reading, value in worst.items()},
        )
    )
    return rows


def claims(runs: Runs) -> list[Claim]:
    """What is said of the curves.

    - `runs`: all runs.
    """
    return [make(runs, example) for make in (_inside, _settled, _continuous) for example in EXAMPLES]


def promises(runs: Runs) -> list[Claim]:
    """What is said of the parameters, whatever the disturbance.

    - `runs`: for their scenarios.
    """
    found = []
    for example, table in zip(EXAMPLES, ("Table 1", "Table 2"), strict=True):
        inertia = inverse_inertia(runs.scenarios[Case(example, runs.readings[0])])
        m1, m2 = inertia["m1"], inertia["m2"]
        norms = {"spectral norm": inertia["spectral"], "Frobenius norm": inertia["frobenius"]}
        found.append(
            Claim(
                f"(47), {table}",
                f"m1 ≤ ‖M⁻¹(q)‖ ≤ m2 with m1 = {m1:g}, m2 = {m2:g}",
                {norm: f"{_range(values)} over all q" for norm, values in norms.items()},
                {norm: claim(m1 <= values[0] and values[1] <= m2) for norm, values in norms.items()},
            )
        )
    for example in EXAMPLES:
        bound = settling_bound(runs.scenarios[Case(example, runs.readings[0])])
        deadlines = [f"{deadline:g}" for deadline in bound["deadlines"]]
        found.append(
            Claim(
                f"(48)–(50), Section\u00a05, Example\u00a0{example}",
                "T_i ≥ T_max, the condition for calling T_i a predefined time",
                {"": f"T_max = {significant(bound['bound'], 3)} s, T = {', '.join(deadlines)} s"},
                {"": claim(min(bound["deadlines"]) >= bound["bound"])},
            )
        )
    return found


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


def _absent(runs: Runs, reading: str, quantity: str) -> Verdict | None:
    """A run that reached its end without settling does not lack a settling time: it differs."""
    if quantity == "settling_time" and runs[Case("4.2", "stated" if reading == "stated" else "off")].outcome.ok:
        return Verdict("differs", f"differs: still above {significant(BAND, 1)} at the end")
    return None


def _range(values: list[float]) -> str:
    low, high = (significant(value, 3) for value in values)
    return low if low == high else f"{low} to {high}"
