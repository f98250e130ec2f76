"""An independent two-link plant around the exported law does not exceed the bound, in cases chosen to break it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.certify.loop.problem import LoopProblem
from slidax.certify.loop.set_bound import SetBound, set_bound
from slidax.scenarios import Scenario, load
from tests.export.exported import needs_a_compiler

from .attack import Attacked

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
def test_independent_plant_reproduces_the_errors_of_a_run(tmp_path: Path) -> None:
    scenario = load(NAME, {"uncertainty": MASSES, "simulation.t1": 0.5})
    other = Attacked(scenario, tmp_path)
    ours = np.asarray(scenario.simulate(log_every=1, progress=False).log.e)[: other.samples]
    np.testing.assert_allclose(other.errors(np.full((1, 2), 0.5))[0], ours, atol=1e-9)


@needs_a_compiler
@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "changes"), [example[1:] for example in EXAMPLES], ids=[example[0] for example in EXAMPLES]
)
def test_no_case_of_a_thousand_attacks_exceeds_the_bound(
    name: str | Path, changes: dict[str, Any], tmp_path: Path
) -> None:
    scenario, whole = bounded(name, changes)
    worst = attacked(scenario, whole, tmp_path, 1000)
    # The attack must be one: of a bound that nobody comes near to it would say nothing.
    assert 0.1 < worst <= 1.0
