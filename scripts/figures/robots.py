"""Robot files and arms of other makers: the tables of docs/robot-files.md, and of twenty arms in docs/robots.md."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pinocchio
import yaml

import slidax as sx
from slidax.analysis import RunRecord, explain
from slidax.arms import Articulated, Coupled, Mismatch, Payload, TimedPayload, from_urdf
from slidax.arms.files.reading import Notes
from slidax.arms.files.source import read_robot_file
from slidax.arms.files.urdf import hold_massless, mimicry_of
from slidax.arms.files.urdf_tree import urdf_tree
from slidax.arms.joint import is_rigid, nearest_rigid
from slidax.core.errors import DefinitionError
from slidax.scenarios import draft
from slidax.simulation.states import spread_in_box, states_of

from .shared import ROOT, write_table

STATES, WITHIN, SMALL = 3, 1e-9, 1e-6
"""Number of compared states; largest difference relative to the norm; least norm."""

ENTRIES = {(0, 0): "ixx", (0, 1): "ixy", (0, 2): "ixz", (1, 1): "iyy", (1, 2): "iyz", (2, 2): "izz"}
"""Attributes of <inertia> by row and column."""

REASONS = {
    "no masses": r"has a mass, as in files that are only for drawing|has no mass|inertia but no mass",
    "no inertia": r"write the body's own",
    "an inertia of no body": r"principal moments",
    "xacro in it, whose files are missing": r"xacro",
    "no arm in it": r"no joint that moves|no <link>|no <joint>",
    "a mimic joint": r"mimics",
    "not XML": r"not XML|decoded",
}
"""Patterns in a refusal by its kind; the first match counts."""


def arm_of(path: Path, inertias: str) -> tuple[Articulated | Coupled | None, str, str]:
    """The arm in a file and its tip, or the reason why it has none."""
    try:
        return from_urdf(path, inertias=inertias), "", ""
    except DefinitionError as error:
        refusal = error.message
    offered = re.search(r"give tip=NAME; (.*) carry no other", refusal)
    for tip in offered[1].split(", ") if offered else ():
        try:
            return from_urdf(path, tip=tip, inertias=inertias), tip, ""
        except DefinitionError as error:
            refusal = error.message
    return None, "", refusal


def kind_of(refusal: str) -> str:
    """A refusal's kind, in few words.

    - `refusal`: the message; empty if it is read.
    """
    if not refusal:
        return "read"
    return next((kind for kind, words in REASONS.items() if re.search(words, refusal)), "other")


def files_of(folder: Path) -> list[Path]:
    """The URDF files below a folder."""
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() == ".urdf" and path.is_file())


def pinocchio_difference(path: Path, tip: str, arm: Articulated | Coupled) -> float | None:
    """Largest difference from Pinocchio in M and gravity, of their norms; None if Pinocchio does not read the file.

    - `tip`: as it was read; empty for the only one.
    """
    try:
        with console_off():
            text = repaired(path)
            model = pinocchio.buildModelFromXML(text) if text else pinocchio.buildModelFromUrdf(str(path))
    except ValueError:
        return None
    tree = urdf_tree(read_robot_file(path, "robot", "").root)
    end = tip or next(link for link in tree.leaves if link not in tree.standing)
    mimicry = mimicry_of(tree, end, {}, "held", Notes())
    hold_massless(tree, end, mimicry, (), Notes())
    data = model.createData()
    every = arm.arm if isinstance(arm, Coupled) else arm
    if {*every.joint_names, *mimicry.held} != {*list(model.names)[1:]}:
        raise AssertionError(f"{path}: {every.joint_names} and {list(mimicry.held)} are not {list(model.names)[1:]}")
    # Pinocchio's velocities for those of the arm's coordinates; 0 for a joint that is held.
    s = np.zeros((model.nv, arm.joints))
    for name in every.joint_names:
        follow = mimicry.following.get(name)
        leader, ratio = (name, 1.0) if follow is None else (follow.leader, follow.ratio)
        s[model.joints[model.getJointId(name)].idx_v, arm.joint_names.index(leader)] = ratio
    states = np.random.default_rng(7).uniform(-1.0, 1.0, (STATES, arm.joints))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        ours = states_of(arm, states, np.zeros_like(states))
    worst = 0.0
    for q, mass, gravity in zip(states, ours.mass, ours.bias, strict=True):
        there = pinocchio.neutral(model)
        for name, position in mimicry.held.items():
            there[places(model, name)] = turned(model, name, position)
        for name in every.joint_names:
            follow = mimicry.following.get(name)
            leader, ratio, offset = (name, 1.0, 0.0) if follow is None else (follow.leader, follow.ratio, follow.offset)
            there[places(model, name)] = turned(model, name, ratio * q[arm.joint_names.index(leader)] + offset)
        upper = np.triu(pinocchio.crba(model, data, there))
        theirs = s.T @ (upper + np.triu(upper, 1).T) @ s, s.T @ pinocchio.computeGeneralizedGravity(model, data, there)
        for own, other in zip((mass, gravity), theirs, strict=True):
            worst = max(worst, float(np.linalg.norm(own - other) / max(np.linalg.norm(other), SMALL)))
    return worst


def repaired(path: Path) -> str:
    """The file with the nearest inertias that a body can have; empty if it needs no other."""
    root = read_robot_file(path, "robot", "").root
    changed = False
    for element in root.iterfind("link/inertial/inertia"):
        matrix = np.zeros((3, 3))
        for (i, j), name in ENTRIES.items():
            matrix[i, j] = matrix[j, i] = float(element.get(name, "0"))
        if is_rigid(matrix):
            continue
        changed = True
        close = nearest_rigid(matrix)
        for place, name in ENTRIES.items():
            element.set(name, repr(float(close[place])))
    return ElementTree.tostring(root, encoding="unicode") if changed else ""


def places(model: pinocchio.Model, name: str) -> slice:
    """Pinocchio's indices of a joint's position."""
    joint = model.joints[model.getJointId(name)]
    return slice(joint.idx_q, joint.idx_q + joint.nq)


def turned(model: pinocchio.Model, name: str, position: float) -> list[float]:
    """A joint's position in Pinocchio: cosine and sine for a continuous joint."""
    return [position] if model.joints[model.getJointId(name)].nq == 1 else [np.cos(position), np.sin(position)]


