"""Every scheme can be named in a scenario, and naming another one keeps what belongs to the task and the arm."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest

from slidax import controllers, scenarios
from slidax._errors import DefinitionError
from slidax.controllers import SlidingMode
from slidax.scenarios.load import read_yaml
from slidax.scenarios.switch import SCHEMES, switched
from tests.rivals import (
    AROUND_4_1,
    anftsmc_4_2,
    computed_torque_4_1,
    ftsmc_4_1,
    ftsmppc_4_1,
    gravity_pd_4_1,
    nftsmc_4_2,
    sfsmc_4_2,
    slotine_li_4_1,
)

DOCUMENTED = Path(__file__).parents[2] / "docs" / "scenarios.md"
OTHERS = [name for name in SCHEMES if name != "cftsmppc"]

BY_HAND = [
    ("example-4.1", "ftsmc", {}, ftsmc_4_1()),
    ("example-4.1", "ftsmppc", {}, ftsmppc_4_1()),
    ("example-4.2", "sfsmc", {"scheme.bound.velocity": 2.2}, sfsmc_4_2()),
    ("example-4.2", "nftsmc", {}, nftsmc_4_2()),
    ("example-4.2", "anftsmc", {}, anftsmc_4_2()),
    ("example-4.1", "computed_torque", {}, computed_torque_4_1()),
    ("example-4.1", "gravity_pd", {}, gravity_pd_4_1()),
    ("example-4.1", "slotine_li", {"scheme.damping": [20, 10], "scheme.gain": [20, 15]}, slotine_li_4_1()),
]


@pytest.mark.parametrize(("scenario", "name", "changes", "by_hand"), BY_HAND, ids=[case[1] for case in BY_HAND])
def test_a_scheme_by_name_is_the_one_of_the_papers_tables(
    scenario: str, name: str, changes: dict[str, Any], by_hand: Any
) -> None:
    built = scenarios.load(scenario, {"scheme.name": name, **changes}).controller
    assert eqx.tree_equal(built, by_hand, typematch=False)


@pytest.mark.parametrize("example", ["example-4.1", "example-4.2"])
@pytest.mark.parametrize("name", OTHERS)
def test_any_scheme_can_take_the_place_of_the_files_and_runs(example: str, name: str) -> None:
    scenario = scenarios.load(example, {"scheme.name": name, "simulation.t1": 0.02, "simulation.mode": "held"})
    assert scenario.scheme == name
    run = scenario.simulate(log_every=None)
    assert run.outcome.ok
    assert np.all(np.isfinite(run.tally.peak_torque))


@pytest.mark.parametrize("name", ["ftsmppc", "sfsmppc", "slotine_li_ppc"])
def test_the_envelope_goes_along_to_every_scheme_that_has_one(name: str) -> None:
    changes = {"scheme.name": name, "scheme.performance.final": 0.003}
    transformation = scenarios.load("example-4.1", changes).controller.transformation
    wanted = eqx.tree_at(lambda p: p.performance.final, AROUND_4_1, np.asarray(0.003))
    for a, b in zip(jax.tree.leaves(transformation), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", ["ftsmc", "sfsmc"])
def test_a_scheme_without_an_envelope_drops_the_files_and_what_its_bound_has_not(name: str) -> None:
    controller = scenarios.load("example-4.1", {"scheme.name": name}).controller
    assert isinstance(controller, SlidingMode)
    assert float(controller.bound.b1) == 0.0
    assert float(controller.bound.b0) == 12.0
    assert jax.tree.leaves(controller.transformation) == []


def test_the_other_changes_of_the_scheme_come_after_the_switch_in_any_order() -> None:
    changes = {"scheme.surface.k1": 2.0, "scheme.name": "ftsmc", "scheme.reaching.layer": 0.05}
    for order in (changes, dict(reversed(changes.items()))):
        controller = scenarios.load("example-4.1", order).controller
        assert isinstance(controller, SlidingMode)
        assert eqx.tree_equal(controller, ftsmc_4_1(k1=2.0, layer=0.05), typematch=False)


def test_naming_the_files_own_scheme_changes_nothing() -> None:
    changes = {"scheme.surface.k1": 0.3}
    plain, named = (
        scenarios.load("example-4.1", c).controller for c in (changes, {"scheme.name": "cftsmppc"} | changes)
    )
    assert eqx.tree_equal(plain, named)


def test_the_switch_does_not_touch_the_mapping_it_is_given() -> None:
    scheme = {"name": "cftsmppc", "overshoot": 0.2, "surface": {"k1": 1.0}, "bound": {"position": 2.2, "margin": 1.0}}
    assert switched(scheme, "ftsmc") == {"name": "ftsmc", "bound": {"margin": 1.0}}
    assert switched(scheme, "ftsmppc") == {"name": "ftsmppc", "overshoot": 0.2, "bound": scheme["bound"]}
    assert switched(scheme, "computed_torque") == {"name": "computed_torque"}
    assert scheme["surface"] == {"k1": 1.0}
    assert scheme["bound"] == {"position": 2.2, "margin": 1.0}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scheme.name": "ftsm"}, r"scheme.name: unknown `ftsm`; did you mean `ftsmc`\?"),
        ({"scheme.name": ["ftsmc"]}, r"scheme"),
        ({"scheme.name": "ftsmc", "scheme.surfce.k1": 1.0}, r"^scheme: unknown key `surfce`; did you mean `surface`\?"),
        ({"scheme.name": "ftsmc", "scheme.bound.position": 1.0}, r"^scheme.bound: unknown key `position`"),
        ({"scheme.name": "ftsmc", "scheme.overshoot": 0.2}, r"^scheme: unknown key `overshoot`"),
        ({"scheme.name": "anftsmc", "scheme.alpha": 0.2}, r"the .2 of Table 2 is singular"),
        ({"scheme.name": "ftsmc", "scheme.bound": {}}, r"scheme.bound.inertia_min: is missing"),
        ({"scheme": 3, "scheme.name": "ftsmc"}, r"^scheme: .*got 3"),
    ],
)
def test_what_cannot_be_is_refused_with_its_path(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(DefinitionError, match=message):
        scenarios.load("example-4.1", changes)


def test_the_documented_rows_of_table_2_are_the_rivals_of_example_4_2() -> None:
    rows = read_yaml(DOCUMENTED.read_text(encoding="utf-8").split("```yaml\n")[2].split("```")[0])
    by_hand = {"nftsmc": nftsmc_4_2(), "anftsmc": anftsmc_4_2(), "sfsmc": sfsmc_4_2()}
    assert [row["name"] for row in rows] == list(by_hand)
    for row in rows:
        built = scenarios.load("example-4.2", {"scheme": row}).controller
        assert eqx.tree_equal(built, by_hand[row["name"]], typematch=False)


def test_every_recipe_and_every_scheme_class_has_a_name_in_scenarios() -> None:
    families = {"SlidingMode", "AbstractController", "Integral"}
    public = {name for name, thing in vars(controllers).items() if callable(thing) and not inspect.ismodule(thing)}
    built = {type(scenarios.load("example-4.1", {"scheme.name": name}).controller).__name__ for name in SCHEMES}
    # A form of other schemes, and not a scheme of its own: the block `sampled_data` in theirs.
    forms = {"sampled_data", "SampledData", "Recovery"}
    recipes = {name for name in public - forms if name.islower()}
    assert recipes <= set(SCHEMES)
    assert {name for name in public - families - forms if not name.islower()} <= built
    sampled = scenarios.load("example-4.1-1khz").controller
    assert {type(sampled).__name__, type(sampled.recovery).__name__} <= forms


def test_the_catalogue_has_a_line_for_every_scheme() -> None:
    lines = scenarios.catalogue()["schemes"]
    assert list(lines) == list(SCHEMES)
    assert all(len(line) > 15 for line in lines.values())
    assert len(set(lines.values())) == len(lines)
