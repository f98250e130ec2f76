"""Measurements of whole programs: pages in a browser, commands, the loop in real time, other readers."""

from __future__ import annotations

import argparse
import gzip
import json
import os
import platform
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import pinocchio

from .shared import DOCS, ROOT, write_table

if TYPE_CHECKING:
    from tests.arms.bad_file import BadFile
    from tests.export.web.browser import Visit

FIRST = "performance.getEntriesByName('first picture')[0].startTime"


def slider_times(visit: Visit, moves: int = 15) -> list[float]:
    """From a key on the first slider to the picture [ms], after three to warm up."""
    bar = visit.page.locator("#tunables .tunable > .slider .bar").first
    bar.focus()
    times = []
    for k in range(moves + 3):
        visit.page.keyboard.press("ArrowRight" if k % 2 else "ArrowLeft")
        visit.settle()
        visit.page.wait_for_timeout(60)
        times.append(visit.page.evaluate("slidaxPage.session.timing.drawn"))
    return times[3:]


def measure_page() -> None:
    """Measure the page that `slidax export web` wrote, for docs/browser.md, in Chromium.

    Prints its size, its requests, the time to the first picture from a server on loopback, the time from a slider's
    event to the picture (median and worst of 15), and the findings of axe-core.
    """
    from tests.export.web.browser import Visit, browser, served

    parser = argparse.ArgumentParser(description=measure_page.__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--axe", type=Path)
    parser.add_argument("--shots", type=Path)
    options = parser.parse_args()
    page = options.folder / "index.html"
    size = page.stat().st_size
    print(f"size: {size / 1e6:.2f} MB, {len(gzip.compress(page.read_bytes())) / 1e6:.2f} MB gzipped")
    with served(options.folder) as (address, requests), browser() as chromium:
        firsts = []
        for _ in range(3):
            visit = Visit(chromium, f"{address}/index.html")
            firsts.append(visit.page.evaluate(FIRST))
            visit.close()
        print(f"first picture: {min(firsts):.0f} ms, best of {len(firsts)}; requests: {sorted(set(requests))}")
        visit = Visit(chromium, f"{address}/index.html", reduced_motion="reduce")
        for radio in range(visit.page.locator("[name=arm]").count()):
            visit.page.locator("#arms label").nth(radio).click()
            visit.settle()
            times = slider_times(visit)
            name = visit.page.locator("#arms label").nth(radio).inner_text()
            ran = visit.page.evaluate("slidaxPage.session.timing.ran")
            between = f"{statistics.median(times):.0f} ms, worst {max(times):.0f} ms"
            print(f"{name}: slider to picture {between}; last run {ran:.0f} ms")
        visit.close()
        for colours in ("light", "dark"):
            for name, wide in (("phone", 390), ("desktop", 1280)):
                shape = {"width": wide, "height": 844}
                visit = Visit(chromium, page.resolve().as_uri(), viewport=shape, color_scheme=colours, bypass_csp=True)
                if options.shots:
                    options.shots.mkdir(parents=True, exist_ok=True)
                    visit.page.screenshot(path=options.shots / f"{name}-{colours}.png")
                if options.axe:
                    visit.page.add_script_tag(content=options.axe.read_text(encoding="utf-8"))
                    violations = visit.page.evaluate(
                        "axe.run().then(found => found.violations.map(one => `${one.id} (${one.impact})`))"
                    )
                    print(f"axe-core, {name}, {colours}: {violations or 'nothing'}")
                visit.close()


def measure_studio() -> None:
    """Click at random in a studio, and write the table of docs/browser.md after a run of 20 minutes.

    A visitor with a seed clicks, types and drags in Chromium. A traceback, an error in the console, an answer of 500,
    a job that hangs, a process that is left, or a byte outside the folder is a fault, and gives exit code 1.
    """
    from tests.studio.clicking import visit

    parser = argparse.ArgumentParser(description=measure_studio.__doc__)
    parser.add_argument("--time", type=float, default=1200.0, help="seconds of clicking")
    parser.add_argument("--seed", type=int, default=0, help="of what is clicked")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        clicking = visit(Path(folder), options.time, options.seed)
    actions, answers, jobs = sum(clicking.actions.values()), sum(clicking.answers.values()), clicking.answers[201]
    refused = sum(count for status, count in clicking.answers.items() if 400 <= status < 500)
    rows = [
        ("clicking, seed", f"{clicking.seconds / 60:.1f} min, {options.seed}"),
        (
            "clicks, texts, drags, choices",
            f"{actions} ({clicking.actions['missed'] + clicking.actions['not possible']} missed)",
        ),
        ("answers of the server", f"{answers}, of them {refused} refusals of wrong input, none of 500"),
        ("jobs that were started", f"{jobs}"),
        ("processes that were replaced", f"{clicking.restarts}"),
        ("tracebacks, errors in the console, hung jobs, processes left, bytes outside", f"{len(clicking.faults)}"),
    ]
    table = "\n".join(["| quantity | value |", "|---|---:|", *(f"| {what} | {much} |" for what, much in rows)])
    print(table, *clicking.faults, sep="\n")
    print(dict(clicking.actions), dict(clicking.answers), dict(clicking.jobs), sep="\n", file=sys.stderr)
    if not clicking.faults and options.time >= 1200.0:
        write_table("browser.md", "clicking", table)
    sys.exit(1 if clicking.faults else 0)


Z1 = "cmeel.prefix/share/example-robot-data/robots/z1_description/urdf/z1.urdf"


@dataclass(frozen=True)
class Step:
    """A command of the path.

    - `good`: exit codes that are answers; a certificate that does not hold is one.
    """

    title: str
    command: str
    good: tuple[int, ...] = (0,)


def newcomer_steps(wheel: Path) -> list[Step]:
    """The commands, as docs/explain.md has them.

    - `wheel`: in place of the name on the package index.
    """
    return [
        Step("an environment", "python -m venv .venv"),
        Step("the installation", f"pip install '{wheel}[native,robots,parquet,studies]'"),
        Step("the law in ten seconds", "slidax demo --still"),
        Step("a first run", "slidax run example-4.1-1khz"),
        Step("the same run again", "slidax run example-4.1-1khz"),
        Step("an arm of your own", "slidax new --robot my-arm.urdf --out my-arm.yaml"),
        Step("its run, with a report", "slidax run my-arm.yaml --out report"),
        Step("a law designed for it", "slidax design requirements.yaml --out designed.yaml --runs 32"),
        Step("its certificates", "slidax certify designed.yaml", (0, 4)),
        Step("its C", "slidax export c designed.yaml --out law"),
        Step("compiled", "cmake -S law -B build -DCMAKE_BUILD_TYPE=Release && cmake --build build"),
        Step("compared with Python", "ctest --test-dir build --output-on-failure"),
    ]


def built(place: Path) -> Path:
    """The wheel of these sources."""
    command = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(place), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True)
    (wheel,) = place.glob("*.whl")
    return wheel


