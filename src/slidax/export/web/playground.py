"""The playground: one HTML file with arms, settings and programs, which needs no server."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import slidax
from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.arms.rotations import quaternion_of
from slidax.core.errors import DefinitionError
from slidax.core.writing import error_reason, write_text
from slidax.motions.trajectory import AbstractMotion
from slidax.report.replay.skeleton import Skeleton, skeleton_of
from slidax.scenarios.load import read_description, validate_text
from slidax.scenarios.scenario import Scenario, ScenarioDescription

from .settings import PRINTED, BuiltSetting, PageSetting, ProgramChoice, settings_of

LINK, JOINT, TIP = 0, 1, 2
"""Colour tones of shapes; the page assigns the colours."""

THICK = 0.04
"""Radius of the bones at the base, relative to the arm's reach; at the tip the radius is half of that."""

INSTANTS = 200
"""Number of times at which a motion is evaluated to find the travel of its joints."""


def arm_entry(
    robot: AbstractRobot, label: str, title: str, torque: Any, rate: Any, trajectory: AbstractMotion, t1: float
) -> dict[str, Any]:
    """Return an arm's entry in the manifest, the data of a page: kinematics, shapes and limits.

    - `label`, `title`: the arm's identifier in the manifest, and its title on the page.
    - `torque`, `rate`: limits of torque [n], N m or N, and torque rate [n], N m/s or N/s; infinite without a limit.
    - `trajectory`, `t1`: the arm's motion and its end time [s]. They determine how long the rods of prismatic joints
      are drawn.
    """
    bones = skeleton_of(robot)
    times = jnp.linspace(0.0, t1, INSTANTS)
    travel = np.abs(bones.positions(np.asarray(jax.vmap(trajectory.position)(times)))).max(axis=0)
    kinematics = [
        {
            "name": name,
            "parent": parent,
            "origin": [*_plain(position), *_plain(quaternion_of(np.asarray(turn)))],
            "axis": [0.0, 0.0, 1.0],
            "type": "revolute" if revolute else "prismatic",
            **_moved_by(bones, joint),
        }
        for joint, (name, parent, revolute, turn, position) in enumerate(
            zip(bones.names, bones.parents, bones.revolute, bones.rotations, bones.translations, strict=True)
        )
    ]
    return {
        "id": label,
        "title": title,
        "joints": bones.joints,
        "kinematics": kinematics,
        "shapes": _shapes(bones, np.asarray(travel)),
        "tip": {"link": bones.tip_joint, "at": _plain(bones.tip_translation)},
        "up": _plain(bones.up),
        "limits": {"torque": _limit(torque, bones.joints), "rate": _limit(rate, bones.joints)},
        "joint_limits": _joint_limits(robot),
    }


def _moved_by(bones: Skeleton, joint: int) -> dict[str, Any]:
    """Return the index of the driven joint that moves a joint, and for a follower its ratio and offset."""
    coupling = bones.coupling
    if coupling is None:
        return {"joint": joint}
    leader: dict[str, Any] = {"joint": coupling.leaders[joint]}
    if bones.names[joint] in coupling.driven:
        return leader
    return leader | {"follows": {"ratio": float(coupling.ratios[joint]), "offset": float(coupling.offsets[joint])}}


def _shapes(bones: Skeleton, travel: np.ndarray) -> list[dict[str, Any]]:
    """Return the shapes that draw an arm: joints, the bones between them, the tip and the base.

    A revolute joint is a cylinder around its axis, a prismatic joint a cylinder with a rod that slides in it.

    - `travel`: largest distance of each of m joints from 0 along the motion [m], rad or m.
    """
    radii = _radii(bones)
    shapes: list[dict[str, Any]] = []
    for joint, parent in enumerate(bones.parents):
        r = radii[joint + 1]
        shapes += _bone(parent, bones.translations[joint], radii[parent + 1])
        if bones.revolute[joint]:
            shapes.append(_shape(joint, "cylinder", [1.2 * r, 2.5 * r], np.zeros(3), np.eye(3), JOINT))
        else:
            position, turn = bones.translations[joint], bones.rotations[joint]
            shapes.append(_shape(parent, "cylinder", [1.3 * r, 3.0 * r], position, turn, JOINT))
            rod = 0.15 * bones.reach + float(travel[joint])
            shapes.append(_shape(joint, "capsule", [0.5 * r, rod], np.array([0, 0, -0.5 * rod]), np.eye(3), LINK))
    tip, end = bones.tip_joint, radii[bones.tip_joint + 1]
    shapes += _bone(tip, bones.tip_translation, 0.7 * end)
    shapes.append(_shape(tip, "sphere", [0.75 * end], bones.tip_translation, np.eye(3), TIP))
    base = radii[0]
    along = _towards(bones.up)
    return [_shape(-1, "cylinder", [1.8 * base, 0.8 * base], -0.4 * base * bones.up, along, JOINT), *shapes]