@contextmanager
def console_off() -> Iterator[None]:
    """Silence the console while Pinocchio reads: it prints each element that it does not know."""
    sys.stderr.flush()
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def count_robot_files() -> None:
    """Count how many robot files of a folder are read, and why the others are not.

    Each `.urdf` file below the folder is read as it is, and with `inertias="nearest"`. A file counts as read if it
    gives an arm, with its only tip or with a tip that the refusal offers. With `--compare` M and gravity of each arm
    are compared with Pinocchio's at three random states; joints that follow others are projected on their leaders.
    Where `nearest` changed inertias, Pinocchio gets the same ones.
    """
    parser = argparse.ArgumentParser(description=count_robot_files.__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--compare", action="store_true", help="compare each arm with Pinocchio")
    parser.add_argument("--list", action="store_true", help="name the files that are refused")
    chosen = parser.parse_args()
    counts = {inertias: Counter[str]() for inertias in ("given", "nearest")}
    gaps: dict[str, float | None] = {}
    changes: dict[str, Counter[str]] = {inertias: Counter[str]() for inertias in counts}
    files = files_of(chosen.folder)
    if not files:
        sys.exit(f"there is no .urdf file below {chosen.folder}")
    for path in files:
        for inertias, counted in counts.items():
            with warnings.catch_warnings(record=True) as notes:
                warnings.simplefilter("always")
                arm, tip, refusal = arm_of(path, inertias)
            # The warning has the largest change first.
            change = re.search(r"changed to the nearest.*?\((\S+) %\)", "\n".join(str(note.message) for note in notes))
            if arm is not None and change:
                changes[inertias][change[1]] += 1
            counted[kind_of(refusal)] += 1
            name = str(path.relative_to(chosen.folder))
            if refusal and inertias == "given" and chosen.list:
                print(f"{name}: {refusal}", file=sys.stderr)
            if arm is not None and inertias == "nearest" and chosen.compare:
                gaps[name] = pinocchio_difference(path, tip, arm)
    print(f'{len(files)} files\n\n| | as given | `inertias="nearest"` |\n|---|---:|---:|')
    for kind in ("read", *REASONS, "other"):
        if any(counted[kind] for counted in counts.values()):
            print(f"| {kind} | {counts['given'][kind]} | {counts['nearest'][kind]} |")
    for inertias, counted in changes.items():
        listed = ", ".join(f"{change} % in {counted[change]}" for change in sorted(counted, key=float))
        print(f"\nLargest change of an inertia by `{inertias}`, of the largest principal moment: {listed or 'none'}")
    if chosen.compare:
        compared = {name: difference for name, difference in gaps.items() if difference is not None}
        print(
            f"\n{len(compared)} arms compared with Pinocchio, which refuses {len(gaps) - len(compared)} of the files: "
            f"{sum(gap > WITHIN for gap in compared.values())} differ by more than {WITHIN:g} of the norm; "
            f"the largest difference is {max(compared.values(), default=0.0):.1e}"
        )
        for name, difference in compared.items():
            if difference > WITHIN:
                print(f"{name}: {difference:.1e}")


ARMS, FURTHER = ROOT / "scripts" / "arm-payloads.yaml", ROOT / "scripts" / "further-arms.yaml"


def get_arms() -> int:
    """Get the robot files of a list, for `scripts/measure try-arms`.

    Git clones their repositories, without the files, into a temporary folder. A file whose checksum differs from that
    of the list is named, and kept.
    """
    parser = argparse.ArgumentParser(description=get_arms.__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--list", type=Path, default=ARMS, help="the list; by default scripts/arm-payloads.yaml")
    parser.add_argument(
        "--from",
        default="https://github.com/{repository}",
        help="of a repository, with {repository}, or {joined} for OWNER+NAME",
    )
    options = parser.parse_args()
    arms = yaml.safe_load(options.list.read_text(encoding="utf-8"))
    options.folder.mkdir(parents=True, exist_ok=True)
    repositories: dict[str, dict[str, str]] = {}
    for name, arm in arms.items():
        repository, _, path = arm["file"].partition(": ")
        repositories.setdefault(repository, {})[name] = path
    missing = []
    for repository, paths in repositories.items():
        with tempfile.TemporaryDirectory() as clone:
            cloned = ["git", "clone", "--quiet", "--bare", "--depth", "1", "--filter", "blob:none"]
            url = getattr(options, "from").format(repository=repository, joined=repository.replace("/", "+"))
            subprocess.run([*cloned, url, clone], check=True)
            for name, path in paths.items():
                shown = subprocess.run(["git", "-C", clone, "show", f"HEAD:{path}"], capture_output=True, check=False)
                if shown.returncode:
                    missing.append(name)
                    print(f"{name}: {repository} has no {path}")
                    continue
                (options.folder / f"{name}{Path(path).suffix}").write_bytes(shown.stdout)
                digest, known = hashlib.sha256(shown.stdout).hexdigest()[:16], arms[name].get("sha256")
                print(
                    f"{name}: {len(shown.stdout)} bytes, {'as known' if digest == known else f'{digest}, not {known}'}"
                )
    return 1 if missing else 0


def known_arms() -> dict[str, dict[str, object]]:
    """The arms of both lists by the stems of their files."""
    return {**yaml.safe_load(ARMS.read_text()), **yaml.safe_load(FURTHER.read_text())}


SHARE = 0.6
SETTLED = 2.0


def try_arms() -> None:
    """Simulate every robot file in a folder with the scenario that `slidax new` writes for it.

    The true arm of a case has, by a seed from the file's name and the case's number: rotors of 0.001 to 0.01 kg m² for
    each N m of rated torque, per joint and log-uniform; all masses and inertias times 0.8 to 1.2; 60 % of the rated
    payload, 5 cm in front of the tip, unknown to the law; Coulomb friction of 1 % of the rating. The scenario has the
    rated torques, and the lists of arms in scripts have the payloads. Where they have none, the payload keeps the
    joints below half of their torques in every posture. An arm holds if from 2 s on no joint is farther from its
    motion than 5 times the period [rad/s].

    With `--rated`, `slidax new` gets the whole payload, the cases carry 10 to 100 % of it in equal steps, and an arm
    holds if it also stays inside its envelope from the start. A case is feasible if the torque along the motion, by
    inverse dynamics of the true arm, is at most 90 % of each limit.
    """
    parser = argparse.ArgumentParser(description=try_arms.__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rates", default="1000,500,250")
    parser.add_argument("--cases", type=int, default=10)
    parser.add_argument("--schemes", default="cftsmppc")
    parser.add_argument("--arms", default="", help="stems of files; by default all")
    parser.add_argument("--set", type=setting, action="append", default=[], help="of the scenario, PATH=VALUE")
    parser.add_argument("--explain", action="store_true", help="explain runs that do not hold")
    parser.add_argument("--rated", action="store_true", help="payloads up to the rating, which `slidax new` gets")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    known = known_arms()
    files = sorted(path for path in options.folder.iterdir() if path.suffix.lower() in (".urdf", ".xml"))
    if options.arms:
        files = [path for path in files if path.stem in options.arms.split(",")]
    out = options.out.open("a") if options.out else None
    for file in files:
        for rate in map(float, options.rates.split(",")):
            for scheme in options.schemes.split(","):
                started = time.perf_counter()
                try:
                    changes = {} if scheme == "cftsmppc" else {"scheme.name": scheme}
                    payload = known.get(file.stem, {}).get("payload")
                    rows = simulate_cases(
                        file, rate, changes | dict(options.set), options.cases, payload, options.explain, options.rated
                    )
                    rows = [{**row, "scheme": scheme} for row in rows]
                except sx.DefinitionError as error:
                    print(f"{file.stem} {rate:g} Hz {scheme}: {error}", flush=True)
                    continue
                held = sum(row["held"] for row in rows)
                bad = "; ".join(
                    f"case {row['case']}: {row['worst'] * 1e3:.1f} mrad at joint {row['joint']}"
                    for row in rows
                    if not row["held"]
                )
                took = time.perf_counter() - started
                feasible = f", {sum(row['feasible'] for row in rows)} are feasible" if options.rated else ""
                print(
                    f"{file.stem} {rate:g} Hz {scheme}: {held} of {len(rows)} hold{feasible} ({took:.0f} s) {bad}",
                    flush=True,
                )
                for row in rows:
                    if options.explain and not row["held"]:
                        print(f"    case {row['case']}: {' '.join(row['why'])}", flush=True)
                if out:
                    out.writelines(json.dumps(row) + "\n" for row in rows)
                    out.flush()


def simulate_cases(
    file: Path,
    rate: float,
    changes: dict[str, object],
    cases: int,
    payload: float | None,
    explain: bool,
    rated: bool = False,
) -> list[dict[str, object]]:
    """Simulate an arm's random cases at one rate."""
    scenario = drafted(file, rate, changes)
    torque = np.asarray(scenario.plant.actuator.limits.torque)
    whole = payload or allowed(scenario, torque)
    if rated:
        scenario = drafted(file, rate, changes, whole)
    loads = whole * (1.0 - np.arange(cases) / cases) if rated else np.full(cases, SHARE * whole)
    return [run(scenario, file.stem, rate, case, float(load), explain, rated) for case, load in enumerate(loads)]


def drafted(file: Path, rate: float, changes: dict[str, object], payload: float = 0.0) -> sx.scenarios.Scenario:
    """The scenario that `slidax new` writes for a robot file."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", sx.DefinitionWarning)
        path = Path(folder) / f"{file.stem}.yaml"
        path.write_text(draft(file.resolve(), rate, payload=payload, folder=Path(folder).resolve()).text)
        return sx.scenarios.load(path, changes)


def run(scenario, name, rate, case, carried, explain, rated):
    """Simulate one random case, and return its row."""
    limits = np.asarray(scenario.plant.actuator.limits.torque)
    chance = np.random.default_rng([zlib.crc32(name.encode()), case])
    rotors = limits * np.exp(chance.uniform(np.log(1e-3), np.log(1e-2), len(limits)))
    factor = float(chance.uniform(0.8, 1.2))
    ball = Payload(jnp.asarray(carried), jnp.asarray([0.0, 0.0, 0.05]), jnp.asarray(0.0025 * carried) * jnp.eye(3))
    true = Mismatch(mass_factor=factor, coulomb=0.01 * limits, armature=rotors).applied(scenario.controller.nominal)
    old = scenario.plant
    plant = sx.Plant(true, old.disturbance, old.sensor, old.actuator, TimedPayload(ball))
    true_scenario = scenario.replace(plant=plant)
    done = true_scenario.simulate(log_every=max(1, round(rate / 250)))
    late = np.asarray(done.log.t) > SETTLED
    error = np.abs(np.asarray(done.log.e)[late])
    worst = error.max(axis=0) if len(error) else np.full(len(limits), np.inf)
    outside = int(sx.analysis.summary(done)["envelope_violations"] or 0)
    torque = np.abs(np.asarray(done.log.tau)) > 0.999 * limits
    held = bool(worst.max() < 5.0 / rate) and not (rated and outside)
    return {
        "arm": name,
        "rate": rate,
        "case": case,
        "held": held,
        "feasible": is_feasible(true_scenario, TimedPayload(ball), limits),
        "outside": outside,
        "worst": float(worst.max()),
        "joint": int(worst.argmax()) + 1,
        "steady": float(max(sx.analysis.steady_error(done))),
        "step": float(max(np.asarray(sx.analysis.steady_torque_step(done)) / limits)),
        "at_limit": float(torque.mean(axis=0).max()),
        "payload": carried,
        "mass_factor": factor,
        "rotors": rotors.tolist(),
        "why": [] if held or not explain else why(true_scenario),
    }


RESERVE = 0.9
"""Share of the torque limits that a feasible motion needs at most."""


def is_feasible(scenario, load, limits):
    """True if the true arm with its payload and friction needs at most 90 % of each torque limit along the motion."""
    arm, times = load.on(scenario.plant.robot, jnp.asarray(1.0)), jnp.linspace(0.0, scenario.t1, 801)
    reference = jax.vmap(scenario.trajectory.reference)(times)
    states = states_of(arm, np.asarray(reference.q), np.asarray(reference.dq))
    friction = np.asarray(jax.vmap(arm.friction)(reference.dq))
    return bool((np.abs(states.torque(np.asarray(reference.ddq)) + friction) <= RESERVE * limits).all())


def why(scenario):
    """Causes in the log, likeliest first, as `slidax explain` prints them, without tried remedies."""
    try:
        record = RunRecord.of(scenario, scenario.simulate(log_every=1, progress=False))
        return [f"{answer.finding.evidence}." for answer in explain(scenario, record, tries=False)]
    except sx.DefinitionError as error:
        return [str(error)]


def allowed(scenario, rated):
    """The payload that takes a joint to half of its peak torque, in the worst of 256 postures [kg]."""
    arm = scenario.controller.nominal
    reach = np.where(np.array(arm.joint_units) == "rad", np.pi, 0.5)
    lower, upper = (np.clip(np.asarray(end), -reach, reach) for end in (arm.limits.lower, arm.limits.upper))
    q = spread_in_box(lower, upper, 256)
    ball = Payload(jnp.asarray(1.0), jnp.asarray([0.0, 0.0, 0.05]), jnp.zeros((3, 3)))
    own, loaded = states_of(arm, q).bias, states_of(TimedPayload(ball).on(arm, jnp.asarray(1.0)), q).bias
    room = np.maximum(0.5 * rated - np.abs(own), 0.0) / np.maximum(np.abs(loaded - own), 1e-9)
    return float(room.min())


def setting(text):
    """Split PATH=VALUE."""
    path, _, value = text.partition("=")
    return path, yaml.safe_load(value)


def write_any_arm() -> None:
    """Write a table of docs/robots.md from the results of `scripts/measure try-arms`."""
    parser = argparse.ArgumentParser(description=write_any_arm.__doc__)
    parser.add_argument("results", type=Path, nargs="+")
    parser.add_argument("--table", choices=("twenty", "further"), default="twenty")
    options = parser.parse_args()
    rows = [json.loads(line) for path in options.results for line in path.read_text().splitlines()]
    known = known_arms()
    scheme, *others = dict.fromkeys(row["scheme"] for row in rows)
    rates = sorted({row["rate"] for row in rows}, reverse=True)

    def maker(arm):
        return known.get(arm, {}).get("maker", arm)

    def held(some):
        return f"{sum(row['held'] for row in some)} of {len(some)}"

    def worst(some):
        return f"{max((row['worst'] for row in some), default=0.0) * 1e3:.1f}"

    def of(**fields):
        return [row for row in rows if all(row[key] == value for key, value in fields.items())]

    arms = sorted({row["arm"] for row in rows})
    heads = "".join(f" {rate:g} Hz |" for rate in rates)
    feasible = f", {sum(row['feasible'] for row in rows)} are feasible" if options.table == "further" else ""
    lines = [f"`{scheme}`: {held(of(scheme=scheme))} runs hold{feasible}.", ""]
    lines += [f"| arm | payload [kg] |{heads} worst error [mrad] |", f"|---|---:|{'---:|' * len(rates)}---:|"]
    for arm in arms:
        at = [of(scheme=scheme, arm=arm, rate=rate) for rate in rates]
        cells = "".join(f" {held(some)} |" for some in at)
        payload = max(row["payload"] for row in of(scheme=scheme, arm=arm))
        lines.append(f"| {maker(arm)} | {payload:.2g} |{cells} {', '.join(map(worst, at))} |")
    lines.append("")
    for row in of(scheme=scheme, held=False):
        lines.append(
            f"- {maker(row['arm'])}, {row['rate']:g} Hz, case {row['case']}: "
            f"joint {row['joint']} is {row['worst'] * 1e3:.1f} mrad off."
        )
    if others:
        lines += ["", "Runs that hold, and the worst error [mrad] of all of them:", ""]
        lines += [f"| arm | {' | '.join(f'`{other}`' for other in others)} |", f"|---|{'---:|' * len(others)}"]
        for arm in arms:
            mine = [of(scheme=other, arm=arm) for other in others]
            lines.append(f"| {maker(arm)} | {' | '.join(f'{held(some)}, {worst(some)}' for some in mine)} |")
        lines.append(f"| all | {' | '.join(held(of(scheme=other)) for other in others)} |")
    write_table("robots.md", options.table, "\n".join(lines).rstrip())
