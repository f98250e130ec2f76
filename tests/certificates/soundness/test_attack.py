"""No error of two links of our own around the exported law exceeds its bound, in cases that are chosen to break it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.certificates.loop.proved import Proved, proved
from slidax.certificates.loop.subject import Subject
from slidax.scenarios import Scenario, load
from tests.deploy.exported import needs_a_compiler

from .attack import Attacked

NAME = "example-4.1-1khz"
WITHOUT = {"scheme.sampled_data.adaptation": None}
MASSES = {"robot.plant.masses": {"around": "10 %", "each": "joint"}}
INERTIAS = {"robot.plant.inertias": {"around": "8 %", "each": "joint"}}
RIPPLE = {"kind": "harmonic", "amplitude": [0.0, 0.0], "frequency": 6283.185307179586, "phase": 1.0}

DESIGNED = Path(__file__).with_name("two-link.yaml")
"""What `slidax design examples/design/two-link.yaml` wrote."""

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


def attacked(scenario: Scenario, whole: Proved, folder: Path, cases: int, seed: int = 0) -> float:
    """The largest share of the bound that a search for the worst case comes to."""
    assert whole.bounds is not None
    first = whole.entry.sample + int(whole.assembly.subject.dead_time)
    return Attacked(scenario, folder).worst(whole.bounds.error, first, cases, seed)


def bounded(name: str | Path, changes: dict[str, Any]) -> tuple[Scenario, Proved]:
    scenario = load(name, changes)
    subject = Subject.of(scenario)
    assert isinstance(subject, Subject)
    whole = proved(subject)
    assert isinstance(whole, Proved) and whole.holds
    return scenario, whole


@needs_a_compiler
def test_the_plant_of_the_attacks_gives_the_errors_of_a_run(tmp_path: Path) -> None:
    scenario = load(NAME, {"uncertainty": MASSES, "simulation.t1": 0.5})
    other = Attacked(scenario, tmp_path)
    ours = np.asarray(scenario.simulate(log_every=1, progress=False).log.e)[: other.samples]
    np.testing.assert_allclose(other.errors(np.full((1, 2), 0.5))[0], ours, atol=1e-9)


@needs_a_compiler
@pytest.mark.full
@pytest.mark.parametrize(("name", "changes"), [one[1:] for one in EXAMPLES], ids=[one[0] for one in EXAMPLES])
def test_no_case_of_a_thousand_that_are_chosen_to_break_it_exceeds_the_bound(
    name: str | Path, changes: dict[str, Any], tmp_path: Path
) -> None:
    scenario, whole = bounded(name, changes)
    worst = attacked(scenario, whole, tmp_path, 1000)
    # The attack must be one: of a bound that nobody comes near to it would say nothing.
    assert 0.1 < worst <= 1.0
