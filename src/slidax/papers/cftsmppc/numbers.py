"""The paper's printed values next to computed ones, with a verdict on each."""

from __future__ import annotations

from dataclasses import dataclass

from slidax import metrics
from slidax.reports import significant
from slidax.simulation import Run

from .. import indices
from .measured import chatter, steady_error, table_3
from .printed import ENERGY_SHARE, STEADY_LIMIT, TABLE_3, Printed
from .runs import Case, Runs
from .schemes import SCHEMES, Reading
from .verdicts import Verdict, below, compare, incomparable

Values = dict[str, float | None]


@dataclass(frozen=True)
class Row:
    """A printed number.

    - `scheme`: whose.
    - `quantity`: its key, as in `printed`, or `limit` or `energy`.
    - `place`, `name`: where it is printed, and what it is called there.
    - `joint`: which joint, as text.
    - `unit`: of both numbers.
    - `printed`: as printed.
    - `compared_with`: what was computed.
    - `computed`, `verdicts`: by reading of the disturbance.
    """

    scheme: str
    quantity: str
    place: str
    name: str
    joint: str
    unit: str
    printed: str
    compared_with: str
    computed: Values
    verdicts: dict[str, Verdict]


def numbers(runs: Runs) -> list[Row]:
    """Table 3 in full, the limit of the error that the text gives, and the share of energy.

    - `runs`: all runs.
    """
    table = [row for scheme, items in TABLE_3.items() for item in items for row in _joints(runs, scheme, item)]
    return [*table, _limit(runs), _energy(runs, False), _energy(runs, True)]


def energy_share(runs: Runs, reading: Reading, layered: bool) -> float:
    """ECI of CFTSMPPC in percent of that of NFTSMC, both summed over the joints.

    - `runs`: all runs.
    - `reading`: of the disturbance.
    - `layered`: whether NFTSMC has a boundary layer.
    """
    rival = _nftsmc(reading, layered)
    return float(100 * indices.eci(runs[Case("4.2", reading)]).sum() / indices.eci(runs[rival]).sum())


def _joints(runs: Runs, scheme: str, item: Printed) -> list[Row]:
    robot = runs.scenarios[Case("4.2", runs.readings[0])].plant.robot
    band = SCHEMES[scheme].band
    result = {reading: _judged(runs, Case("4.2", reading, scheme=scheme), item, band) for reading in runs.readings}
    units = {"settling_time": ("s",) * 3, "steady_error": robot.joint_units, "peak_torque": robot.torque_units}
    return [
        Row(
            SCHEMES[scheme].name,
            item.quantity,
            item.place,
            item.name,
            str(i + 1),
            units[item.quantity][i],
            text,
            item.compared_with,
            {reading: joints[i][0] for reading, joints in result.items()},
            {reading: joints[i][1] for reading, joints in result.items()},
        )
        for i, text in enumerate(item.texts)
    ]


def _judged(runs: Runs, case: Case, item: Printed, band: float) -> list[tuple[float | None, Verdict]]:
    run = runs[case]
    values = table_3(run, item.quantity, band)
    verdicts = [
        compare(printed, value, _absent(run, item.quantity, band))
        for printed, value in zip(item.values, values, strict=True)
    ]
    if item.quantity == "peak_torque":
        growth, first = chatter(run, runs[case.halved]), metrics.initial_torque(run)
        # A peak at the start comes before any chattering.
        verdicts = [
            verdict if way is None or value == float(start) else incomparable(_growing(way))
            for verdict, way, value, start in zip(verdicts, growth, values, first, strict=True)
        ]
    return list(zip(values, verdicts, strict=True))


def _growing(way: float) -> str:
    return f"chatters (AICE × {significant(way, 2)})"


def _absent(run: Run, quantity: str, band: float) -> Verdict | None:
    """A run that reached its end without settling does not lack a settling time: it differs."""
    if quantity == "settling_time" and run.outcome.ok:
        return Verdict("differs", f"differs: still above {significant(band, 1)} at the end")
    return None


def _limit(runs: Runs) -> Row:
    errors = {reading: steady_error(runs[Case("4.2", reading)]) for reading in runs.readings}
    worst: Values = {reading: None if joints is None else max(joints) for reading, joints in errors.items()}
    return Row(
        "CFTSMPPC",
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


def _energy(runs: Runs, layered: bool) -> Row:
    computed: Values = {}
    verdicts: dict[str, Verdict] = {}
    for reading in runs.readings:
        rival = _nftsmc(reading, layered)
        value = energy_share(runs, reading, layered)
        computed[reading], verdicts[reading] = value, compare(float(ENERGY_SHARE), value)
        if not layered:
            ways = [way for way in chatter(runs[rival], runs[rival.halved]) if way is not None]
            if ways:
                verdicts[reading] = incomparable("NFTSMC " + _growing(max(ways)))
    return Row(
        "CFTSMPPC",
        "energy",
        "Section 4",
        "ECI in percent of that of NFTSMC",
        "all",
        "%",
        ENERGY_SHARE,
        f"sums over the joints; {_nftsmc(runs.readings[0], layered).name}{'' if layered else ' as listed'}",
        computed,
        verdicts,
    )


def _nftsmc(reading: Reading, layered: bool) -> Case:
    case = Case("4.2", reading, scheme="nftsmc")
    return case.relayered if layered else case