def _bone(link: int, end: np.ndarray, radius: float) -> list[dict[str, Any]]:
    length = float(np.linalg.norm(end))
    if length < 0.2 * radius:
        return []
    return [_shape(link, "capsule", [0.85 * radius, length], 0.5 * end, _towards(end / length), LINK)]


def _shape(
    link: int, kind: str, size: list[float], position: np.ndarray, turn: np.ndarray, tone: int
) -> dict[str, Any]:
    at = [*_plain(position), *_plain(quaternion_of(np.asarray(turn)))]
    return {"link": link, "kind": kind, "size": _plain(np.asarray(size)), "at": at, "tone": tone}


def _radii(bones: Skeleton) -> np.ndarray:
    """Return the radius of each body, the base first [bodies], m."""
    far = np.zeros(bones.bodies)
    for joint, parent in enumerate(bones.parents):
        far[joint + 1] = far[parent + 1] + np.linalg.norm(bones.translations[joint])
    return THICK * bones.reach * (1.0 - 0.5 * np.minimum(far / bones.reach, 1.0))


def _towards(direction: np.ndarray) -> np.ndarray:
    """Return a rotation matrix that maps the z axis to a direction."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction], axis=1)


def _plain(numbers: Any) -> list[float]:
    """Return the numbers as a list, rounded to 7 digits, which are enough for a picture."""
    return [float(f"{value:.7g}") if abs(value) > 1e-9 else 0.0 for value in np.asarray(numbers, float).ravel()]


def _limit(values: Any, joints: int) -> list[float] | None:
    each = np.broadcast_to(np.asarray(values, float), (joints,))
    return each.tolist() if np.isfinite(each).all() else None


def _joint_limits(robot: AbstractRobot) -> dict[str, Any] | None:
    limits = robot.limits if isinstance(robot, Articulated | Coupled) else None
    if limits is None or not np.isfinite([limits.lower, limits.upper]).all():
        return None
    return {"lower": _plain(limits.lower), "upper": _plain(limits.upper)}


FORMAT = 1
"""Version of the manifest's format, which the page checks."""


NOTHING: dict[str, Any] = {"c_files": None, "c_parameters": None, "certificates": []}


def playground(
    title: str,
    settings: Sequence[PageSetting],
    arms: dict[str, str],
    *,
    promised: bool = True,
    begin: Callable[[str, int], None] = lambda name, total: None,
) -> dict[str, Any]:
    """Build the settings, and return the manifest of a page: the data that `page_text` embeds.

    - `settings`: one arm with one scheme each; the page opens with the first.
    - `arms`: titles of the arms, by their identifiers in the settings.
    - `promised`: include the law in C and its certificates, which take most of the time.
    - `begin`: called before each setting with its name and the number of settings.

    Raises DefinitionError if a setting is invalid or cannot run in a page.
    """
    built, entries = [], []
    for setting in settings:
        begin(f"{setting.arm}, {setting.scheme}", len(settings))
        law = setting.build()
        built.append(law)
        entries.append({**law.entry(), **(law.beside() if promised else NOTHING)})
    programs = {program.entry["id"]: dict(program.entry) for setting in built for _, program in setting.programs}
    first = settings[0]
    return {
        "format": FORMAT,
        "title": title,
        "made_by": f"slidax {slidax.__version__}",
        "first": {"arm": first.arm, "scheme": first.scheme},
        "arms": [_arm(label, name, built) for label, name in arms.items()],
        "programs": list(programs.values()),
        "settings": entries,
    }


def _arm(label: str, title: str, settings: Sequence[BuiltSetting]) -> dict[str, Any]:
    built = next(each for each in settings if each.setting.arm == label).templates.built
    limits = getattr(built.plant.actuator, "limits", None)
    torque, rate = (np.inf, np.inf) if limits is None else (limits.torque, limits.rate)
    return arm_entry(built.plant.robot, label, title, torque, rate, built.trajectory, built.t1)


