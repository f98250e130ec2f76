"""An independent two-link plant around the exported law does not exceed the bound, in cases chosen to break it."""

import ctypes
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.certify.loop.problem import LoopProblem
from slidax.certify.loop.set_bound import SetBound, set_bound
from slidax.export.c_project import project
from slidax.scenarios import Scenario, load
from tests.export.exported import COMPILERS, at, compiled, needs_a_compiler, write_law

SUBSTEPS = 20

ARM = np.dtype(
    [(name, "f8", (2,)) for name in ("masses", "inertias", "lengths")]
    + [("gravity", "f8"), ("q", "f8", (2,)), *((name, "f8") for name in ("resolution", "cutoff", "torque", "step"))]
    + [(name, "i8") for name in ("delay", "substeps", "terms")]
)
TERM = np.dtype([(name, "f8", (2,)) for name in ("amplitude", "frequency", "phase")])


@dataclass(frozen=True)
class Number:
    """One uncertain value: its array in the arm or in a term, and its ends."""

    path: str
    entry: int
    low: float
    high: float


class Attacked:
    """A scenario's two links with its exported law, and its set as a box of values."""

    def __init__(self, scenario: Scenario, folder: Path) -> None:
        write_law(project(scenario, name="law", single=False, with_golden=False), folder)
        source = Path(__file__).with_name("attack.c")
        # In the compiler's own folder, which is where the header is.
        (folder / "attack.c").write_text(source.read_text())
        flags = ("-O2", "-ffp-contract=off", "-shared", "-fPIC", "-o", "attack.so", "-lm")
        compiled(COMPILERS[0], folder, "slidax_law.c", "attack.c", *flags)
        self.library = ctypes.CDLL(str(folder / "attack.so"))
        self.scenario, self.description = scenario, scenario.description
        self.samples = round(scenario.t1 / scenario.period)
        self.reference = self._reference()
        self.numbers = [
            number
            for path, uncertainty in self.description.uncertainty.items()
            for number in self._numbers(path, uncertainty)
        ]

    def errors(self, shares: np.ndarray) -> np.ndarray:
        """Errors at the samples of each member [cases N 2], for shares of each value's range [cases D]."""
        errors = np.empty((len(shares), self.samples, 2))
        for case, member in zip(errors, shares, strict=True):
            arm, terms, scale = self._nominal()
            for number, share in zip(self.numbers, member, strict=True):
                value = number.low + share * (number.high - number.low)
                block, *rest = number.path.split(".")
                if number.path == "disturbance.scale":
                    scale = value
                elif block == "disturbance":
                    terms[rest[2]][int(rest[1]), number.entry] = value
                elif block == "start":
                    arm["q"][0, number.entry] = value
                else:
                    arm[rest[-1]][0, number.entry] = value
            terms["amplitude"] *= scale
            period = ctypes.c_double(self.scenario.period)
            self.library.attack(ctypes.c_long(self.samples), period, *map(at, (self.reference, arm, terms, case)))
        return errors

    def worst(self, bound: np.ndarray, first: int, cases: int, seed: int) -> float:
        """The largest share of a bound [K 2 2], below and above zero, that a search reaches from a sample on.

        First corners of the set, half of the cases or all; then variations of the worst one with some values at other
        ends.
        """
        random = np.random.default_rng(seed)
        count = len(self.numbers)
        corners = np.array(list(product((0.0, 1.0), repeat=count))) if count < 12 else random.integers(0, 2, (1, count))
        tried = random.permutation(corners)[: max(cases // 2, 1)].astype(float)
        best, worst = tried[0], 0.0
        left = cases
        while left > 0 and len(tried):
            for member, error in zip(tried, self.errors(tried), strict=True):
                share = self.share(error, bound, first)
                best, worst = (member, share) if share > worst else (best, worst)
            left -= len(tried)
            tried = np.tile(best, (min(left, 16), 1))
            turned = random.uniform(size=tried.shape) < 1.5 / max(count, 1)
            tried[turned] = np.where(random.uniform(size=turned.sum()) < 0.7, 1.0 - tried[turned], random.uniform())
        return worst

    @staticmethod
    def share(error: np.ndarray, bound: np.ndarray, first: int) -> float:
        """The largest share of the bound that an error reaches."""
        late = error[first : first + len(bound)]
        side = np.where(late > 0.0, bound[: len(late), 1], bound[: len(late), 0])
        return float(np.max(np.abs(late) / np.maximum(side, 1e-12)))

    def _reference(self) -> np.ndarray:
        """q, q̇, q̈ of the sum of exponentials at all samples, and one more [N + 1 6]."""
        motion: Any = self.description.trajectory
        t = self.scenario.period * np.arange(self.samples + 2)
        rates, sizes = np.asarray(motion.rates), np.asarray(motion.amplitudes)
        decay = np.exp(-rates[None] * t[:, None])
        each = [(decay * (-rates) ** k) @ sizes for k in range(3)]
        return np.ascontiguousarray(np.concatenate([each[0] + np.asarray(motion.offset), *each[1:]], axis=1))

    def _nominal(self) -> tuple[np.ndarray, np.ndarray, float]:
        plant, sensor = self.description.robot.plant, self.description.sensor
        arm = np.zeros(1, ARM)
        for name in ("masses", "inertias", "lengths"):
            arm[name] = getattr(plant, name)
        arm["gravity"], arm["q"] = plant.gravity_acceleration, self.description.start.q
        arm["resolution"], arm["delay"], arm["substeps"] = sensor.resolution, round(sensor.delay), SUBSTEPS
        arm["cutoff"] = sensor.cutoff if sensor.velocity == "differenced" else 0.0
        arm["torque"] = self.description.actuator.torque
        arm["step"] = float(self.description.actuator.rate) * self.scenario.period
        arm["terms"] = len(self.description.disturbance.terms)
        terms = np.zeros(len(self.description.disturbance.terms), TERM)
        for row, term in zip(terms, self.description.disturbance.terms, strict=True):
            for name in TERM.names or ():
                row[name] = getattr(term, name, 0.0) if getattr(term, name, None) is not None else 0.0
        return arm, terms, float(self.description.disturbance.scale)

    def _numbers(self, path: str, uncertainty: Any) -> list[Number]:
        name, *_ = path.split(".")[-1:]
        if path == "disturbance.scale":
            own = np.array([self.description.disturbance.scale])
        elif path.startswith("disturbance."):
            own = self._nominal()[1][name][int(path.split(".")[2])]
        else:
            own = self._nominal()[0]["q" if path == "start.q" else name][0]
        if hasattr(uncertainty, "around"):
            text = uncertainty.around
            reach = np.abs(own) * float(text.rstrip(" %")) / 100.0 if isinstance(text, str) else float(text)
            ends = own - reach, own + reach
        else:
            ends = tuple(np.broadcast_to(np.asarray(end, float), own.shape) for end in uncertainty.between)
        assert uncertainty.each or own.size == 1, "each number by itself"
        return [Number(path, k, float(ends[0][k]), float(ends[1][k])) for k in range(own.size)]


NAME = "example-4.1-1khz"
WITHOUT = {"scheme.sampled_data.adaptation": None}
MASSES = {"robot.plant.masses": {"around": "10 %", "each": "joint"}}
INERTIAS = {"robot.plant.inertias": {"around": "8 %", "each": "joint"}}
RIPPLE = {"kind": "harmonic", "amplitude": [0.0, 0.0], "frequency": 6283.185307179586, "phase": 1.0}

DESIGNED = Path(__file__).with_name("two-link.yaml")
"""Written by `slidax design examples/design/two-link.yaml`."""

EXAMPLES: list[tuple[str, str | Path, dict[str, Any]]] = [
    ("masses", NAME, {"uncertainty": MASSES}),
    ("pushes", NAME, {"uncertainty": {"disturbance.scale": {"between": [0.0, 2.0]}, **INERTIAS}, **WITHOUT}),
    ("designed", DESIGNED, {}),
    (
        "ripple",
        NAME,
        {
            "disturbance.terms": [RIPPLE],
            "uncertainty": {"disturbance.terms.0.amplitude": {"between": [-0.05, 0.05], "each": "joint"}, **INERTIAS},
            **WITHOUT,
        },
    ),
]


def attacked(scenario: Scenario, whole: SetBound, folder: Path, cases: int, seed: int = 0) -> float:
    """The largest share of the bound that a search for the worst case reaches."""
    assert whole.bounds is not None
    first = whole.entry.sample + int(whole.assembly.subject.dead_time)
    return Attacked(scenario, folder).worst(whole.bounds.error, first, cases, seed)


def bounded(name: str | Path, changes: dict[str, Any]) -> tuple[Scenario, SetBound]:
    scenario = load(name, changes)
    subject = LoopProblem.of(scenario)
    assert isinstance(subject, LoopProblem)
    whole = set_bound(subject)
    assert isinstance(whole, SetBound) and whole.holds
    return scenario, whole


@needs_a_compiler
def test_independent_plant_reproduces_the_errors_of_a_run(tmp_path):
    scenario = load(NAME, {"uncertainty": MASSES, "simulation.t1": 0.5})
    other = Attacked(scenario, tmp_path)
    ours = np.asarray(scenario.simulate(log_every=1, progress=False).log.e)[: other.samples]
    np.testing.assert_allclose(other.errors(np.full((1, 2), 0.5))[0], ours, atol=1e-9)


@needs_a_compiler
@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "changes"), [example[1:] for example in EXAMPLES], ids=[example[0] for example in EXAMPLES]
)
def test_no_case_of_a_thousand_attacks_exceeds_the_bound(name, changes, tmp_path):
    scenario, whole = bounded(name, changes)
    worst = attacked(scenario, whole, tmp_path, 1000)
    # The attack must be one: of a bound that nobody comes near to it would say nothing.
    assert 0.1 < worst <= 1.0
