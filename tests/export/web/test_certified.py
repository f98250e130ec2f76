from functools import cache

import numpy as np
import pytest

from slidax.certify import CERTIFICATES, Verdict
from slidax.certify.certificate import certificate
from slidax.core.errors import DefinitionError
from slidax.export.web import settings as certified
from slidax.export.web.tunables import tunables_of
from slidax.scenarios import Scenario, load
from slidax.scenarios.load import alter

DECLARED = [item for item in CERTIFICATES if item.reads is not None]

SCENARIOS = [
    "example-4.1",
    pytest.param("example-4.1-1khz", marks=pytest.mark.full),
    pytest.param("example-4.2-1khz", marks=pytest.mark.full),
    pytest.param("panda-payload", marks=pytest.mark.full),
]


@cache
def loaded(name):
    return load(name)


@cache
def movable(name):
    scenario = loaded(name)
    described = scenario.description.model_copy(update={"robot": scenario.description.robot.resolved()})
    result = {}
    for tunable in tunables_of(described, scenario.plant.robot.joints):
        own = tunable.defaults if tunable.each else np.asarray(tunable.leaf.own)
        moved = np.where(own == 0.0, 0.3 * tunable.high, own + 0.07 * (tunable.high - own))
        result[tunable.path] = moved.tolist()
    if scenario.description.scheme.sampled_data is not None:
        result["sensor.delay"] = 1.0 - scenario.description.sensor.delay
        result["sensor.resolution"] = 3e-5
    result["simulation.period"] = 0.5 * scenario.period
    return result


def all_but(name, certificate):
    scenario, done = loaded(name), []
    for path, value in movable(name).items():
        if certificate.may_read(path):
            continue
        try:
            scenario = alter(scenario, {path: value})
        except DefinitionError:
            continue
        done.append(path)
    return scenario, done


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("certificate", DECLARED, ids=lambda item: item.name)
def test_a_certificate_depends_on_its_declared_inputs_alone(certificate, name):
    other, moved = all_but(name, certificate)
    assert moved, "nothing was moved, so that nothing was shown"
    assert certificate(other).as_json() == certificate(loaded(name)).as_json()


def test_a_certificate_that_reads_an_undeclared_input_is_detected():
    @certificate("forgetful", "", covers=(), reads=("robot",))
    def forgetful(scenario: Scenario) -> Verdict:
        gain = float(np.max(np.asarray(scenario.controller.surface.k1)))
        return Verdict("forgetful", "", True, gain, {}, (), "")

    other, _ = all_but("example-4.1", forgetful)
    assert forgetful(other).as_json() != forgetful(loaded("example-4.1")).as_json()


def test_a_certificate_without_declared_inputs_depends_on_all(monkeypatch):
    @certificate("fresh", "new", covers=())
    def fresh(scenario: Scenario) -> Verdict:
        return Verdict("fresh", "new", True, 0.5, {"bound": [1.0, 2.0]}, (), "It is so.")

    monkeypatch.setattr(certified, "CERTIFICATES", (fresh,))
    monkeypatch.setattr(certified, "certify", lambda scenario, runs: [fresh(scenario)])
    paths = ["scheme.surface.k1", "robot.plant.masses", "sensor.delay"]
    (light,) = certified.certificates_of(loaded("example-4.1"), paths)
    assert light["reads"] == paths
    assert (light["certificate"], light["title"], light["holds"], light["margin"]) == ("fresh", "new", True, 0.5)


@pytest.mark.full
def test_the_page_shows_the_verdicts_of_slidax_certify():
    scenario = loaded("example-4.1-1khz")
    lights = {
        light["certificate"]: light for light in certified.certificates_of(scenario, list(movable(scenario.name)))
    }
    for each in CERTIFICATES:
        theirs, light = each(scenario), lights[each.name]
        assert (light["holds"], light["statement"], light["title"]) == (theirs.holds, theirs.statement, theirs.title)
        assert light["margin"] == theirs.as_json()["margin"]


def test_note_of_each_law_names_the_envelope_that_judges_it():
    laws = certified.settings_of(
        load("example-4.1-1khz").description, "arm", ["printed", "slotine_li", "slotine_li_ppc"]
    )
    notes = {law.scheme: law.note for law in laws}
    assert notes["cftsmppc"] == certified.OURS and notes["slotine_li"] == certified.WITH + certified.JUDGED
    assert notes["slotine_li_ppc"] == certified.WITH, "it draws an envelope of its own"
    assert "As printed" in notes["cftsmppc-printed"]


def test_law_in_continuous_time_has_no_note():
    (own,) = certified.settings_of(load("example-4.1").description, "arm")
    assert own.note == ""
