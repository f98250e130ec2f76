"""Designs for many arms, and in comparison with files tuned by hand: the tables of docs/design.md.

`examples` designs laws for the files of examples/design, those of two-link.yaml also at 500 Hz and with a velocity
sensor.

`hand` designs laws for built-in scenarios: their arms, motions, sensors and drives, with masses known to 10 % and
starts to 0.02 rad, and the deadline and torque step of the file's own law as requirements. Both laws then run in the
scenario itself, and in cases of that set. Where the design's step is larger in the scenario itself, a smaller one is
required.

`arms` designs laws for the arms of both examples, the built-in arms, and five of the package example-robot-data, none
of which has rotors in its file. The scenarios are those of `slidax new` except for the law. Unknown are rotors of
0.002 to 0.005 kg m² for each N m, masses to 10 %, Coulomb friction of 0.5 to 1.5 % of the rating, and starts of 0.05
rad. Each design is then tried in new random cases, and in as many of a search for the worst one.

`refusal` searches for gains that meet the requirement that the page calls impossible.

`write` writes the tables from the files of `--out`.
"""

from __future__ import annotations

import argparse
import importlib
import json
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import slidax as sx
from slidax.certify import statistical
from slidax.certify.uncertainty_set import family_of
from slidax.design import Refusal, design
from slidax.design.problem import read_problem
from slidax.design.search import MOST, POLISH, TOP, cmaes_search
from slidax.scenarios import draft
from slidax.scenarios.load import validate_text
from slidax.studies import Predicate
from slidax.studies.cases import StudyTask, points
from slidax.studies.predicates import ENVELOPE
from slidax.studies.runner import Runner

from .shared import ROOT, write_table

DESIGNS = ROOT / "examples" / "design"
HAND = ("panda-payload", "ur5e-payload", "example-4.1-1khz")
EXAMPLES = ("example-4.1-1khz", "example-4.2-1khz")
READY = ("panda", "ur5e", "iiwa14", "gen3", "xarm7")
PUBLIC = {
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
}
"""By name, the file in example-robot-data."""

KEPT = ("title", "robot", "trajectory", "disturbance", "sensor", "actuator", "start")
CASES, OWN = 1000, 48
"""Number of cases from the set, in which both laws are compared, and of runs of the scenario itself."""

CALMER = 0.97
"""Factor on the required torque step if a design exceeds it in the scenario itself."""

ROUNDING = 1e-6
"""Uncertainty of the start where positions are not rounded [rad]."""

NOISE = 1e-3
"""Noise of a velocity sensor [rad/s]."""


def measure_designs() -> None:
    """Measure one kind of designs, or write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("examples", "hand", "arms", "refusal", "write"))
    parser.add_argument("results", nargs="*", type=Path)
    parser.add_argument("--rates", default="1000,500")
    parser.add_argument("--velocity", default="no,yes")
    parser.add_argument("--arms")
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    if options.what == "write":
        write([json.loads(line) for path in options.results for line in path.read_text().splitlines()])
        return
    kinds = {"examples": of_examples, "hand": by_hand, "arms": lambda: of_arms(options)}
    kinds["refusal"] = lambda: of_a_refusal(options.minutes)
    rows = kinds[options.what]()
    for row in rows:
        print(json.dumps(row), flush=True)
        if options.out:
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")


def of_examples() -> Any:
    """Rows of the example designs."""
    noisy = {"resolution": 1e-5, "velocity_noise": NOISE, "velocity": "measured"}
    for name, rate, sensor in (
        ("two-link", 1000.0, None),
        ("two-link", 500.0, None),
        ("two-link", 1000.0, noisy),
        ("panda", 1000.0, None),
        ("panda-along", 1000.0, None),
        ("two-link-along", 1000.0, None),
    ):
        file = DESIGNS / f"{name}.yaml"
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
        if sensor is None and data["simulation"]["period"] == 1.0 / rate:
            result, seconds = timed(file)
        else:
            data["simulation"]["period"] = 1.0 / rate
            result, seconds = designed({**data, "sensor": sensor or data["sensor"]})
        row = {"kind": "example", "name": name, "rate": rate, "velocity": "no" if sensor is None else "yes"}
        yield {**row, "seconds": seconds, **told(result)}


def told(result: Any) -> dict[str, Any]:
    """A design's numbers, or the reason of its refusal."""
    if isinstance(result, Refusal):
        return {"refused": result.reason}
    return {
        "proof": result.proof,
        "horizon": result.choice.horizon,
        "final": float(np.max(result.choice.final)),
        "error": result.worst.error,
        "step": result.worst.step,
    }


