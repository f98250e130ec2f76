"""The runs that the report is made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from slidax import scenarios
from slidax.scenarios import Scenario
from slidax.simulation import Run

Reading = Literal["stated", "off"]
READINGS: dict[Reading, str] = {"stated": "disturbance as stated", "off": "disturbance off"}
EXAMPLES = ("4.1", "4.2")
PERIOD = 1e-4
SAMPLED = (("continuous", 1e-3), ("held", 1e-3), ("held", 1e-4))
"""Modes and periods in which the sampling limit is looked for."""

Progress = Callable[[str, float], None]


class Case(NamedTuple):
    """One run: which example, with which disturbance, in which mode and with which period [s]."""

    example: str
    reading: Reading
    mode: str = "continuous"
    period: float = PERIOD

    @property
    def halved(self) -> Case:
        """The same at half the period."""
        return self._replace(period=self.period / 2)


@dataclass(frozen=True)
class Runs:
    """All runs by case.

    - `scenarios`: what was simulated.
    - `runs`: what came of it.
    - `readings`: how the disturbance was read, in this order.
    """

    scenarios: dict[Case, Scenario]
    runs: dict[Case, Run]
    readings: tuple[Reading, ...]

    def __getitem__(self, case: Case) -> Run:
        return self.runs[case]

    @property
    def sampled(self) -> list[Case]:
        """The cases that look for the sampling limit."""
        return [Case(example, self.readings[0], *how) for example in EXAMPLES for how in SAMPLED]


def cases(readings: Sequence[Reading]) -> list[Case]:
    """All cases: each example and reading at the paper's step and at half of it, then the sampled ones.

    - `readings`: how to read the disturbance.
    """
    listed = []
    for example in EXAMPLES:
        for reading in readings:
            listed += [Case(example, reading), Case(example, reading).halved]
        listed += [Case(example, readings[0], mode, period) for mode, period in SAMPLED]
    return listed


def simulate_all(readings: Sequence[Reading], changes: dict[str, Any], progress: Progress) -> Runs:
    """Runs all cases, each once.

    - `readings`: how to read the disturbance.
    - `changes`: values by dotted path that all scenarios share.
    - `progress`: told what is being done and which fraction of the runs is done.
    """
    built: dict[Case, Scenario] = {}
    runs: dict[Case, Run] = {}
    listed = cases(readings)
    for number, case in enumerate(listed):
        stage = f"Example {case.example}, {READINGS[case.reading]}, {case.mode}, {case.period:g} s"
        progress(stage, number / len(listed))
        values: dict[str, Any] = {"simulation.mode": case.mode, "simulation.period": case.period}
        if case.reading == "off":
            values["disturbance.scale"] = 0.0
        built[case] = scenarios.load(f"example-{case.example}", {**values, **changes})
        # What holds its torque moves between any two samples, so that its log leaves none out.
        runs[case] = built[case].simulate(progress=False, log_every=1 if case.mode == "held" else 0)
    return Runs(built, runs, tuple(readings))
