import json
import os
from pathlib import Path

import pytest

from .browser import Visit, typed

SCALE = "[data-path='disturbance.scale']"


def test_the_page_works_by_keyboard_alone(visit):
    visit.page.keyboard.press("Tab")
    assert visit.page.evaluate("document.activeElement.className") == "skip"
    reached = []
    for _ in range(60):
        visit.page.keyboard.press("Tab")
        now = visit.page.evaluate(
            "document.activeElement.id || document.activeElement.getAttribute('aria-label') || ''"
        )
        reached.append(now)
        ring = visit.page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert ring != "none" or now in ("", "arm") or visit.page.evaluate("document.activeElement.name") == "arm"
        if now == "c":
            break
    order = [
        *("theme", "scheme", "keep", "printed", "rival", "solid", "play", "time", "speed", "axis", "copy"),
        *("scenario", "c"),
    ]
    assert [name for name in reached if name in order] == order and "Scale of the error" in reached

    visit.page.focus("#play")
    visit.page.keyboard.press("Space")
    running = visit.page.evaluate("slidaxPage.pictures.player.runs")
    visit.page.keyboard.press("Space")
    assert visit.page.evaluate("slidaxPage.pictures.player.runs") != running
    visit.page.focus("#solid")
    turn = visit.page.evaluate("slidaxPage.pictures.scene.camera.turn")
    visit.page.keyboard.press("ArrowLeft")
    assert visit.page.evaluate("slidaxPage.pictures.scene.camera.turn") != turn
    visit.page.keyboard.press("0")
    assert visit.page.evaluate("slidaxPage.pictures.scene.camera.turn") == turn
    visit.page.focus("#time")
    visit.page.keyboard.press("End")
    assert visit.text("#clock") == "10.00 s"
    assert not visit.page.evaluate("slidaxPage.pictures.player.runs")
    visit.page.focus("#printed")
    visit.page.keyboard.press("Enter")
    visit.settle()
    assert visit.page.locator("#outcomes li").count() == 2


def test_the_final_outcome_is_announced_and_every_control_has_a_name_for_screen_readers(visit):
    typed(visit, SCALE, "2")
    visit.page.wait_for_timeout(800)
    assert "The run reached its end." in visit.text("#said")
    names = visit.page.evaluate(
        "[...document.querySelectorAll('input,select,button,canvas')].filter(one => one.ariaHidden !== 'true'"
        " && !one.labels?.length && !one.ariaLabel && !one.textContent).map(one => one.outerHTML)"
    )
    assert names == []


@pytest.mark.parametrize("width", [320, 390, 768, 1280])
def test_no_element_is_wider_than_the_window(chromium, site, width):
    visit = Visit(chromium, (site / "index.html").as_uri(), viewport={"width": width, "height": 800})
    visit.page.click("#printed")
    visit.settle()
    assert visit.page.evaluate("document.documentElement.scrollWidth") == width
    visit.close()


def test_colours_follow_the_system_or_the_switch_and_reduced_motion_stops_the_player(chromium, site):
    visit = Visit(chromium, (site / "index.html").as_uri(), color_scheme="dark", reduced_motion="reduce")
    ground = "getComputedStyle(document.documentElement).backgroundColor"
    dark = visit.page.evaluate(ground)
    visit.page.select_option("#theme", "light")
    assert visit.page.evaluate(ground) != dark
    assert not visit.page.evaluate("slidaxPage.pictures.player.runs"), "less motion was asked for"
    visit.close()


@pytest.mark.parametrize("colours", ["light", "dark"])
def test_axe_reports_no_violation(chromium, site, colours):
    path = os.environ.get("SLIDAX_AXE", "")
    if not Path(path).is_file():
        pytest.skip("SLIDAX_AXE names no axe.min.js: `npm install axe-core` has one")
    visit = Visit(
        chromium, (site / "index.html").as_uri(), color_scheme=colours, reduced_motion="reduce", bypass_csp=True
    )
    visit.page.click("#printed")
    visit.settle()
    visit.page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    visit.page.wait_for_timeout(100)
    visit.page.add_script_tag(content=Path(path).read_text(encoding="utf-8"))
    result = visit.page.evaluate("axe.run().then(found => found.violations)")
    violations = [(item["id"], [node["html"][:120] for node in item["nodes"]]) for item in result]
    assert violations == [], json.dumps(violations, indent=1)
    visit.close()