def by_hand() -> Any:
    """Rows of designs in comparison with hand-tuned laws."""
    for name in HAND:
        own = sx.scenarios.load(name)
        described = own.description.model_dump(exclude_unset=True)
        uncertain: dict[str, Any] = {"start.q": {"around": 0.02, "each": "joint"}}
        masses = "robot.plant.masses" if name.startswith("example") else "robot.plant.mass_factor"
        uncertain[masses] = {"around": "10 %", "each": "joint"} if name.startswith("example") else {"around": "10 %"}
        before = numbers({**described, "uncertainty": uncertain})
        time_of = {key: described["simulation"][key] for key in ("period", "substeps", "t1")}
        deadline = deadline_of(own)
        blocks = {key: described[key] for key in KEPT if key in described}
        required = before["set_step"]
        while True:
            requirements = {"deadline": deadline, "accuracy": "best", "torque_step": required}
            result, seconds = designed(
                {**blocks, "simulation": time_of, "uncertainty": uncertain, "requirements": requirements}
            )
            row = {"kind": "hand", "name": name, "seconds": seconds, "required": required, "before": before}
            if isinstance(result, Refusal):
                yield {**row, "refused": result.reason}
                break
            law = result.description.model_dump(exclude_unset=True)["scheme"]
            after = numbers({**described, "scheme": law, "uncertainty": uncertain})
            if after["step"] <= before["step"]:
                yield {**row, "after": after, "proof": result.proof}
                break
            # A smaller step in the worst case can be larger in the scenario itself.
            required *= CALMER * before["step"] / after["step"]


def deadline_of(scenario: sx.scenarios.Scenario) -> float:
    """When the last of its joints' envelopes is narrow [s]."""
    return float(np.max(scenario.description.scheme.transformation.performance.deadline))


def numbers(data: dict[str, Any]) -> dict[str, float]:
    """Errors and torque steps of a scenario's law: in its own run, and the largest of cases of its set."""
    # Rounding makes the largest error of one run random: the median of runs that begin within a step of the encoder.
    step = float(np.max(data["sensor"].get("resolution", ROUNDING)))
    own = cases_of({**data, "uncertainty": {"start.q": {"around": step, "each": "joint"}}}, OWN)
    rows = cases_of(data, CASES)
    return {
        "error": float(np.median(own["steady_error"])),
        "step": float(np.median(own["steady_torque_step"])),
        "set_error": float(np.max(rows["steady_error"])),
        "set_step": float(np.max(rows["steady_torque_step"])),
        "outside": int(np.sum(~Predicate(ENVELOPE).holds(rows))) + int(np.sum(~Predicate(ENVELOPE).holds(own))),
    }


def cases_of(data: dict[str, Any], count: int) -> Any:
    """Measured rows of random cases of a scenario's set."""
    scenario = validate_text(data).build("scenario")
    family, simulation = family_of(scenario), scenario.description.simulation
    drawn = points(5, 0, count, family.space.dimensions)
    runner = Runner(StudyTask.of(family, "auto"), Runner.rows_of_chunk(round(simulation.t1 / simulation.period)))
    return runner.rows(0, family.space.values(drawn))


def designed(data: dict[str, Any]) -> tuple[Any, float]:
    """A design, and the processor's seconds for it.

    The set's entries are in alphabetical order: cases are drawn in the order of a file.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "requirements.yaml"
        path.write_text(yaml.safe_dump(plain(data)), encoding="utf-8")
        return timed(path)


def timed(file: Path) -> tuple[Any, float]:
    """The design that a file asks for, and the processor's seconds for it."""
    begun = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sx.DefinitionWarning)
        result = design(read_problem(file))
    return result, time.process_time() - begun


