"""A visitor who clicks, types and drags at random in a studio, and the faults that this may cause."""

import json
import random
import shutil
import time
from collections import Counter
from dataclasses import dataclass, field

from .running import Running, gone
from .tricks import SECRET, planted, state_of, tricks

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")

FLAGS = "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
FLAGS += "--disable-component-update --disable-sync --disable-dev-shm-usage"

STUDY = """study: monte_carlo
scenario: example-4.1-1khz
runs: 40
seed: 1
uncertainty:
  disturbance.scale: {between: [0.5, 1.0]}
"""

REACHABLE = {
    "#studio [role=tab]:visible": 3,
    "#studio button:not([role=tab]):visible:enabled": 8,
    "#studio select:visible": 4,
    "#studio input:visible:enabled": 3,
    "#studio textarea:visible": 2,
    "#studio summary:visible": 1,
    "#choose button:visible:enabled, #scheme:visible, #play:visible, #reset:visible:enabled, .studio-jump": 2,
    "#controls input:visible:enabled, #controls select:visible": 4,
}
"""Elements that the visitor uses, with their weights."""

ODD = [
    *("", "0", "-1", "1e308", "NaN", "x" * 300, "scenario.yaml", "results", "ünïcode.yaml"),
    "<script>alert(1)</script>",
]

TEXTS = ["robot: [", "title: x\nrobot: {kind: two_link}\n", "a: &a [*a]", "\0", "- 1\n" * 500]


@dataclass
class Visit:
    """Outcome of a visit: counts of actions and answers, and faults, one line each."""

    seconds: float = 0.0
    actions: Counter[str] = field(default_factory=Counter)
    answers: Counter[int] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest: float = 0.0
    jobs: Counter[str] = field(default_factory=Counter)
    restarts: int = 0


def visit(top, seconds, seed):
    """Click in a studio for some seconds, with files in the empty folder `top`."""
    root, outcome = planted(top), Visit()
    (root / "study.yaml").write_text(STUDY, encoding="utf-8")
    before = state_of(top / "outside")
    running = Running(root)
    try:
        _click(running, outcome, random.Random(seed), seconds, tricks(root))
        _settle(running, outcome)
        children = running.children()
        if running.end() != 0:
            outcome.faults.append(f"the studio ended with {running.process.returncode}")
        if not gone(children):
            outcome.faults.append("processes were left")
    finally:
        running.end(9)
    if "Traceback" in running.output or "ERROR" in running.output:
        outcome.faults.append(f"the server's log: {running.output[-2000:]}")
    if state_of(top / "outside") != before:
        outcome.faults.append("a file outside of the folder was written")
    return outcome


def _click(running, outcome, chance, seconds, names):
    from playwright.sync_api import Error, sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
        page.set_default_timeout(3000)
        page.on("pageerror", lambda error: outcome.faults.append(f"in the page: {error}"))
        page.on("console", lambda message: _heard(message, outcome))
        page.on("response", lambda answer: _answered(answer, outcome))
        page.on("dialog", lambda dialog: dialog.accept() if chance.random() < 0.5 else dialog.dismiss())
        page.on("popup", lambda other: other.close())
        page.goto(running.address, timeout=120_000)
        page.wait_for_selector("#studio-text", timeout=120_000)
        until = time.monotonic() + seconds
        began = time.monotonic()
        while time.monotonic() < until:
            what = "?"
            try:
                if chance.random() < 0.02:
                    outcome.actions[_start(page, chance)] += 1
                places = page.locator(chance.choices(list(REACHABLE), list(REACHABLE.values()))[0])
                count = places.count()
                if not count:
                    page.wait_for_timeout(50)
                    continue
                place = places.nth(chance.randrange(count))
                what = _act(place, page, chance, names)
            except Error as error:
                # An element that is gone, covered or too slow to click is no fault of the studio.
                what = "missed" if "Timeout" in str(error) or "not attached" in str(error) else "not possible"
            outcome.actions[what] += 1
            page.wait_for_timeout(chance.choice([0, 10, 50, 200]))
        outcome.seconds = time.monotonic() - began
        if SECRET in page.content():
            outcome.faults.append("the planted file is in the page")
        browser.close()


def _start(page, chance):
    page.locator("#studio-tab-jobs").click()
    kinds = page.locator("#studio-kind")
    kinds.select_option(index=chance.randrange(kinds.locator("option").count()))
    page.locator("#studio-panel-jobs button", has_text="Start").click()
    return "started"


def _act(place, page, chance, names):
    kind = place.evaluate("one => `${one.tagName} ${one.type ?? ''}`.trim().toLowerCase()")
    if kind.startswith("select"):
        options = place.locator("option").count()
        if options:
            place.select_option(index=chance.randrange(options))
        return "chosen"
    if kind == "textarea":
        place.fill(chance.choice(TEXTS))
        return "typed"
    if kind == "input range":
        place.press(chance.choice(["ArrowRight", "ArrowLeft", "PageUp", "PageDown", "Home", "End"]))
        return "slid"
    if kind == "input file":
        place.set_input_files(
            {"name": chance.choice(["arm.urdf", "a.csv", "x.exe"]), "mimeType": "text/plain", "buffer": b"<robot/>"}
        )
        return "brought"
    if kind == "input checkbox":
        place.click()
        return "clicked"
    if kind.startswith("input"):
        number = kind == "input number"
        place.fill(
            chance.choice(["0", "-1", "3", "1e308", ""])
            if number
            else chance.choice([*ODD, *[n for n in names if "\0" not in n]])
        )
        place.press(chance.choice(["Enter", "Tab"]))
        return "typed"
    place.click()
    return "clicked"


def _heard(message, outcome):
    # Every browser reports a refused request in its console; the page shows its own message.
    if message.type == "error" and "the server responded with a status of 4" not in message.text:
        outcome.faults.append(f"in the console: {message.text}")


def _answered(answer, outcome):
    if answer.url.startswith("http"):
        outcome.answers[answer.status] += 1
        if answer.status >= 500:
            outcome.faults.append(f"{answer.status} of {answer.url}")


def _settle(running, outcome):
    began = time.monotonic()
    jobs = json.loads(running.ask("GET", "/api/jobs")[1])["jobs"]
    for job in jobs:
        if job["state"] in ("waiting", "running"):
            running.ask("DELETE", f"/api/jobs/{job['id']}")
    for job in json.loads(running.ask("GET", "/api/jobs")[1])["jobs"]:
        outcome.jobs[f"{job['kind']}: {job['state']}"] += 1
        if job["state"] in ("waiting", "running"):
            outcome.faults.append(f"the job `{job['command']}` hangs")
        whole = json.loads(running.ask("GET", f"/api/jobs/{job['id']}")[1])
        if "Traceback" in whole["log"]:
            outcome.faults.append(f"a traceback in `{job['command']}`: {whole['log'][-1500:]}")
        if SECRET in json.dumps(whole):
            outcome.faults.append(f"the planted file is in the answer of `{job['command']}`")
    status, _ = running.ask("POST", "/api/check", {"name": "example-4.1"})
    if status != 200:
        outcome.faults.append(f"the workbench answers {status}")
    outcome.restarts = json.loads(running.ask("GET", "/api/about")[1])["restarts"]
    outcome.slowest = time.monotonic() - began
