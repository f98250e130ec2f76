"""The playground's page in a browser: every control, the keyboard alone, addresses, files, and what a run's end says.

The programs here only replay a log that the first slider scales; these tests cover the page alone.
"""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

import slidax as sx
from slidax.export.web.playground import page_text

from .browser import Visit, served, typed
from .fixture import FAKE_LOOP, RIVAL

SCALE = "[data-path='disturbance.scale']"
FRICTION = "[data-path='robot.plant.coulomb']"


def test_the_page_makes_one_request(chromium, site):
    with served(site) as (address, paths):
        visit = Visit(chromium, f"{address}/index.html")
        visit.page.click("#printed")
        visit.settle()
        assert paths == ["/index.html"]
        assert [url for url in visit.requests if not url.startswith(("blob:", "data:"))] == [f"{address}/index.html"]
        visit.close()


@pytest.mark.parametrize("width", [390, 1280, 1600])
def test_no_panel_covers_another_where_the_page_is_scrolled(visit, width):
    visit.page.set_viewport_size({"width": width, "height": 800})
    for y in (0, 300, 600, 900, 1500):
        visit.page.evaluate(f"scrollTo(0, {y})")
        boxes = visit.page.evaluate(
            "[...document.querySelectorAll('.view > section')]"
            ".map(panel => [panel.id, panel.getBoundingClientRect().toJSON()])"
        )
        assert len(boxes) == 7
        for k, (name, box) in enumerate(boxes):
            for other, second in boxes[k + 1 :]:
                across = min(box["right"], second["right"]) - max(box["left"], second["left"])
                down = min(box["bottom"], second["bottom"]) - max(box["top"], second["top"])
                assert min(across, down) <= 0, (y, name, other)


def test_a_slider_updates_the_run_and_its_number_and_can_be_reset(visit):
    before = visit.page.evaluate("slidaxPage.result('A').signals.e[2000]")
    visit.page.locator(f"{SCALE} > .slider .bar").focus()
    visit.page.keyboard.press("PageUp")
    visit.settle()
    value = visit.state()["values"]["disturbance.scale"]
    assert 1 < value < 10
    assert visit.page.evaluate("slidaxPage.result('A').signals.e[2000]") == pytest.approx(value * before, rel=1e-12)
    assert visit.page.locator(f"{SCALE} > .slider .box").input_value() == str(value)
    assert "moved" in visit.page.get_attribute(SCALE, "class")
    visit.page.click(f"{SCALE} .reset")
    visit.settle()
    assert visit.state()["values"] == {} and visit.page.is_disabled("#reset")


def test_a_slider_value_out_of_range_is_refused_with_the_allowed_range(visit):
    box = visit.page.locator(f"{SCALE} > .slider .box")
    box.fill("1000")
    box.press("Enter")
    assert box.get_attribute("aria-invalid") == "true"
    assert "0.01" in box.evaluate("box => box.validationMessage") and visit.state()["values"] == {}


def test_each_joint_has_its_own_slider(visit):
    visit.page.click(f"{FRICTION} .each summary")
    second = visit.page.locator(f"{FRICTION} .joint .box").nth(1)
    second.fill("2.5")
    second.press("Enter")
    visit.settle()
    assert visit.state()["values"]["robot.plant.coulomb"] == [0.5, 2.5]
    typed(visit, FRICTION, "1")
    assert visit.state()["values"]["robot.plant.coulomb"] == [1, 5], "the slider for all keeps their proportions"


def test_choices_and_schemes_can_be_selected(visit):
    visit.page.select_option("#tunables .choice select", "1")
    visit.settle()
    assert visit.state()["choices"] == {"sensor.delay": 0} and "a violation was detected" in visit.text("#seen")
    visit.page.select_option("#scheme", RIVAL)
    visit.settle()
    assert visit.state()["scheme"] == RIVAL
    assert visit.state()["choices"] == {"sensor.delay": 0}, "the world stays as it was set"


def test_two_settings_are_compared_side_by_side(visit):
    assert not visit.page.is_visible("#drop")
    visit.page.click("#printed")
    visit.settle()
    assert visit.page.locator("#outcomes li").count() == 2
    assert visit.page.evaluate("slidaxPage.pictures.scene.runs.length") == 2
    assert visit.page.evaluate("slidaxPage.pictures.rows.errors[0].lines.length") == 2
    assert "CFTSMPPC as printed" in visit.text("#numbers thead")
    typed(visit, FRICTION, "2")
    assert visit.page.evaluate("slidaxPage.session.b.values")["robot.plant.coulomb"] == [2, 2], "both live in one world"
    visit.page.click("#swap")
    visit.settle()
    assert visit.state()["scheme"] == "printed"
    visit.page.click("#drop")
    visit.settle()
    assert visit.page.locator("#outcomes li").count() == 1
    visit.page.click("#keep")
    typed(visit, SCALE, "0.5")
    assert visit.page.evaluate("slidaxPage.session.b.values")["robot.plant.coulomb"] == [2, 2]
    assert "disturbance.scale" not in visit.page.evaluate("slidaxPage.session.b.values"), "what is kept stays"


def test_outdated_certificates_turn_grey_with_their_reason(visit):
    lights = visit.page.locator("#certificates .light")
    assert [lights.nth(k).get_attribute("data-state") for k in range(3)] == ["good", "bad", "grey"]
    typed(visit, "[data-path='scheme.surface.k1']", "0.3")
    assert [lights.nth(k).get_attribute("data-state") for k in range(3)] == ["grey", "bad", "grey"]
    assert "k₁ changed" in lights.nth(0).inner_text()


