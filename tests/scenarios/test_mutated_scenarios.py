"""A mutated scenario is refused with a short message, or it runs to an outcome."""

import copy
import datetime
import functools
import json
import math
import random
import time
import warnings
from collections.abc import Iterator
from typing import Any

import pytest

from slidax.cli.tables import run_as_json
from slidax.core.errors import DefinitionError, DefinitionWarning
from slidax.scenarios import names
from slidax.scenarios.load import read_description, validate_text
from slidax.scenarios.yaml_text import MOST_VALUES, read_yaml
from slidax.simulation.define import MOST_BYTES

CSV = "time,shoulder,elbow\n0,-0.4,2.5\n1,0,1.5\n2,1.25,1.25\n"
ROS = (
    '{"joint_names": ["shoulder", "elbow"], "points": ['
    '{"positions": [-0.4, 2.5], "time_from_start": {"sec": 0, "nanosec": 0}}, '
    '{"positions": [1.25, 1.25], "time_from_start": 2}]}'
)
WAYPOINTS = [[-0.4, 2.5], [0.0, 1.5], [1.25, 1.25]]

TRAJECTORIES: tuple[dict[str, Any], ...] = (
    {"kind": "constant", "value": [-0.4, 2.5]},
    {"kind": "sinusoid", "offset": [-0.4, 2.5], "amplitude": [0.5, 0.5], "frequency": [1.0, 1.0], "phase": [0.0, 0.0]},
    {"kind": "minimum_jerk", "times": [0.0, 1.0, 2.0], "waypoints": WAYPOINTS},
    {
        "kind": "quintic",
        "waypoints": WAYPOINTS,
        "velocity": 2.0,
        "acceleration": [5.0, 5.0],
        "jerk": 50.0,
        "start": 0.0,
    },
    {"kind": "trapezoidal", "waypoints": WAYPOINTS, "velocity": 2.0, "acceleration": 5.0, "jerk": 50.0, "start": 0.0},
    {"kind": "csv", "text": CSV, "joints": ["shoulder", "elbow"], "start": 0.0, "velocity": 50.0, "lower": -9.0},
    {"kind": "joint_trajectory", "text": ROS, "upper": [9.0, 9.0], "acceleration": 500.0},
)

ESTIMATORS: tuple[dict[str, Any], ...] = (
    {"kind": "measured", "gain": 0.5, "trend": 0.1},
    {"kind": "kalman", "torque_density": 1.0, "variance": [1e-8, 1e-8]},
    {"kind": "filtered_difference", "cutoff": 300.0},
    {"kind": "robust_differentiator", "lipschitz": 100.0},
)

SENSOR = {
    "resolution": 1e-5,
    "position_noise": [1e-6, 1e-6],
    "velocity_noise": 1e-4,
    "delay": 1.0,
    "jitter": 0.2,
    "loss": {"probability": 0.01, "outages": [{"start": 0.005, "samples": 2}]},
    "seed": 3,
}

NUMBERS = (
    *(0, -1, 1, 2, 3, 7, 0.0, -0.0, 0.5, 1e-3, -1e-3, 1e6, 1e12, 1e-12, 1e154, 1e308, -1e308, 5e-324),
    *(math.nan, math.inf, -math.inf, 10**12, 2**31, 2**32, 2**63, 2**64, -(2**63) - 1, 10**30, 10**400),
)

OTHERS = (
    *(None, True, False, "", " ", "robot", "1e-3", "nan", "ünïcödé ☃ \U0001f9be", "a\nb", "\x00", "a.b", "x" * 5000),
    *([], {}, [[]], [[], []], [[1.0], [1.0, 2.0]], [1.0, "a"], [None, None], [True, False], ["robot"], [[[1.0]]]),
    *({"a": 1}, {1: 2}, {None: 3}, {"kind": "linear"}, {"kind": None}, {"kind": []}, {"kind": {}}, {"name": []}),
    *(datetime.date(2001, 1, 1), datetime.datetime(2001, 1, 1, 1, 1, 1), b"\xff", {1.0, 2.0}, [math.nan, 1.0]),
    *([math.inf, math.inf], [1e308, 1e308], [0, 0], [-1, -1], [10**30, 1]),
)


@functools.cache
def loaded() -> dict[str, dict[str, Any]]:
    """The built-in scenarios with all their values written out, and scenarios with the other trajectories and laws."""
    bases = {name: _written_out(name) for name in names()}
    plain, sampled = bases["example-4.1"], bases["example-4.1-1khz"]
    for motion in TRAJECTORIES:
        bases[f"trajectory {motion['kind']}"] = {**sampled, "trajectory": motion}
    for estimator in ESTIMATORS:
        scheme = {**sampled["scheme"], "sampled_data": {"horizon": 0.012, "estimator": estimator}}
        bases[f"estimator {estimator['kind']}"] = {**sampled, "scheme": scheme, "sensor": SENSOR}
    for scheme in ("ftsmc", "ftsmppc", "sfsmc", "computed_torque", "gravity_pd", "pid", "slotine_li", "super_twisting"):
        bases[f"scheme {scheme}"] = {**plain, "scheme": {"name": scheme}}
    return bases


@functools.cache
def _written_out(name: str) -> dict[str, Any]:
    data = read_description(name).model_dump(exclude_none=True)
    simulation = data["simulation"]
    # Short runs; a motion of joints needs one that is not longer either.
    simulation["t1"] = 20 * simulation["period"]
    return _lists(data)


def _lists(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _lists(child) for key, child in value.items()}
    return [_lists(child) for child in value] if isinstance(value, (list, tuple)) else value


ANY = ("number", "number", "other", "other", "gone", "list", "scaled", "swapped", "unknown", "long")
"""Kinds of mistakes."""

