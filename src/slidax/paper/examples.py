"""The paper's schemes and examples, and all runs of the reproduction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from slidax import scenarios
from slidax.scenarios.scenario import Scenario
from slidax.simulation.run import Run

Reading = Literal["stated", "off"]
"""Reading of the paper's disturbance: acting as stated in the text, or off."""


@dataclass(frozen=True)
class Scheme:
    """A scheme in the paper's examples.

    - `key`, `name`: its name in scenario files, and in the paper.
    - `listed`: half width of the boundary layer in the paper's table; 0 if it lists none.
    - `other`: alternative half width, whose results are compared with those of `listed`.
    - `path`: dotted path of the boundary layer's half width in scenario files.
    - `band`: settling band for the comparison of settling times, rad or m; the paper prints none.
    - `nearest`: the reading of the disturbance (`Reading`) whose results are nearer to the printed row.
    """

    key: str
    name: str
    listed: float
    other: float
    path: str = "scheme.reaching.layer"
    band: float = 1e-3
    nearest: Reading = "stated"

    def called(self, layer: float | None) -> str:
        """Return the scheme's name, with the boundary layer if it is not that of the paper's table.

        - `layer`: half width of the boundary layer; None for that of the paper's table.
        """
        if layer is None or layer == self.listed:
            return self.name
        return f"{self.name}, sign" if layer == 0.0 else f"{self.name}, layer {layer:g}"


PROPOSED = "cftsmppc"
SCHEMES: dict[str, Scheme] = {
    scheme.key: scheme
    for scheme in (
        Scheme(PROPOSED, "CFTSMPPC", 0.05, 0.0, band=1e-8, nearest="off"),
        Scheme("ftsmppc", "FTSMPPC", 0.05, 0.0),
        Scheme("ftsmc", "FTSMC", 0.0, 0.05),
        Scheme("nftsmc", "NFTSMC", 0.0, 3e-4, path="scheme.layer", band=1e-4),
        Scheme("anftsmc", "ANFTSMC", 0.0, 1e-3, path="scheme.layer", band=1e-5, nearest="off"),
        Scheme("sfsmc", "SFSMC", 0.0, 0.05, band=1e-4),
    )
}
COMPARED: dict[str, tuple[str, ...]] = {
    "4.1": (PROPOSED, "ftsmppc", "ftsmc"),
    "4.2": (PROPOSED, "nftsmc", "anftsmc", "sfsmc"),
}
"""Schemes that each example compares, the proposed scheme first."""


READINGS: dict[Reading, str] = {"stated": "disturbance as stated", "off": "disturbance off"}
EXAMPLES = ("4.1", "4.2")
PERIOD = 1e-4
"""Integration step of the paper [s]."""

SAMPLED = (("continuous", 1e-3), ("held", 1e-3), ("held", 1e-4))
"""Modes and periods [s] of further runs of the proposed scheme: longer periods, and a held torque."""

Progress = Callable[[str, float], None]


class Case(NamedTuple):
    """One run of the reproduction.

    - `example`: number of the example in the paper.
    - `reading`: reading of the disturbance: `stated` as in the text, or `off`.
    - `mode`: `continuous`, or `held` for a torque that is held between samples.
    - `period`: integration step, or sampling period of a held torque [s].
    - `scheme`: key of the scheme.
    - `layer`: half width of the boundary layer; None for that of the paper's table.
    """

    example: str
    reading: Reading
    mode: str = "continuous"
    period: float = PERIOD
    scheme: str = PROPOSED
    layer: float | None = None

    @property
    def halved(self) -> Case:
        """The case at half the period."""
        return self._replace(period=self.period / 2)

    @property
    def held(self) -> Case:
        """The case with the torque held between two samples."""
        return self._replace(mode="held")

    @property
    def relayered(self) -> Case:
        """The case with the alternative boundary layer."""
        return self._replace(layer=SCHEMES[self.scheme].other)

    @property
    def name(self) -> str:
        """The scheme's name, with its boundary layer if it is not that of the paper's table."""
        return SCHEMES[self.scheme].called(self.layer)