def requirements() -> str:
    """The file that the page shows."""
    text = (DOCS / "explain.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```yaml\n# requirements.yaml\n(.*?)```", text, re.DOTALL)
    return str(block)


def walked(place: Path, wheel: Path, python: Path, robot: Path) -> list[tuple[Step, float, float]]:
    """Each step with its seconds, by the clock and of the processor.

    - `place`: an empty folder.
    """
    shutil.copy(robot, place / "my-arm.urdf")
    (place / "requirements.yaml").write_text(requirements(), encoding="utf-8")
    (place / "bin").mkdir()
    (place / "bin" / "python").symlink_to(python)
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "VIRTUAL_ENV"))}
    search = f"{place}/.venv/bin:{place}/bin:{os.environ['PATH']}"
    env = kept | {"HOME": str(place), "XDG_CACHE_HOME": f"{place}/cache", "PATH": search, "PIP_NO_CACHE_DIR": "0"}
    cache = subprocess.run([python, "-m", "pip", "cache", "dir"], capture_output=True, text=True, check=True)
    env["PIP_CACHE_DIR"] = cache.stdout.strip()
    timed = []
    for step in newcomer_steps(wheel):
        before, started = _processor(), time.perf_counter()
        done = subprocess.run(step.command, shell=True, cwd=place, env=env, capture_output=True, text=True, check=False)
        took = time.perf_counter() - started
        print(f"{step.title:<24} {took:6.1f} s, exit code {done.returncode}", flush=True)
        if done.returncode not in step.good:
            raise SystemExit(f"$ {step.command}\n{(done.stdout + done.stderr)[-4000:]}")
        timed.append((step, took, _processor() - before))
    return timed