SUBTLE = ("scaled", "scaled", "number", "gone", "list")
"""Kinds of mistakes that may show only in a simulation."""


def mutated(
    data: dict[str, Any], chance: random.Random, kinds: tuple[str, ...] = ANY
) -> tuple[dict[str, Any], list[str]]:
    """A scenario with one to three mistakes, and a list of the mistakes."""
    data = copy.deepcopy(data)
    mistakes = []
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        places = list(_places(data, ()))
        if not places:
            break
        path = chance.choice(places)
        mistakes.append(_mistake(data, path, places, chance, chance.choice(kinds)))
    return data, mistakes


def _places(value: Any, path: tuple[Any, ...]) -> Iterator[tuple[Any, ...]]:
    """The paths of all values, blocks and lists; of a long block or list, those of its first 40 entries."""
    if path:
        yield path
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in list(children)[:40]:
        yield from _places(child, (*path, key))


def _at(data: Any, path: tuple[Any, ...]) -> Any:
    for key in path:
        data = data[key]
    return data


def _mistake(data: Any, path: tuple[Any, ...], places: list[tuple[Any, ...]], chance: random.Random, kind: str) -> str:
    owner, key = _at(data, path[:-1]), path[-1]
    value = owner[key]
    where = ".".join(map(str, path))
    if kind == "gone":
        del owner[key]
        return f"{where} gone"
    if kind == "list":
        new: Any = chance.choice(([value], [value, value], [value, value, value], [[value]], [value, [value]]))
        if isinstance(value, list) and value and chance.random() < 0.7:
            new = chance.choice((value[:-1], [*value, value[-1]], [*value[:-1], [value[-1]]], value[::-1], [value]))
    elif kind == "scaled" and isinstance(value, (int, float)) and not isinstance(value, bool):
        new = value * chance.choice((-1, 0, 1e-9, 1e-3, 0.5, 2, 10, 1e3, 1e9, 1e20, 1e200))
    elif kind == "swapped":
        new = copy.deepcopy(_at(data, chance.choice(places)))
    elif kind == "unknown" and isinstance(value, dict):
        value[chance.choice(("", "x", "Kind", 1, None, "ü", "k1 "))] = chance.choice(OTHERS)
        return f"{where} with an unknown key"
    elif kind == "long":
        new = chance.choice(([0.5] * 1000, [[0.5, 0.5]] * 1000, [[0.5] * 1000], "robot" * 200, _deep(300)))
    elif kind == "other":
        new = copy.deepcopy(chance.choice(OTHERS))
    else:
        new = chance.choice(NUMBERS)
    owner[key] = new
    return f"{where} = {repr(new)[:80]}"


def _deep(levels: int) -> Any:
    return functools.reduce(lambda inner, _: [inner], range(levels), 1.0)


LONGEST_LINE = 1000
"""Characters; the longest lines list all known kinds."""

SECONDS = 20.0
"""Largest processor time of a case [s]."""


def survives(seed: str, kinds: tuple[str, ...], *, simulated: bool = False) -> str:
    """Return the last stage of a mutated scenario. A long message or any other error fails the test."""
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


def test_a_mutated_scenario_is_built_or_refused_with_a_short_message():
    stages = survivors("daily", 60, ANY)
    assert stages == {"refused before it was parsed", "refused before it was built", "built"}


@pytest.mark.full
def test_thousands_of_mutated_scenarios_are_built_or_refused_with_a_short_message():
    survivors("full", 4000, ANY)
    survivors("subtle", 1000, SUBTLE)


@pytest.mark.full
def test_mutated_scenarios_that_are_built_run_to_an_outcome():
    assert "simulated" in survivors("runs", 150, SUBTLE, simulated=True)


def changed(**values: Any) -> Any:
    changes = {path.replace("__", "."): value for path, value in values.items()}
    return validate_text(read_description("example-4.1-1khz").model_dump(exclude_none=True), changes).build("changed")


def test_an_absurdly_large_inverse_inertia_bound_is_refused():
    with pytest.warns(DefinitionWarning, match="more than all drives"), pytest.raises(DefinitionError, match="at most"):
        changed(scheme__bound__inverse_inertia_max=1e200)


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
def test_a_list_that_is_too_long_is_refused_early(words):
    before = time.process_time()
    with pytest.raises(DefinitionError) as caught:
        changed(**HUGE[words])
    assert words in str(caught.value) and len(str(caught.value)) < 300
    assert time.process_time() - before < SECONDS


def test_an_outage_after_the_end_of_a_run_is_accepted():
    changed(sensor__loss={"outages": [{"start": 1e308, "samples": 3}]})


def test_a_run_of_too_many_samples_is_refused_with_their_number():
    with pytest.raises(DefinitionError, match=r"`t1` must be at most 1e\+09 periods of 0\.001 s.*got 1e\+12"):
        changed(simulation__t1=1e9).simulate(log_every=None)


def test_a_log_beyond_the_memory_is_refused_with_its_size_and_the_remedy():
    scenario = changed(simulation__t1=1e5)
    with pytest.raises(
        DefinitionError, match=r"the log of 100000001 samples would take .* GB.*`log_every` (\d+) times"
    ):
        scenario.simulate(log_every=1)
    assert MOST_BYTES <= 10**9


def test_yaml_aliases_count_with_their_expanded_size_towards_the_limit():
    half = ", ".join(["1"] * 500)
    assert len(read_yaml(f"a: &a [{half}]\nb: [{', '.join(['*a'] * 100)}]")["b"]) == 100
    with pytest.raises(DefinitionError, match=str(MOST_VALUES)):
        read_yaml(f"a: &a [{half}]\nb: [{', '.join(['*a'] * 600)}]")