def of_a_refusal(minutes: float) -> Any:
    """Search longer for gains for a refused requirement, from wider and wider initial sets."""
    data = yaml.safe_load((DESIGNS / "two-link.yaml").read_text(encoding="utf-8"))
    data["requirements"] = {"deadline": 0.25, "accuracy": 1e-3}
    result, seconds = designed(data)
    yield {"kind": "refusal", "name": "two-link", "seconds": seconds, **told(result)}
    searching = importlib.import_module("slidax.design.design")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "requirements.yaml"
        path.write_text(yaml.safe_dump(plain(data)), encoding="utf-8")
        problem = read_problem(path)
    frame, first = searching._begin(problem)
    aim = searching._aim(problem, frame)
    trials, start = searching._best(problem, frame, first)
    cases, many = trials.cases(POLISH), trials.cases(MOST)
    until, seed, tried = time.monotonic() + 60.0 * minutes, 0, 0
    while time.monotonic() < until and not start.holds:
        seed += 1
        laws = cmaes_search(trials, start.choice, cases, aim.cost, free=False, size=0.1 + 0.1 * (seed % 3), seed=seed)
        tried += len(laws)
        top = trials.judged([trial.choice for trial in sorted(laws, key=aim.cost)[:TOP]], many)
        start = aim.best([start, *top])
    yield {
        "kind": "refusal",
        "name": "two-link",
        "minutes": minutes,
        "laws": tried,
        "outside": start.outside,
        "of": start.cases,
    }


