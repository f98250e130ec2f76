"""Every scheme can be named in a scenario, and naming another one keeps what belongs to the task and the arm."""

import inspect
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

from slidax import law as controllers
from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.law import Linear, PrescribedPerformance, Preset, SampledData, SingularityFree, SlidingMode, SuperTwisting
from slidax.scenarios.load import alter
from slidax.scenarios.schemes import SCHEMES, switch_scheme
from slidax.scenarios.yaml_text import read_yaml
from tests.rivals import (
    AROUND_4_1,
    anftsmc_4_2,
    computed_torque_4_1,
    ftsmc_4_1,
    ftsmppc_4_1,
    gravity_pd_4_1,
    nftsmc_4_2,
    pid_4_1,
    sfsmc_4_2,
    slotine_li_4_1,
)

DOCUMENTED = Path(__file__).parents[2] / "docs" / "scenarios.md"
OTHERS = [name for name in SCHEMES if name not in ("cftsmppc", "sliding_mode")]
"""All schemes except that of the files and `sliding_mode`, whose parts must all be named."""

BY_HAND = [
    ("example-4.1", "ftsmc", {}, ftsmc_4_1()),
    ("example-4.1", "ftsmppc", {}, ftsmppc_4_1()),
    ("example-4.2", "sfsmc", {"scheme.bound.b2": 2.2}, sfsmc_4_2()),
    ("example-4.2", "nftsmc", {}, nftsmc_4_2()),
    ("example-4.2", "anftsmc", {}, anftsmc_4_2()),
    ("example-4.1", "computed_torque", {}, computed_torque_4_1()),
    ("example-4.1", "gravity_pd", {}, gravity_pd_4_1()),
    ("example-4.1", "pid", {"actuator.torque": 60.0, "simulation.mode": "held"}, pid_4_1(limit=60.0)),
    ("example-4.1", "slotine_li", {"scheme.damping": [20, 10], "scheme.gain": [20, 15]}, slotine_li_4_1()),
]


@pytest.mark.parametrize(("scenario", "name", "changes", "by_hand"), BY_HAND, ids=[case[1] for case in BY_HAND])
def test_a_scheme_chosen_by_name_has_the_parameters_of_the_papers_tables(scenario, name, changes, by_hand):
    built = scenarios.load(scenario, {"scheme.name": name, **changes}).controller
    assert eqx.tree_equal(built, by_hand, typematch=False)


PLACES = [
    pytest.param(f"example-4.{1 + (k + other) % 2}", name, marks=[pytest.mark.full] * other)
    for k, name in enumerate(OTHERS)
    for other in (0, 1)
]
"""Every scheme in both examples; daily tests run it in one of them, alternating."""


@pytest.mark.parametrize(("example", "name"), PLACES)
def test_any_scheme_can_replace_the_files_scheme_and_runs(example, name):
    scenario = scenarios.load(example, {"scheme.name": name, "simulation.t1": 0.02, "simulation.mode": "held"})
    assert scenario.scheme == name
    run = scenario.simulate(log_every=None)
    assert run.outcome.ok and np.all(np.isfinite(run.tally.peak_torque))


@pytest.mark.parametrize("name", ["ftsmppc", "sfsmppc", "slotine_li_ppc"])
def test_the_envelope_is_passed_on_to_every_scheme_with_an_envelope(name):
    changes = {"scheme.name": name, "scheme.performance.final": 0.003}
    transformation = scenarios.load("example-4.1", changes).controller.transformation
    wanted = eqx.tree_at(lambda p: p.performance.final, AROUND_4_1, np.asarray(0.003))
    assert eqx.tree_equal(transformation, wanted)


@pytest.mark.parametrize("name", ["ftsmc", "sfsmc"])
def test_a_scheme_without_an_envelope_drops_the_files_envelope_and_unknown_bound_fields(name):
    controller = scenarios.load("example-4.1", {"scheme.name": name}).controller
    assert isinstance(controller, SlidingMode) and float(controller.bound.b1) == 0.0
    assert float(controller.bound.b0) == 12.0 and jax.tree.leaves(controller.transformation) == []


def test_parameter_changes_apply_after_the_change_of_scheme_in_any_order():
    changes = {"scheme.surface.k1": 2.0, "scheme.name": "ftsmc", "scheme.reaching.layer": 0.05}
    for order in (changes, dict(reversed(changes.items()))):
        controller = scenarios.load("example-4.1", order).controller
        assert isinstance(controller, SlidingMode)
        assert eqx.tree_equal(controller, ftsmc_4_1(k1=2.0, layer=0.05), typematch=False)