TITLE = "slidax playground"

PERIODS = ProgramChoice("simulation.period", "sampling period", "s", (0.0005, 0.001, 0.002))
DELAYS = ProgramChoice("sensor.delay", "delay of a measurement", "periods", (0.0, 1.0))
ENCODERS = ProgramChoice("sensor.resolution", "resolution of the encoders", "rad", (0.0, 1e-5))
COARSER = ProgramChoice("sensor.resolution", "resolution of the encoders", "rad", (1e-5, 5e-5))
SLOWER = ProgramChoice("simulation.period", "sampling period", "s", (0.001, 0.002))


@dataclass(frozen=True)
class PlaygroundArm:
    """An arm of the playground.

    - `scenario`: name of a built-in scenario.
    - `arm`, `title`: identifier of the arm in the manifest, and its title on the page.
    - `changes`: changes of the scenario that do not alter the run, but make friction or rotor inertia tunable.
    - `gains`: gains by name, for each compared scheme: the best from a grid search on this run
      (`scripts/figures/panda.py`).
    - `choices`: quantities of which the page offers a few values.
    """

    scenario: str
    arm: str
    title: str
    changes: dict[str, Any]
    gains: dict[str, dict[str, float]]
    choices: tuple[ProgramChoice, ...]

    @property
    def description(self) -> ScenarioDescription:
        """The scenario with `changes`; if there are none, with a friction disturbance of size 0, which is tunable."""
        description = read_description(self.scenario)
        changes = dict(self.changes)
        if not changes:
            terms = [term.model_dump(exclude_unset=True) for term in description.disturbance.terms]
            changes["disturbance.terms"] = [*terms, {"kind": "friction", "coulomb": 0.0, "viscous": 0.0}]
        return validate_text(description.model_dump(exclude_unset=True), changes)


ARMS = (
    PlaygroundArm(
        "example-4.1-1khz",
        "two_link",
        "Two-link arm",
        {},
        {
            "computed_torque": {"kp": 3200.0, "kd": 320.0},
            "slotine_li": {"rate": 80.0, "damping": 40.0, "gain": 20.0, "layer": 0.05},
            "super_twisting": {"rate": 80.0, "k1": 30.0, "k2": 100.0},
        },
        (PERIODS, DELAYS, ENCODERS),
    ),
    PlaygroundArm(
        "example-4.2-1khz",
        "scara",
        "SCARA arm",
        {},
        {
            "computed_torque": {"kp": 500.0, "kd": 80.0},
            "slotine_li": {"rate": 80.0, "damping": 2.5, "gain": 2.5, "layer": 0.05},
            "super_twisting": {"rate": 80.0, "k1": 30.0, "k2": 1.0},
        },
        (PERIODS, DELAYS, ENCODERS),
    ),
    PlaygroundArm(
        "panda-payload",
        "panda",
        "Franka Panda",
        {"robot.plant.armature": 0.1},
        {
            "computed_torque": {"kp": 600.0, "kd": 240.0},
            "slotine_li": {"rate": 80.0, "damping": 2.5, "gain": 20.0, "layer": 0.1},
            "super_twisting": {"rate": 80.0, "k1": 20.0, "k2": 300.0},
        },
        (SLOWER, DELAYS, COARSER),
    ),
)
"""Arms of the playground, in the order of display."""


def manifest_of_all(begin: Callable[[str, int], None] = lambda name, total: None) -> dict[str, Any]:
    """Return the manifest, the data of a page, for the playground with all arms.

    - `begin`: called before each setting with its name and the number of settings.
    """
    settings = [
        setting
        for shown in ARMS
        for setting in settings_of(shown.description, shown.arm, [PRINTED, *shown.gains], shown.gains, shown.choices)
    ]
    return playground(TITLE, settings, {shown.arm: shown.title for shown in ARMS}, begin=begin)


PAGE = resources.files(str(__package__)) / "page"

POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
    "worker-src blob:; img-src data: blob:; connect-src 'none'; form-action 'none'; base-uri 'none'"
)
"""Content security policy: no network access."""