def plain(value: Any) -> Any:
    """The same in lists and Python's own numbers."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def of_arms(options: argparse.Namespace) -> Any:
    """Rows of designs for arms."""
    for name in chosen_arms(options, (*EXAMPLES, *READY, *PUBLIC)):
        for rate in map(float, options.rates.split(",")):
            for velocity in options.velocity.split(","):
                row = {"kind": "arm", "name": name, "rate": rate, "velocity": velocity}
                try:
                    result, seconds = designed(required(name, rate, velocity == "yes"))
                except sx.DefinitionError as error:
                    yield {**row, "invalid": str(error)}
                    continue
                row |= {"seconds": seconds, **told(result)}
                if isinstance(result, Refusal):
                    yield row
                    continue
                yield {**row, **in_new_cases(result, options.cases)}


def chosen_arms(options: argparse.Namespace, all_of_them: tuple[str, ...]) -> tuple[str, ...]:
    """The arms of `--arms`, by default all."""
    return all_of_them if options.arms is None else tuple(options.arms.split(","))


def in_new_cases(result: Any, cases: int) -> dict[str, Any]:
    """Failures of a design in new random cases, and in as many of a search for the worst one."""
    judged = statistical(result.description.build("design"), cases, seed=3).bound
    return {
        "cases": cases,
        "failures": int(judged["failures"]),
        "searched": int(judged["searched"]),
        "worst": float(judged["worst_margin"]),
    }


def drafted(name: str, rate: float) -> dict[str, Any]:
    """The scenario that `slidax new` writes for an arm."""
    data: dict[str, Any] = yaml.safe_load(
        draft(public(PUBLIC[name]) if name in PUBLIC else name, rate, folder=Path("/")).text
    )
    if "file" in data["robot"]:
        data["robot"]["file"] = str(Path("/") / data["robot"]["file"])
    return data


def required(name: str, rate: float, velocity: bool) -> dict[str, Any]:
    """The requirements of an arm, as a file would say them."""
    sensor: dict[str, Any] = {"resolution": 1e-5, "velocity": "differenced", "delay": 1}
    if velocity:
        sensor = {"resolution": 1e-5, "velocity_noise": NOISE, "velocity": "measured", "delay": 1}
    if name in EXAMPLES:
        own = sx.scenarios.load(name)
        described = own.description.model_dump(exclude_unset=True)
        masses = {"robot.plant.masses": {"around": "10 %", "each": "joint"}}
        blocks = {key: described[key] for key in KEPT if key in described}
        time_of = {"period": 1.0 / rate, "substeps": 5, "t1": 10.0}
        requirements = {"deadline": deadline_of(own), "accuracy": "best"}
        uncertain = {**masses, "start.q": {"around": 0.02, "each": "joint"}}
        if name == "example-4.2-1khz":
            # The third joint slides: a length is no angle.
            uncertain["start.q"] = {"around": 0.005, "each": "joint"}
        return {
            **blocks,
            "sensor": sensor,
            "simulation": time_of,
            "uncertainty": uncertain,
            "requirements": requirements,
        }
    data = drafted(name, rate)
    rated = np.abs(np.asarray(data["actuator"]["torque"], float))
    data["robot"]["plant"] = {"armature": (0.0035 * rated).tolist(), "coulomb": (0.01 * rated).tolist()}
    uncertain = {
        "robot.plant.armature": {"between": [(0.002 * rated).tolist(), (0.005 * rated).tolist()], "each": "joint"},
        "robot.plant.coulomb": {"between": [(0.005 * rated).tolist(), (0.015 * rated).tolist()], "each": "joint"},
        "robot.plant.mass_factor": {"around": "10 %"},
        "start.q": {"around": 0.05, "each": "joint"},
    }
    blocks = {key: data[key] for key in KEPT if key in data}
    return {
        **blocks,
        "sensor": sensor,
        "simulation": {"period": 1.0 / rate, "substeps": 5, "t1": 6.0},
        "uncertainty": uncertain,
        "requirements": {"deadline": 2.0, "accuracy": "best"},
    }


def public(file: str) -> Path:
    """A file of example-robot-data."""
    import site

    for place in site.getsitepackages():
        path = Path(place) / "cmeel.prefix" / "share" / "example-robot-data" / "robots" / file
        if path.is_file():
            return path
    raise SystemExit(f"{file} is not here: pip install example-robot-data")


def write(rows: list[dict[str, Any]]) -> None:
    """Write the tables of docs/design.md."""
    for kind, table in (
        ("example", example_table),
        ("hand", hand_table),
        ("arm", arm_table),
    ):
        own = [row for row in rows if row["kind"] == kind]
        if own:
            write_table("design.md", f"designs-{kind}", "\n".join(table(own)))


def example_table(rows: list[dict[str, Any]]) -> list[str]:
    """The table of examples."""
    head = (
        "| requirements | rate [Hz] | velocity sensor | proof | H [ms] | final radius [rad] | error [rad] | step [N m] "
        "| time |"
    )
    lines = [head, "|---|---:|---|---|---:|---:|---:|---:|---:|"]
    for row in rows:
        begin = f"| `{row['name']}.yaml` | {row['rate']:g} | {row['velocity']} |"
        if "proof" not in row:
            lines.append(f"{begin} refused: {row['refused']} | | | | | {row['seconds']:.0f} s |")
            continue
        lines.append(
            f"{begin} {row['proof']} | {1e3 * row['horizon']:.3g} | {row['final']:.2e} | {row['error']:.1e} "
            f"| {row['step']:.2g} | {row['seconds']:.0f} s |"
        )
    return lines


def hand_table(rows: list[dict[str, Any]]) -> list[str]:
    """The table of both laws, in the scenario itself and in the worst case."""
    lines = [
        "| scenario | law | error | torque step [N m] | error, worst case | torque step, worst case | left | time |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        if "after" not in row:
            lines.append(f"| `{row['name']}` | refused: {row['refused']} | | | | | | {row['seconds']:.0f} s |")
            continue
        for law, values, took in (
            ("by hand", row["before"], ""),
            ("designed", row["after"], f"{row['seconds']:.0f} s"),
        ):
            lines.append(
                f"| `{row['name']}` | {law} | {values['error']:.2e} | {values['step']:.3g} | {values['set_error']:.2e} "
                f"| {values['set_step']:.3g} | {values['outside']} | {took} |"
            )
    return lines


def arm_table(rows: list[dict[str, Any]]) -> list[str]:
    """The table of arms."""
    head = (
        "| arm | rate [Hz] | velocity sensor | H [ms] | final radius | error | left, of cases | worst margin | time |"
    )
    lines = [head, "|---|---:|---|---:|---:|---:|---:|---:|---:|"]
    for row in rows:
        begin = f"| {row['name']} | {row['rate']:g} | {row['velocity']} |"
        if "proof" not in row:
            reason = row.get("refused") or row.get("invalid")
            lines.append(f"{begin} {reason} | | | | | {row.get('seconds', 0):.0f} s |")
            continue
        lines.append(
            f"{begin} {1e3 * row['horizon']:.3g} | {row['final']:.2e} | {row['error']:.1e} "
            f"| {row['failures']} of {row['cases']} | {row['worst']:.3f} | {row['seconds']:.0f} s |"
        )
    return lines