def test_naming_the_files_own_scheme_changes_nothing():
    changes = {"scheme.surface.k1": 0.3}
    plain, named = (
        scenarios.load("example-4.1", c).controller for c in (changes, {"scheme.name": "cftsmppc"} | changes)
    )
    assert eqx.tree_equal(plain, named)


def test_switching_the_scheme_returns_a_new_mapping_of_the_settings_that_the_new_scheme_supports():
    scheme = {"name": "cftsmppc", "overshoot": 0.2, "surface": {"k1": 1.0}, "bound": {"b1": 2.2, "margin": 1.0}}
    assert switch_scheme(scheme, "ftsmc") == {"name": "ftsmc", "bound": {"margin": 1.0}}
    kept = {"transformation": {"overshoot": 0.2}, "bound": scheme["bound"]}
    assert switch_scheme(scheme, "ftsmppc") == {"name": "ftsmppc", **kept}
    assert switch_scheme(scheme, "computed_torque") == {"name": "computed_torque"}
    assert scheme["surface"] == {"k1": 1.0} and scheme["bound"] == {"b1": 2.2, "margin": 1.0}


SHRINKING = {"kind": "exponential", "initial": 0.9, "final": 0.01, "rate": 1.0}
COMPOSED = {
    "another surface in the envelope": (
        {"scheme.surface.kind": "linear", "scheme.surface.rate": 0.6},
        lambda law: isinstance(law, SlidingMode) and isinstance(law.surface, Linear),
    ),
    "another reaching law": (
        {"scheme.reaching": {"kind": "two_power", "k1": 5.0, "k2": 5.0, "v1": 2.5, "v2": 0.5, "layer": 0.05}},
        lambda law: float(law.reaching.v1) == 2.5,
    ),
    "another bound": ({"scheme.bound": {"kind": "fixed", "size": 30.0}}, lambda law: float(law.bound.size) == 30.0),
    "another envelope": (
        {"scheme.performance": SHRINKING},
        lambda law: float(law.transformation.performance.rate) == 1.0,
    ),
    "super-twisting in an envelope": (
        {"scheme": {"name": "super_twisting", "performance": SHRINKING, "overshoot": 0.2, "rate": 0.6}},
        lambda law: isinstance(law, SuperTwisting) and isinstance(law.transformation, PrescribedPerformance),
    ),
    "the same with every part where it belongs": (
        {
            "scheme": {
                "name": "super_twisting",
                "transformation": {"kind": "prescribed_performance", "performance": SHRINKING, "overshoot": 0.2},
                "surface": {"kind": "singularity_free", "c1": 0.2, "c2": 0.6, "alpha": 0.7, "beta": 1.2, "r": 1.7}
                | {"delta": 0.3},
            }
        },
        lambda law: isinstance(law.surface, SingularityFree) and law.envelope is not None,
    ),
    "all parts by name": (
        {
            "scheme": {
                "name": "sliding_mode",
                "transformation": {"kind": "unconstrained"},
                "surface": {"kind": "linear", "rate": 5.0},
                "reaching": {"kind": "fixed_time", "gain": 0.1, "exponent": 1.2, "layer": 0.05},
                "bound": {"kind": "fixed", "size": 30.0},
            }
        },
        lambda law: isinstance(law, SlidingMode) and isinstance(law.surface, Linear),
    ),
}


@pytest.mark.parametrize(("changes", "holds"), COMPOSED.values(), ids=COMPOSED)
def test_a_scenario_file_composes_a_controller_from_named_parts(changes, holds):
    short = {"simulation.t1": 0.02, "simulation.mode": "held"}
    scenario = scenarios.load("example-4.1", {**changes, **short})
    assert holds(scenario.controller) and scenario.simulate(log_every=None).outcome.ok


def test_the_short_path_of_an_envelope_parameter_builds_the_same_law():
    short, whole = (
        scenarios.load("example-4.1", {f"scheme.{path}": 0.01}).controller
        for path in ("performance.final", "transformation.performance.final")
    )
    assert eqx.tree_equal(short, whole)