def test_leaving_the_envelope_and_stopping_early_are_reported(visit):
    typed(visit, SCALE, "20")
    assert "Joint 1 was outside the envelope" in visit.text("#outcomes")
    assert "no: joint 1 was outside at 0 s" in visit.text("#seen")
    typed(visit, SCALE, "60")
    assert "Joint 1 became infinite or undefined at t = 3.332 s." in visit.text("#outcomes")
    visit.page.click("#errors .data summary")
    for word in ("NaN", "Infinity", "undefined "):
        assert word not in visit.text("main").replace("infinite or undefined", "")


def test_the_address_contains_all_settings(chromium, site, visit):
    typed(visit, SCALE, "2")
    visit.page.click("#rival")
    visit.settle()
    address = visit.page.url
    assert address.split("#")[1] == (
        f"v=1&arm=two-link&scheme=cftsmppc&disturbance.scale=2&b:scheme={RIVAL}&b:disturbance.scale=2"
    )
    other = Visit(chromium, address)
    assert other.state() == visit.state()
    assert other.page.evaluate("slidaxPage.result('B').signals.e[500]") == visit.page.evaluate(
        "slidaxPage.result('B').signals.e[500]"
    )
    other.close()
    visit.page.go_back()
    visit.settle()
    assert visit.page.locator("#outcomes li").count() == 1
    visit.page.go_back()
    visit.settle()
    assert visit.state()["values"] == {}
    visit.page.go_forward()
    visit.settle()
    assert visit.state()["values"] == {"disturbance.scale": 2}


@pytest.mark.parametrize(
    ("hash_", "message"),
    [
        ("#v=2&arm=two-link", "version 2"),
        ("#what", "no version"),
        ("#v=1&arm=five-link", 'no arm "five-link"'),
        ("#v=1&arm=two-link&scheme=pid", 'no scheme "pid"'),
        ("#v=1&disturbance.scale=1e9", "0.01 to 100"),
        ("#v=1&disturbance.scale=NaN", "cannot be"),
        ("#v=1&robot.plant.coulomb=1,2,3", "cannot be"),
        ("#v=1&no.such=1", 'no "no.such"'),
        ("#v=1&sensor.delay=7", 'no value "7"'),
        ("#v=1&%E0%A4%A=1", "is not valid text"),
    ],
)
def test_an_invalid_address_shows_its_error_and_uses_the_default_scenario(chromium, site, visit, hash_, message):
    visit.page.evaluate("hash => { location.hash = hash; }", hash_)
    visit.page.wait_for_timeout(60)
    visit.settle()
    assert message in visit.text("#fault") and visit.state()["values"] == {}
    assert visit.state()["arm"] == "two-link"


def test_the_downloaded_scenario_contains_the_changed_values(visit):
    typed(visit, "[data-path='scheme.surface.k1']", "0.3")
    visit.page.select_option("#tunables .choice select", "1")
    visit.settle()
    file = visit.saved("#scenario")
    assert file.suggested_filename == "two-link-cftsmppc.yaml"
    path = Path(file.path())
    named = path.with_suffix(".yaml")
    named.write_bytes(path.read_bytes())
    changes = {"scheme.surface.k1": 0.3, "sensor.delay": 0, "simulation.t1": 1.0}
    theirs = sx.scenarios.load(named, {"simulation.t1": 1.0}).simulate()
    ours = sx.scenarios.load("example-4.1-1khz", changes).simulate()
    np.testing.assert_array_equal(theirs.log.tau, ours.log.tau)


def test_downloaded_c_has_the_changed_values_and_names_values_it_lacks(visit):
    typed(visit, "[data-path='scheme.surface.k1']", "0.3")
    visit.page.select_option("#tunables .choice select", "1")
    visit.settle()
    archive = zipfile.ZipFile(io.BytesIO(Path(visit.saved("#c").path()).read_bytes()))
    assert archive.testzip() is None and archive.read("law/law.h").decode() == "#define K1 0.3\n"
    assert "sensor.delay" in archive.read("READ-ME.txt").decode()
    assert "k1: 0.3" in archive.read("scenario.yaml").decode()


def test_a_chart_is_available_as_csv_and_as_a_table(visit):
    text = Path(visit.saved("[data-csv=errors]").path()).read_text(encoding="utf-8")
    head, *rows = text.strip().split("\n")
    assert head.startswith('t [s],"joint 1 lower [rad]"') and len(rows) == 10001
    column = head.split(",").index('"joint 1 A [rad]"')
    log = sx.scenarios.load("example-4.1-1khz").simulate().log
    np.testing.assert_array_equal([float(row.split(",")[column]) for row in rows], log.e[:, 0])
    visit.page.click("#errors .data summary")
    assert visit.page.locator("#errors tbody tr").count() == 21


def test_a_playground_of_another_format_is_refused_with_both_formats(chromium, tmp_path):
    file = tmp_path / "index.html"
    file.write_text(page_text({"format": 2, "title": "</script><b>x"}, loop=FAKE_LOOP), encoding="utf-8")
    context = chromium.new_context()
    page = context.new_page()
    page.goto(file.as_uri())
    assert "of format 1, not 2" in page.inner_text("#fault") and page.title() == "</script><b>x"
    context.close()
