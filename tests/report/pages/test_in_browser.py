import json
import os
from pathlib import Path

import pytest

import slidax as sx
from slidax import paper
from slidax.analysis import linearise
from slidax.certify import certify
from slidax.identify import identify
from slidax.report import (
    Rival,
    write_certificate_report,
    write_comparison,
    write_identification_report,
    write_linear_report,
    write_run_report,
    write_study_report,
)
from slidax.report.benchmark_page import write_benchmark
from slidax.studies import RunOptions
from slidax.studies.benchmark import BenchmarkRound, entries, task
from tests.export.web.browser import browser
from tests.identify.recorded import recorded, true_arm
from tests.studies.files import study

pytestmark = pytest.mark.full


def of_a_run(out):
    scenario = sx.scenarios.load("panda-payload", {"simulation.t1": 0.5})
    write_run_report(scenario, scenario.simulate(log_every=5), out, command="slidax run panda-payload")


def of_a_comparison(out):
    judge = sx.scenarios.load("example-4.1-1khz", {"simulation.t1": 1.0})
    schemes = {name: judge if not name else sx.scenarios.alter(judge, {"scheme.name": name}) for name in ("", "pid")}
    write_comparison({name or "own": Rival.simulated(item, judge, logged=True) for name, item in schemes.items()}, out)


def of_a_certificate(out):
    scenario = sx.scenarios.load("example-4.2")
    write_certificate_report(scenario, certify(scenario, runs=0), out, seconds=1.0)


def of_a_study(out):
    requests = study(runs=64)
    write_study_report(requests, requests.run(RunOptions(None, False)), out, seconds=1.0)


def of_a_linear_loop(out):
    scenario = sx.scenarios.load("example-4.1-1khz")
    write_linear_report(scenario, linearise(scenario, 2.0), out, seconds=1.0)


def of_an_identification(out):
    write_identification_report(identify(recorded(true_arm()), sx.arms.ur5e()), out)


def of_several_logs(out):
    arm = true_arm()
    logs = [recorded(arm), recorded(arm, seconds=8.0, rate=200.0, noise=0.02, seed=1)]
    write_identification_report(identify(logs, sx.arms.ur5e(), links=True), out)


def of_the_benchmark(out):
    small = BenchmarkRound({"scara-slow": task("scara-slow")}, [*entries(["pid"], [], ("printed",))]).small()
    write_benchmark(small.run(out, 0), out, seconds=1.0)


def of_the_paper(out):
    paper.reproduce(out, disturbance="stated")


KINDS = {
    "run": of_a_run,
    "comparison": of_a_comparison,
    "certificate": of_a_certificate,
    "study": of_a_study,
    "linear": of_a_linear_loop,
    "identification": of_an_identification,
    "several-logs": of_several_logs,
    "benchmark": of_the_benchmark,
    "paper": of_the_paper,
}

PHONE, DESK = {"width": 390, "height": 844}, {"width": 1280, "height": 800}


@pytest.fixture(scope="module")
def chromium():
    with browser() as result:
        yield result


@pytest.fixture(scope="module", params=KINDS)
def page(request, tmp_path_factory):
    out = tmp_path_factory.mktemp(request.param)
    KINDS[request.param](out)
    return out / "report.html"


@pytest.mark.parametrize("colours", ["light", "dark"])
@pytest.mark.parametrize("window", [PHONE, DESK], ids=["phone", "desk"])
def test_a_report_fits_the_window_and_is_accessible(chromium, page, window, colours, request):
    context = chromium.new_context(viewport=window, color_scheme=colours, bypass_csp=True)
    shown = context.new_page()
    wrong = []
    requests = []
    shown.on("console", lambda message: message.type in ("error", "warning") and wrong.append(message.text))
    shown.on("request", lambda item: requests.append(item.url))
    shown.goto(page.as_uri())
    assert requests == [page.as_uri()] and wrong == []
    shown.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert shown.evaluate("document.documentElement.scrollWidth") == window["width"]
    ground = shown.evaluate("getComputedStyle(document.body).backgroundColor")
    light = sum(map(int, ground.removeprefix("rgb(").removesuffix(")").split(","))) > 600
    assert light == (colours == "light"), ground
    shots = os.environ.get("SLIDAX_SHOTS")
    if shots:
        shown.screenshot(path=Path(shots) / f"{request.node.callspec.id}.png", full_page=True)
    # Elements wider than their container can be scrolled by keys.
    unreached = shown.evaluate(
        "[...document.querySelectorAll('.scroll, pre')].filter(one => one.scrollWidth > one.clientWidth + 1"
        " && one.tabIndex < 0).map(one => one.outerHTML.slice(0, 120))"
    )
    assert unreached == []
    path = os.environ.get("SLIDAX_AXE", "")
    if Path(path).is_file():
        shown.add_script_tag(content=Path(path).read_text(encoding="utf-8"))
        result = shown.evaluate("axe.run().then(found => found.violations)")
        wrong = [json.dumps([item["id"], [node["html"][:120] for node in item["nodes"]][:3]]) for item in result]
        assert wrong == []
    context.close()


def test_figures_have_light_lines_where_the_page_is_dark(chromium, page):
    context = chromium.new_context(viewport=DESK, color_scheme="dark")
    shown = context.new_page()
    shown.goto(page.as_uri())
    ink = shown.evaluate(
        "[...document.querySelectorAll('figure svg [style*=\"fill:#1a1a1a\"]')].map(one => getComputedStyle(one).fill)"
    )
    assert ink and set(ink) == {"rgb(228, 232, 236)"}
    context.close()