def _processor() -> float:
    return os.times().children_user + os.times().children_system


def newcomer_table(timed: list[tuple[Step, float, float]]) -> str:
    """The page's table, and the machine that it was measured on."""
    rows = ["| step | command | clock [s] | processor [s] |", "|---|---|---:|---:|"]
    for step, took, worked in timed:
        command = re.sub(r"'\S*slidax-[^\[]*", "'slidax", step.command)
        rows.append(f"| {step.title} | `{command}` | {took:.1f} | {worked:.1f} |")
    clock, processor = sum(row[1] for row in timed), sum(row[2] for row in timed)
    rows.append(f"| **all** | | **{clock:.0f}** | **{processor:.0f}** |")
    machine = f"{os.cpu_count()} cores, {platform.system()} on {platform.machine()}, Python {platform.python_version()}"
    busy = os.getloadavg()[2] / (os.cpu_count() or 1)
    return "\n".join([*rows, "", f"{machine}; load per core in the last quarter of an hour: {busy:.1f}."])


def measure_newcomer() -> None:
    """Walk the newcomer's path in a fresh environment, and write its times into docs/explain.md.

    The path begins with a wheel that is built here: an environment, the installation, a first run, an arm from a URDF
    file, a law designed for it, its certificates, and its C, compiled and tested. Only pip's downloads are kept from
    earlier runs. The arm is by default Unitree's Z1 of the package example-robot-data.
    """
    parser = argparse.ArgumentParser(description=measure_newcomer.__doc__)
    parser.add_argument("--python", type=Path, default=Path(sys.base_prefix) / "bin" / "python3")
    parser.add_argument("--robot", type=Path, default=None)
    parser.add_argument("--keep", type=Path, default=None, help="walk there, and leave what was made")
    options = parser.parse_args()
    robot = options.robot
    if robot is None:
        (robot, *_) = [path for place in sys.path if (path := Path(place) / Z1).exists()] or [None]
        if robot is None:
            raise SystemExit("example-robot-data is not installed: name an arm by --robot FILE.urdf")
    with tempfile.TemporaryDirectory() as top:
        place = options.keep.resolve() if options.keep else Path(top) / "walk"
        place.mkdir(parents=True)
        (Path(top) / "dist").mkdir()
        text = newcomer_table(walked(place, built(Path(top) / "dist"), options.python, robot))
    write_table("explain.md", "newcomer", text)


FIGURE = DOCS / "figures" / "loop-latency.svg"
SCENARIO = "panda-payload"


def slidax(*arguments: str) -> dict:
    """The JSON output of a command of slidax, also if it fails."""
    program = [sys.executable, "-c", "from slidax.cli import main; main()"]
    done = subprocess.run([*program, *arguments, "--json"], stdout=subprocess.PIPE, text=True, check=False)
    if not done.stdout:
        sys.exit(done.returncode)
    return json.loads(done.stdout)


def loop_row(name: str, answer: dict, again: dict) -> list[str]:
    """A column of the table."""
    missed, times, log = answer["missed"], answer["latency_us"], answer["log"]
    envelope = answer["envelope"]

    def shares(of: str) -> str:
        return " / ".join(f"{times[of][share]:.0f}" for share in ("p50", "p99", "p99.9", "max"))

    return [
        name,
        f"{answer['ticks']}, {answer['ended']}",
        shares("wake-up, law"),
        shares("wake-up, arm"),
        shares("step"),
        shares("measurement to command"),
        str(missed["ticks"]),
        str(missed["longest"]),
        str(answer["status"]["MISSED_PERIOD"]),
        f"{envelope['outside']}; {min(envelope['margin']):.2f}",
        f"{times['row into the ring']['p50']:.1f}",
        f"{log['recorder_us']:.1f}",
        f"{log['bytes'] / answer['ticks']:.0f}",
        f"{again['same']} of {again['answers']}",
    ]


