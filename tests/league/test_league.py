"""The league as a whole, small: a few matches of each kind, kept, gone on with, and shown."""

import json
import re

import numpy as np
import pytest

from slidax._errors import DefinitionError
from slidax.league import Entry, Season, entries, forms_of, names, task, write_league
from slidax.league.gains import gains_of
from slidax.league.match import drawn
from slidax.scenarios.family import Family
from slidax.scenarios.schemes import PRESETS

STIFF = "tests.league.entered:stiffer"

TASK = "scara-slow"


@pytest.fixture(scope="module")
def season():
    return Season({TASK: task(TASK)}, [*entries(["pid"], [STIFF], ("printed",))]).small()


@pytest.fixture(scope="module")
def results(season, tmp_path_factory):
    out = tmp_path_factory.mktemp("league")
    return season.played(out, 0), out


def test_every_arm_of_the_package_has_a_task_and_what_is_hard_is_there():
    tasks = [task(name) for name in names()]
    arms = {one.scenario["robot"]["kind"] for one in tasks}
    assert arms == {"two_link", "scara", "panda", "ur5e", "iiwa14", "xarm7", "gen3"}
    about = {word for one in tasks for word in one.about}
    assert {"payload", "friction", "rotors", "delay", "encoders", "pushes", "contact", "point to point"} <= about
    for one in tasks:
        assert one.training.seed != one.held_out.seed and one.held_out.cases >= 200


FITTING = [
    pytest.param(name, ["cftsmppc"] if daily else None, marks=[] if daily else [pytest.mark.full])
    for name in names()
    for daily in (True, False)
] + [pytest.param(TASK, None, id="all of them")]


@pytest.mark.parametrize(("name", "schemes"), FITTING)
def test_every_scheme_fits_every_task_in_both_forms_with_the_same_tolerance(name, schemes):
    asked = task(name)
    for entry in entries(schemes):
        base = entry.described(asked)
        assert base.tolerance is not None
        envelope = base.scheme.model_dump().get("transformation")
        if envelope is not None and "performance" in envelope:
            assert {"performance", "overshoot"} <= envelope.keys()
            assert {key: envelope[key] for key in ("performance", "overshoot")} == base.tolerance.model_dump()
        assert (base.scheme.sampled_data is not None) == (entry.form == "sampled-data")
        assert entry.gains().sets(base)


def test_all_complete_schemes_take_part_and_what_is_tuned_is_listed():
    assert {entry.scheme for entry in entries()} == {name for name, preset in PRESETS.items() if preset.complete}


def test_the_cases_of_training_and_those_held_out_share_none():
    asked = task(TASK)
    family = Family.of(Entry("pid", "printed").described(asked), asked.uncertainty)
    seen, held = (drawn(family, cases)["start.q"] for cases in (asked.training, asked.held_out))
    assert not np.isclose(seen[:, None], held[None]).all(axis=2).any()


def test_a_season_is_played_kept_and_not_played_again(results, season):
    played, out = results
    assert len(played.matches) == 2 and not any(isinstance(one, str) for one in played.matches.values())
    for (_, entry), match in played.matches.items():
        assert match.inside.shape == match.metrics["steady_error"].shape == (8,)
        assert set(match.gains) == {f"scheme.{path}" for path in entry.gains().tuned}
    again = season.played(out, 0, lambda *_: pytest.fail("it was played again"))
    for which, match in played.matches.items():
        np.testing.assert_array_equal(again.matches[which].inside, match.inside)
        for name, values in match.metrics.items():
            np.testing.assert_array_equal(again.matches[which].metrics[name], values)
    one = next((out / "matches").rglob("*.json"))
    one.write_text(one.read_text().replace('"version": 1', '"version": 0'))
    asked = []
    season.played(out, 0, lambda *which: asked.append(which))
    assert len(asked) == 1


def test_the_page_stands_alone_and_the_table_names_versions_and_the_command(results):
    played, out = results
    page = write_league(played, out, seconds=1.0, command="slidax league --small").read_text(encoding="utf-8")
    assert not re.findall(r"https?://|\ssrc=|<link|<script", page)
    assert page.count("<figure") == 1 and "nan" not in page.lower().replace("nanometre", "")
    table = (out / "league.md").read_text(encoding="utf-8")
    assert "`stiffer`" in table and f"- `{TASK}`: " in table and "slidax league --small" in table and "jax" in table
    found = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert {one["scheme"] for one in found["tasks"][TASK]["schemes"]} == {"pid", STIFF}


def test_of_a_scheme_from_elsewhere_every_positive_number_is_tuned_around_its_own():
    entry = Entry(STIFF, "sampled-data")
    tuned = gains_of(STIFF, entry.preset, entry.form).tuned
    assert set(tuned) == {"kp", "kd", "damping"}
    assert tuned["kp"].between == (30.0, 27000.0) and tuned["kp"].times == "nothing"
    assert tuned["damping"].times == "inertia"
    assert entry.described(task("panda-payload")).scheme.name == "stiffer"


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda: entries(["cftsmpc"]), "cftsmppc"),
        (lambda: entries([], ["tests.league.entered:Missing"]), "cannot import"),
        (lambda: entries([], ["no.such.module:Law"]), "cannot import"),
        (lambda: entries([], ["tests.league.entered:NOT_A_SCHEME"]), "neither a `Preset` nor the class of a law"),
        (lambda: forms_of("sampled"), "sampled-data"),
        (lambda: task("scara-slwo"), "scara-slow"),
    ],
)
def test_what_is_not_there_is_said_in_one_line(ask, said):
    with pytest.raises(DefinitionError, match=said) as refused:
        ask()
    assert "\n" not in str(refused.value)