@dataclass(frozen=True)
class Runs:
    """All runs of the reproduction; `runs[case]` is the run of a case.

    - `scenarios`, `runs`: simulated scenario and run of each case.
    - `readings`: the readings of the disturbance, in this order.
    """

    scenarios: dict[Case, Scenario]
    runs: dict[Case, Run]
    readings: tuple[Reading, ...]

    def __getitem__(self, case: Case) -> Run:
        return self.runs[case]

    @property
    def sampled(self) -> list[Case]:
        """The cases of the proposed scheme at longer periods and with a held torque."""
        return [Case(example, self.readings[0], *how) for example in EXAMPLES for how in SAMPLED]

    def nearest(self, example: str, scheme: str) -> Case:
        """Return the case of a scheme with the reading of the disturbance that is nearest to the printed values.

        This reading is `Scheme.nearest` in Example 4.2, and `stated` in Example 4.1, which prints no values. If there
        are no runs with this reading, the first entry of `readings` replaces it.

        - `example`, `scheme`: number of the example, and key of the scheme.
        """
        return _nearest(example, scheme, self.readings)

    def compared(self, example: str, reading: Reading, layers: Sequence[str] = ()) -> dict[str, Case]:
        """Return the cases of an example's schemes by the schemes' names, the proposed scheme first.

        - `example`, `reading`: number of the example, and reading of the disturbance.
        - `layers`: keys of the schemes that get their alternative boundary layer.
        """
        plain = [Case(example, reading, scheme=scheme) for scheme in COMPARED[example]]
        chosen = [case.relayered if case.scheme in layers else case for case in plain]
        return {case.name: case for case in chosen}


def cases(readings: Sequence[Reading]) -> list[Case]:
    """Return all cases of the reproduction.

    For each scheme and reading they have the paper's step, half the step, and the alternative boundary layer. Each
    scheme also has a held torque in its nearest reading, and the proposed scheme the cases of `SAMPLED`.

    - `readings`: readings of the disturbance.
    """
    listed: dict[Case, None] = {}
    for example in EXAMPLES:
        for scheme in COMPARED[example]:
            for reading in readings:
                case = Case(example, reading, scheme=scheme)
                listed |= dict.fromkeys([case, case.halved, case.relayered])
            listed[_nearest(example, scheme, readings).held] = None
        listed |= dict.fromkeys(Case(example, readings[0], mode, period) for mode, period in SAMPLED)
    return list(listed)


def simulate_all(readings: Sequence[Reading], changes: dict[str, Any], progress: Progress) -> Runs:
    """Run all cases, each once, two at a time.

    - `readings`: readings of the disturbance.
    - `changes`: new values for all scenarios, by dotted path such as `simulation.t1`.
    - `progress`: called with the name of the last finished step, and the completed fraction of the runs.
    """
    built: dict[Case, Scenario] = {}
    runs: dict[Case, Run] = {}
    listed = cases(readings)
    # Cases that differ only in numbers share a compiled loop: run them one after another.
    groups: dict[tuple[str, str, str], list[Case]] = {}
    for case in listed:
        built[case] = scenario_of(case, changes)
        groups.setdefault((case.example, case.scheme, case.mode), []).append(case)
    progress("Example 4.1", 0.0)
    with ThreadPoolExecutor(2) as pool:
        waiting = {pool.submit(_simulate, {case: built[case] for case in group}): group for group in groups.values()}
        for done in as_completed(waiting):
            runs |= done.result()
            case = waiting[done][0]
            stage = f"Example {case.example}, {SCHEMES[case.scheme].name}, {case.mode}"
            progress(stage, len(runs) / len(listed))
    return Runs(built, {case: runs[case] for case in listed}, tuple(readings))


def scenario_of(case: Case, changes: dict[str, Any]) -> Scenario:
    """Return the scenario of a case.

    - `changes`: new values by dotted path such as `simulation.t1`; they replace those of the case.
    """
    values: dict[str, Any] = {"simulation.mode": case.mode, "simulation.period": case.period}
    if case.scheme != PROPOSED:
        values["scheme.name"] = case.scheme
    if case.layer is not None:
        values[SCHEMES[case.scheme].path] = case.layer
    if case.reading == "off":
        values["disturbance.scale"] = 0.0
    return scenarios.load(f"example-{case.example}", {**values, **changes})


def _simulate(group: dict[Case, Scenario]) -> dict[Case, Run]:
    # With a held torque, the arm moves between samples: log every sample of the proposed scheme.
    return {
        case: scenario.simulate(progress=False, log_every=1 if case.mode == "held" and case.scheme == PROPOSED else 0)
        for case, scenario in group.items()
    }


def _nearest(example: str, scheme: str, readings: Sequence[Reading]) -> Case:
    # Only Example 4.2 has printed values.
    wanted = SCHEMES[scheme].nearest if example == "4.2" else "stated"
    return Case(example, wanted if wanted in readings else readings[0], scheme=scheme)