LOOP_HEAD = [
    "quantity",
    "ticks",
    "wake-up of the law, p50 / p99 / p99.9 / max [µs]",
    "wake-up of the arm [µs]",
    "step [µs]",
    "measurement to command [µs]",
    "ticks without a command in time",
    "most in a row",
    "answers with `MISSED_PERIOD`",
    "ticks outside the envelope; least margin of its width",
    "a row into the ring, p50 [µs]",
    "recorder, in a process of its own, a tick [µs]",
    "log, a tick [bytes]",
    "answers with the same bits in `slidax replay`",
]


def measure_loop() -> None:
    """Measure the loop in real time, and write its table into docs/loop.md.

    Runs panda-payload twice, the second time with all processors busy, and replays both logs.
    """
    parser = argparse.ArgumentParser(description=measure_loop.__doc__)
    parser.add_argument("--time", type=float, default=600.0, help="how long each of the two takes [s]")
    parser.add_argument("--patience", type=int, default=20, help="as of `slidax loop`")
    seconds, patience = vars(parser.parse_args()).values()
    columns = [LOOP_HEAD]
    for name, more in (("alone", ["--histogram", str(FIGURE)]), ("all processors busy", ["--cpu-hog"])):
        with tempfile.TemporaryDirectory() as folder:
            log = str(Path(folder) / "log.mcap")
            words = ["--time", str(seconds), "--patience", str(patience), "--out", log, *more]
            columns.append(loop_row(name, slidax("loop", SCENARIO, *words), slidax("replay", log)))
    lines = ["| " + " | ".join(line) + " |" for line in zip(*columns, strict=True)]
    lines.insert(1, "|---" * len(columns) + "|")
    system = f"{platform.system()} {platform.release()}, {os.cpu_count()} processors"
    lines += ["", f"`scripts/measure loop --time {seconds:g} --patience {patience}` on {system}; {SCENARIO}."]
    table = "\n".join(lines)
    print(table)
    write_table("loop.md", "loop", table)


def write_benchmark() -> None:
    """Run the benchmark of schemes, and write its table into docs/benchmark-of-schemes.md.

    Entries that have a result are not run again. The arguments are those of `slidax benchmark`.
    """
    arguments = sys.argv[1:]
    out = Path(arguments[arguments.index("--out") + 1]) if "--out" in arguments else Path("benchmark")
    subprocess.run([Path(sys.executable).with_name("slidax"), "benchmark", *arguments], check=True)
    table = (out / "benchmark.md").read_text(encoding="utf-8").strip()
    write_table("benchmark-of-schemes.md", "benchmark", table)


OUTCOMES = {
    "names": "refused, with its name",
    "refuses": "refused",
    "warns": "taken, with a warning",
    "takes": "taken",
    "crashes": "the process ends",
}
LONGEST = 160


def by_mujoco(path: str) -> None:
    """Read a file and compile it."""
    mujoco.MjSpec.from_file(path).compile()


def isolated(read: Callable[[str], object], case: BadFile, folder: Path) -> str:
    """A reader's outcome for a case, in its own process."""
    path = _written(case, folder)
    back, there = os.pipe()
    with tempfile.TemporaryFile() as printed:
        child = os.fork()
        if child == 0:
            _read_and_tell(read, path, there, printed.fileno())
        os.close(there)
        with open(back, "rb") as told:
            answer = told.read()
        _, status = os.waitpid(child, 0)
        printed.seek(0)
        console = printed.read().decode(errors="replace")
    if os.WIFSIGNALED(status):
        return "crashes"
    error = json.loads(answer)
    if error is None:
        return "warns" if console.strip() else "takes"
    return "names" if re.search(rf"\b{re.escape(case.named[0])}\b", error + console) else "refuses"