_IMPORT = re.compile(r'^import \{([^}]*)\} from "\./([a-z_]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?function|class|const|let)", re.MULTILINE)


def page_text(
    manifest: Mapping[str, Any],
    *,
    scripts: Sequence[str] = (),
    styles: Sequence[str] = (),
    loop: str | None = None,
    policy: str | None = POLICY,
) -> str:
    """Return the text of one HTML file that shows a playground.

    - `manifest`: data from `playground`: arms, programs and settings.
    - `scripts`, `styles`: additional scripts before the page's own script, and styles after its own style.
    - `loop`: text of the JavaScript module that runs a program; by default the page's own `loop.js`.
    - `policy`: content security policy in the page; None leaves it to the header that a server sends.
    """
    replaced = {} if loop is None else {"loop.js": loop}
    title = str(manifest.get("title", "slidax"))
    parts = {
        "title": _escaped(title),
        "policy": "" if policy is None else f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
        "style": "\n".join([_source("style.css"), *styles]),
        "playground": json.dumps(manifest, ensure_ascii=False, allow_nan=False, separators=(",", ":")).replace(
            "<", "\\u003c"
        ),
        "worker": module_text("worker.js", replaced),
        "scripts": "\n".join(f"<script>\n{script}\n</script>" for script in scripts),
        "main": module_text("main.js", replaced),
    }
    return re.sub(r"\{\{ (\w+) \}\}", lambda match: parts[match[1]], _source("index.html"))


def module_text(entry: str, replaced: Mapping[str, str] | None = None) -> str:
    """Bundle a JavaScript module and all its imports as the text of one module.

    - `entry`: file name of the module.
    - `replaced`: texts by file name, which replace the files of these names.

    Raises ValueError for circular imports.
    """
    done: dict[str, str] = {}
    _gather(entry, replaced or {}, done, ())
    return "\n".join(done.values())


def _gather(name: str, replaced: Mapping[str, str], done: dict[str, str], above: tuple[str, ...]) -> None:
    if name in done:
        return
    if name in above:
        raise ValueError("modules import each other: " + " -> ".join([*above, name]))
    text = replaced[name] if name in replaced else _source(name)
    for match in _IMPORT.finditer(text):
        _gather(match[2], replaced, done, (*above, name))
    done[name] = _EXPORT.sub("", _IMPORT.sub("", text)).strip() + "\n"


def _source(name: str) -> str:
    return (PAGE / name).read_text(encoding="utf-8")


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")


PAGE_FILE = "index.html"

FEW = 3
"""Largest number of joints for which a program compiles in seconds, so that the page offers more than two delays."""


def manifest_of_scenario(
    scenario: Scenario, compared: Sequence[str] = (), begin: Callable[[str, int], None] = lambda name, total: None
) -> dict[str, Any]:
    """Return the manifest, the data of a page, for one scenario.

    - `compared`: names of schemes to compare, and `printed` for the law as printed in the paper.
    - `begin`: called before each setting with its name and the number of settings.

    Raises DefinitionError if a scheme does not exist, or the scenario cannot run in a page.
    """
    description = scenario.description
    settings = settings_of(description, scenario.robot, compared, choices=_choices(description))
    arms = {scenario.robot: scenario.robot.replace("_", " ")}
    return playground(description.title, settings, arms, begin=begin)


def _choices(description: ScenarioDescription) -> list[ProgramChoice]:
    """Return the choices that a page offers for period and measurement delay; none unless the law is sampled-data."""
    simulation, delay = description.simulation, description.sensor.delay
    if description.scheme.sampled_data is None:
        return []
    # All periods share one program, but each delay needs another program.
    delays = {0.0, 1.0, delay} if len(description.start.q) <= FEW else {0.0, delay or 1.0}
    periods = (simulation.period / 2, simulation.period, simulation.period * 2)
    whole = round(simulation.t1 / simulation.period) % 2 == 0
    return [
        ProgramChoice("simulation.period", "sampling period", "s", periods if whole else periods[:2]),
        ProgramChoice("sensor.delay", "delay of a measurement", "periods", tuple(sorted(delays))),
    ]


def write_playground(manifest: Mapping[str, Any], out: str | Path) -> Path:
    """Write the HTML page to the folder `out`; return the path of the page.

    - `manifest`: the page's JSON data, from `manifest_of_scenario` or `manifest_of_all`.

    Raises DefinitionError if the page cannot be written.
    """
    page = Path(out, PAGE_FILE)
    try:
        page.parent.mkdir(parents=True, exist_ok=True)
        write_text(page, page_text(manifest))
    except OSError as error:
        raise DefinitionError(f"cannot write the page to `{out}`: {error_reason(error)}") from None
    return page
