"""Whatever is wrong in a scenario, it is refused with one line, or it runs to an outcome."""

from __future__ import annotations

import json
import random
import time
import warnings
from typing import Any

import pytest

from slidax.cli.tables import run_as_json
from slidax.core.errors import DefinitionError
from slidax.scenarios.load import read_description, validate_text
from slidax.scenarios.yaml_text import MOST_VALUES, read_yaml
from slidax.simulation.define import MOST_BYTES

from .mutations import ANY, SUBTLE, loaded, mutated

LONGEST_LINE = 1000
"""Characters; the longest lines list all known kinds."""

SECONDS = 20.0
"""Of processor time, the most that a case may take."""


def survives(seed: str, kinds: tuple[str, ...], *, simulated: bool = False) -> str:
    """How far one mutated scenario comes; a message that is no line, or any other error, fails."""
    chance = random.Random(seed)
    name, base = chance.choice(list(loaded().items()))
    data, mistakes = mutated(base, chance, kinds)
    before, stage, line = time.process_time(), "parsed", ""
    try:
        description = validate_text(data)
        stage = "built"
        scenario = description.build(name)
        if simulated and scenario.t1 / scenario.period < 200:
            stage = "simulated"
            json.dumps(run_as_json(scenario, scenario.simulate(log_every=None), 0.0), allow_nan=False)
    except DefinitionError as refusal:
        line, stage = str(refusal), f"refused before it was {stage}"
    except Exception as error:
        raise AssertionError(f"seed {seed!r}, {name} with {mistakes}: {type(error).__name__}: {error}") from error
    assert len(line) <= LONGEST_LINE, (seed, name, mistakes)
    if not simulated:
        assert time.process_time() - before < SECONDS, (seed, name, mistakes)
    return stage


def survivors(label: str, cases: int, kinds: tuple[str, ...], *, simulated: bool = False) -> set[str]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {survives(f"{label} {case}", kinds, simulated=simulated) for case in range(cases)}


def test_a_mutated_scenario_is_refused_in_a_line_or_built() -> None:
    found = survivors("daily", 60, ANY)
    assert found == {"refused before it was parsed", "refused before it was built", "built"}


@pytest.mark.full
def test_thousands_of_mutated_scenarios_are_refused_in_a_line_or_built() -> None:
    survivors("full", 4000, ANY)
    survivors("subtle", 1000, SUBTLE)


@pytest.mark.full
def test_mutated_scenarios_that_are_built_run_to_an_outcome() -> None:
    assert "simulated" in survivors("runs", 150, SUBTLE, simulated=True)


def changed(**values: Any) -> Any:
    changes = {path.replace("__", "."): value for path, value in values.items()}
    return validate_text(read_description("example-4.1-1khz").model_dump(exclude_none=True), changes).build("changed")


MANY = [0.5] * 200_000

HUGE: dict[str, dict[str, Any]] = {
    "`ExponentialSum.rates` must be at most": {"trajectory__rates": MANY[:1000]},
    "start.q: must have one entry for each": {"start__q": MANY},
    "k1` has shape": {"scheme__surface__k1": MANY},
    "waypoints.0: must have one position": {
        "trajectory": {"kind": "quintic", "waypoints": [MANY, MANY], "velocity": 1.0, "acceleration": 1.0}
    },
    "waypoints` must be at most": {
        "trajectory": {"kind": "minimum_jerk", "times": [0.0, 1.0], "waypoints": [[0.0, 0.0]] * 20_000}
    },
    "Sum.terms` must be at most": {
        "disturbance__terms": [{"kind": "harmonic", "amplitude": [1.0, 1.0], "frequency": 1.0}] * 1000
    },
}


@pytest.mark.full
@pytest.mark.parametrize("words", HUGE)
def test_a_list_that_is_too_long_is_refused_before_much_is_made_of_it(words: str) -> None:
    before = time.process_time()
    with pytest.raises(DefinitionError) as caught:
        changed(**HUGE[words])
    assert words in str(caught.value) and len(str(caught.value)) < 300
    assert time.process_time() - before < SECONDS


def test_an_outage_that_begins_after_any_run_is_none() -> None:
    changed(sensor__loss={"outages": [{"start": 1e308, "samples": 3}]})


def test_a_run_of_too_many_samples_is_refused_with_their_number() -> None:
    with pytest.raises(DefinitionError, match=r"`t1` must be at most 1e\+09 periods of 0\.001 s.*got 1e\+12"):
        changed(simulation__t1=1e9).simulate(log_every=None)


def test_a_log_that_no_memory_holds_is_refused_with_its_size_and_the_remedy() -> None:
    scenario = changed(simulation__t1=1e5)
    with pytest.raises(DefinitionError, match=r"the log of 100000001 samples would take .* GB.*log one in (\d+)"):
        scenario.simulate(log_every=1)
    assert MOST_BYTES <= 10**9


def test_aliases_count_as_what_they_stand_for() -> None:
    half = ", ".join(["1"] * 500)
    assert len(read_yaml(f"a: &a [{half}]\nb: [{', '.join(['*a'] * 100)}]")["b"]) == 100
    with pytest.raises(DefinitionError, match=str(MOST_VALUES)):
        read_yaml(f"a: &a [{half}]\nb: [{', '.join(['*a'] * 600)}]")