def _written(case: BadFile, folder: Path) -> str:
    if isinstance(case.text, str) and case.text.startswith("no/such"):
        return case.text
    # MuJoCo wants this ending; Pinocchio tells the formats apart by its function.
    path = folder / "robot.xml"
    path.write_bytes(case.text if isinstance(case.text, bytes) else case.text.encode())
    return str(path)


def _read_and_tell(read: Callable[[str], object], path: str, there: int, printed: int) -> None:
    os.dup2(printed, 1)
    os.dup2(printed, 2)
    error = None
    try:
        read(path)
    except Exception as caught:
        error = str(caught)
    os.write(there, json.dumps(error).encode()[:60_000])
    os._exit(0)


def by_slidax(name: str, case: BadFile, folder: Path) -> str:
    """The message of slidax."""
    # Not before: JAX has threads, and a process with threads must not fork.
    from slidax.arms import files
    from slidax.core.errors import DefinitionError

    read = getattr(files, name)
    try:
        read(case.source(folder), **case.arguments)
    except DefinitionError as error:
        message = str(error).replace(str(folder), "").replace(str(Path.cwd()), "").removeprefix("/robot.xml: ")
        message = message if len(message) <= LONGEST else message[: LONGEST - 2] + " …"
        return message.replace("|", "\\|").replace("<", "&lt;")
    raise AssertionError(f"slidax takes: {case.title}")


def by_others(cases: Sequence[BadFile], readers: Sequence[Callable[[str], object]], folder: Path) -> list[list[str]]:
    """Each reader's outcome for each case."""
    return [[isolated(read, case, folder) for read in readers] for case in cases]


def bad_files_table(rows: Sequence[Sequence[str]]) -> str:
    """A row for each case: title, outcomes of MuJoCo and Pinocchio, message of slidax."""
    lines = [f"| {title} | {OUTCOMES[a]} | {OUTCOMES[b]} | {message} |" for title, a, b, message in rows]
    return "\n".join(["| fault | MuJoCo | Pinocchio | slidax says |", "|---|---|---|---|", *lines])


def bad_files_counts(by_format: dict[str, Sequence[Sequence[str]]]) -> str:
    """Outcomes of each reader, counted by format."""
    lines = []
    for name, rows in by_format.items():
        for reader, column in (("MuJoCo", 1), ("Pinocchio", 2)):
            counted = Counter(row[column] for row in rows)
            lines.append(f"| {name} | {reader} | " + " | ".join(str(counted[key]) for key in OUTCOMES) + " |")
        lines.append(f"| {name} | slidax | {len(rows)} | 0 | 0 | 0 | 0 |")
    head = "| format | reader | " + " | ".join(OUTCOMES.values()) + " |\n|---|---|" + "---:|" * len(OUTCOMES)
    return head + "\n" + "\n".join(lines)


def write_bad_files() -> None:
    """Write the tables of docs/robot-files.md: the answers of three readers to bad robot files."""
    from tests.arms import bad_mjcf, bad_urdf

    signal.alarm(600)
    formats = {
        "URDF": (bad_urdf.CASES, (by_mujoco, pinocchio.buildModelFromUrdf), "from_urdf"),
        "MJCF": (bad_mjcf.CASES, (by_mujoco, pinocchio.buildModelFromMJCF), "from_mjcf"),
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name).resolve()
        os.chdir(folder)
        theirs = {key: by_others(cases, readers, folder) for key, (cases, readers, _) in formats.items()}
        answers = {
            key: [
                [case.title, *others, by_slidax(ours, case, folder)]
                for case, others in zip(cases, theirs[key], strict=True)
            ]
            for key, (cases, _, ours) in formats.items()
        }
        os.chdir(ROOT)
    tables = {"counts": bad_files_counts(answers)} | {key: bad_files_table(rows) for key, rows in answers.items()}
    for name, new in tables.items():
        write_table("robot-files.md", name, new)
    print(tables["counts"])
