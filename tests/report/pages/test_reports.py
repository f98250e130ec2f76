import re
from pathlib import Path

import equinox as eqx
import pytest
from ruamel.yaml import YAML

import slidax.report
from slidax import scenarios
from slidax.report import significant, tip_paths, typeset, write_run_report
from slidax.report.files import parameters
from slidax.scenarios.yaml_text import as_yaml
from tests.report.figures.test_figures import contrast

TEMPLATES = Path(slidax.report.__file__).parent / "templates"


@pytest.mark.parametrize(
    ("number", "digits", "text"),
    [
        *((1.3756, 4, "1.376"), (9.9996, 4, "10.00"), (12.19, 4, "12.19"), (0.00123456, 3, "0.00123")),
        *((0.000999, 2, "0.0010"), (4.92e-11, 3, "4.92e-11"), (33872.0, 4, "3.387e4"), (-0.25, 2, "-0.25")),
        *((0.0, 4, "0"), (float("nan"), 4, "–"), (None, 4, "–")),
    ],
)
def test_numbers_keep_their_significant_digits(number, digits, text):
    assert significant(number, digits) == text


@pytest.mark.parametrize(
    ("text", "markup"),
    [
        ("4.92e-11", "4.92\u00a0×\u00a010<sup>−11</sup>"),
        ("above 1e-8 at", "above 10<sup>−8</sup> at"),
        ("-0.25 rad", "−0.25\u00a0rad"),
        ("T_max < 5 N m", "T<sub>max</sub> &lt; 5\u00a0N\u00a0m"),
        ("two-link, (48)-(50), 10.1007/s11071-022", "two-link, (48)-(50), 10.1007/s11071-022"),
        ("joint_units 1e5x", "joint_units 1e5x"),
        ("<b>", "&lt;b&gt;"),
        ("give `a_b < 1e-3`, or `-2`", "give <code>a_b &lt; 1e-3</code>, or <code>-2</code>"),
        ("a ` alone, -1", "a ` alone, −1"),
        ("|e| <= 2 % at 1 kHz", '<span class="whole">|e|</span> ≤ 2\u00a0% at 1\u00a0kHz'),
        ("5 stages >= 3", "5 stages ≥ 3"),
    ],
)
def test_text_of_a_report_is_typeset_and_escaped_in_html(text, markup):
    assert typeset(text) == markup


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    scenario = scenarios.load("example-4.1", {"simulation.t1": 0.5, "title": "A <title> & more"})
    page = write_run_report(
        scenario, scenario.simulate(progress=False), tmp_path_factory.mktemp("run") / "new", command="slidax run x > y"
    )
    return page, page.read_text(encoding="utf-8")


def test_the_report_of_a_run_is_self_contained_with_its_figures(report):
    page, text = report
    assert not re.findall(r"https?://", text) and not re.findall(r"\ssrc=|<link|<script", text)
    names = {"envelope-share", "tracking-error", "velocity-error", "torque", "tip-path"}
    assert {path.stem for path in (page.parent / "figures").glob("*.svg")} == names
    assert text.count("<figure") == 5
    assert text.count('[style*="fill:#1a1a1a"]') == 1, "one style sheet for the figures of a page"


def test_the_report_of_a_run_has_its_outcome_and_command(report):
    text = report[1]
    assert text.index("Inside the envelope. Closest: joint 2, ") < text.index("<figure") < text.index("<table")
    assert text.index("<table") < text.index("<details") and "A &lt;title&gt; &amp; more" in text
    assert "slidax run x &gt; y" in text
    assert "103.7" in text  # the printed law's torque at the start of Example 4.1
    assert "inertia_max: 0.2" in text


def test_a_bad_outcome_is_shown_with_its_message(tmp_path):
    changes = {"simulation.t1": 0.5, "scheme.performance.deadline": [0.05, 0.05]}
    scenario = scenarios.load("example-4.1", changes)
    run = scenario.simulate(progress=False)
    assert not run.outcome.ok
    text = write_run_report(scenario, run, tmp_path).read_text(encoding="utf-8")
    assert "outcome bad" in text and run.outcome.message.split(" (")[0] in text.replace("\xa0", " ")


def test_a_run_without_a_log_has_a_report_without_figures(tmp_path):
    scenario = scenarios.load("example-4.1", {"simulation.t1": 0.5})
    unlogged = eqx.tree_at(lambda run: run.log, scenario.simulate(progress=False), None)
    text = write_run_report(scenario, unlogged, tmp_path).read_text("utf-8")
    assert "<figure" not in text and "All metrics" in text


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("example-4.2", {"disturbance.scale": 0.25}),
        ("example-4.1-1khz", {"actuator.rate": None, "scheme.sampled_data.estimator.kind": "kalman"}),
        # Here null differs from the default.
        ("example-4.1-1khz", {"scheme.sampled_data.recovery": None}),
        ("example-4.2-1khz", {"sensor.loss.outages": [{"start": 1.0, "samples": 5}], "scheme.sampled_data": None}),
    ],
)
def test_the_parameters_in_a_report_define_the_same_scenario(name, changes):
    scenario = scenarios.load(name, changes)
    assert scenarios.parse(parameters(scenario)["The scenario"]) == scenario.description


def test_tip_paths_cover_all_samples_and_start_at_the_tip_of_the_first_posture():
    scenario = scenarios.load("example-4.1", {"simulation.t1": 0.5})
    run = scenario.simulate(progress=False)
    actual, desired = tip_paths(scenario.plant.robot, run)
    assert actual.shape == desired.shape == (len(run.log.t), 3)
    assert actual[0] == pytest.approx(scenario.plant.robot.tip(scenario.state0.q))


def test_defaults_that_the_file_omits_are_shown_with_the_laws_values():
    scenario = scenarios.load("example-4.1-1khz")
    assert "horizon" not in as_yaml(scenario.description)
    law = scenario.controller
    shown = YAML(typ="safe").load(parameters(scenario)["The law with all its values"])
    assert shown["horizon"] == float(law.horizon) == 0.012
    assert shown["estimator"].pop("kind") == "Measured"
    values = {name: float(getattr(law.estimator, name)) for name in ("gain", "trend", "ahead")}
    assert shown["estimator"] == pytest.approx(values, rel=1e-5)


def variables(css):
    return [dict(re.findall(r"--(\w+): (#\w+)", block)) for block in re.findall(r":root \{(.*?)\}", css, re.DOTALL)]


@pytest.mark.parametrize("colours", [0, 1], ids=["light", "dark"])
def test_text_of_a_report_contrasts_with_its_ground(colours):
    css = (TEMPLATES / "page.css").read_text(encoding="utf-8")
    colour = variables(css)[colours]
    for ink in ("ink", "lead", "soft", "link", "good", "near", "bad"):
        for ground in ("ground", "faint"):
            assert contrast(colour[ink], colour[ground]) >= 4.5, (ink, ground)


def test_a_wide_table_scrolls_by_itself_and_can_be_reached_by_keys():
    texts = [template.read_text(encoding="utf-8") for template in TEMPLATES.glob("*.j2")]
    tables = [text.count("<table") for text in texts]
    assert sum(tables) > 5
    assert [text.count('<div class="scroll" tabindex="0"><table') for text in texts] == tables