def test_a_scheme_without_a_plan_drops_the_settings_of_a_plan():
    plans = {"scheme.sampled_data.calm": True, "scheme.sampled_data.horizon": 0.02}
    law = alter(scenarios.load("panda-payload", plans), {"scheme.name": "computed_torque"}).controller
    assert isinstance(law, SampledData) and law.horizon is None


def test_a_preset_is_the_same_in_python_and_in_a_file():
    file = scenarios.load("example-4.1", {"scheme.k1": 0.3, "scheme.layer": 0.01}).controller
    options = {"performance": AROUND_4_1.performance, "overshoot": 0.2, "bound": file.bound}
    assert eqx.tree_equal(controllers.cftsmppc(file.nominal, k1=0.3, layer=0.01, **options), file)
    mapped = controllers.cftsmppc(file.nominal, surface={"k1": 0.3}, reaching={"layer": 0.01}, **options)
    assert eqx.tree_equal(mapped, file)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"overshot": 1.0}, r"the law has no parameter or part `overshot`; did you mean `overshoot`"),
        ({}, r"transformation: `PrescribedPerformance` needs `performance` and `overshoot`"),
        ({"k1": -1.0, "transformation": AROUND_4_1}, r"surface: `SmoothFixedTime.k1` must be > 0.*got -1"),
        ({"surface": Linear(1.0), "k1": 1.0}, r"`k1` is a parameter of `surface`, which the call replaces as well"),
    ],
)
def test_a_preset_with_invalid_arguments_is_refused(options, message):
    nominal = scenarios.load("example-4.1").controller.nominal
    with pytest.raises(DefinitionError, match=message):
        controllers.cftsmppc(nominal, **options)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scheme.name": "ftsm"}, r"scheme.name: unknown `ftsm`; did you mean `ftsmc`\?"),
        ({"scheme.name": ["ftsmc"]}, r"^scheme.name: unknown `\['ftsmc'\]`; did you mean `ftsmc`\?"),
        ({"scheme.name": "ftsmc", "scheme.surfce.k1": 1.0}, r"^scheme: unknown key `surfce`; did you mean `surface`\?"),
        ({"scheme.name": "ftsmc", "scheme.bound.potition": 1.0}, r"^scheme.bound: unknown key `potition`"),
        ({"scheme.name": "ftsmc", "scheme.overshoot": 0.2}, r"^scheme.transformation.performance: is missing"),
        ({"scheme.surface.kind": "linar"}, r"^scheme.surface.kind: unknown `linar`; did you mean `linear`\?"),
        ({"scheme.surface.kind": "linear"}, r"^scheme.surface.rate: is missing"),
        ({"scheme.name": "anftsmc", "scheme.alpha": 0.2}, r"the 0\.2 of Table 2 is singular"),
        ({"scheme": 3, "scheme.name": "ftsmc"}, r"^scheme: .*got 3"),
    ],
)
def test_an_invalid_scheme_is_refused_with_its_path(changes, message):
    with pytest.raises(DefinitionError, match=message):
        scenarios.load("example-4.1", changes)


def test_the_documented_schemes_of_table_2_match_the_papers_parameters():
    text = "- name" + DOCUMENTED.read_text(encoding="utf-8").split("```yaml\n- name")[1].split("```")[0]
    rows = read_yaml(text)
    by_hand = {"nftsmc": nftsmc_4_2(), "anftsmc": anftsmc_4_2(), "sfsmc": sfsmc_4_2()}
    assert [row["name"] for row in rows] == list(by_hand)
    for row in rows:
        built = scenarios.load("example-4.2", {"scheme": row}).controller
        assert eqx.tree_equal(built, by_hand[row["name"]], typematch=False)


def test_every_controller_class_belongs_to_a_preset_scheme():
    laws = {
        thing
        for thing in vars(controllers).values()
        if inspect.isclass(thing)
        and issubclass(thing, controllers.AbstractController)
        and not inspect.isabstract(thing)
    }
    presets = {name: thing for name, thing in vars(controllers).items() if isinstance(thing, Preset)}
    assert sorted(presets) == list(SCHEMES)
    # `SampledData` is no scheme but a form of the others, described by their block `sampled_data`.
    assert {preset.law for preset in presets.values()} == laws - {controllers.SampledData}


def test_the_catalogue_has_a_line_for_every_scheme():
    lines = scenarios.catalogue()["schemes"]
    assert list(lines) == list(SCHEMES) and all(len(line) > 15 for line in lines.values())
    assert len(set(lines.values())) == len(lines)
