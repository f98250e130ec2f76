"""Random motions, streams and goals of an identified arm: how many a certified law admits, and how well it tracks them.

`admit` decides on motions and streams; an exported law's own admission decides on goals, which are then run in MuJoCo.
"""

from __future__ import annotations

import argparse
import ctypes
import dataclasses
import subprocess
import tempfile
import time
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import mujoco
import numpy as np
import yaml

import slidax.arms as arms
from slidax.certify.motion.admission import admit, certified_law
from slidax.certify.motion.body_points import BodyPoints
from slidax.certify.motion.certified_law import CertifiedLaw
from slidax.certify.motion.joint_loop import JointLoop
from slidax.certify.motion.path_cells import Pieces
from slidax.certify.motion.tracking_bound import ArmUncertainty
from slidax.export import export_c
from slidax.export.admission import PIECES
from slidax.identify import excite, identify, write_arm
from slidax.motions import Streamed, StreamFilter
from slidax.scenarios import load
from tests.certify.motion import cases
from tests.certify.motion.campaign import LIMITED, REJECTED
from tests.certify.motion.plant import Chain
from tests.export.test_admission import REASONS, CompiledAdmission
from tests.identify.recorded import recorded

from .shared import ROOT

SUBSTEPS, REST, MEMBERS = 2, 0.3, 40
"""Steps of MuJoCo in a period, seconds after a motion, and number of arms in MuJoCo."""

SCENARIO = """
title: goals of a planner
robot: {{kind: identified, file: arm.yaml}}
uncertainty: {{file: arm.yaml}}
trajectory: {{kind: minimum_jerk, times: [0, 1], waypoints: [{home}, {home}]}}
start: {{q: {home}}}
sensor: {{resolution: {resolution}, velocity: differenced, delay: 1}}
actuator: {actuator}
scheme:
  name: computed_torque
  horizon: {horizon}
  sampled_data:
    midpoint: true
    viscous_feedforward: true
    adaptation: null
    estimator: {{kind: kalman, acceleration_density: {density}}}
simulation: {{mode: held, period: {period}, t1: 1.0}}
"""

ARMS: dict[str, dict[str, Any]] = {
    "panda": {
        "period": 1e-3,
        "horizon": 0.012,
        "density": 0.3,
        "resolution": 1e-6,
        "actuator": "{torque: robot, rate: robot}",
        "payload": 2.0,
    },
    "ur5e": {
        "period": 2e-3,
        "horizon": 0.02,
        "density": 10.0,
        "resolution": 1e-5,
        "actuator": "{torque: robot}",
        "payload": 3.0,
    },
}
OTHER = {"period": 1e-3, "payload": 2.0}
"""Of an arm from a file: its sampling period [s] and payload [kg]."""
ALLOWED = {"panda": 3e-3, "ur5e": 5e-3}
"""Largest error [rad]."""


@cache
def identified(name: str, seconds: float, tip: str | None = None) -> tuple[Any, Any]:
    """The true arm, with a payload and friction of 0.3 N m, and what a log with 1 % of torque noise identifies.

    The arm that is known beforehand is that of the data sheet, without payload and with other rotors and friction.
    """
    known = getattr(arms, name)() if name in ARMS else arms.from_urdf(name, tip=tip)
    true = cases.loaded(known, ARMS.get(name, OTHER)["payload"])
    true = eqx.tree_at(lambda arm: arm.coulomb, true, jnp.full(true.joints, 0.3))
    rate = 1.0 / ARMS.get(name, OTHER)["period"]
    motion = excite(known, seed=0, duration=seconds, rate=rate, payload=true.payload, links=True).motion
    log = recorded(true, noise=0.01, seed=0, times_and_motion=(np.arange(len(motion.q)) / rate, motion))
    return true, identify(log, known, links=True)


def scenario_of(name: str, folder: Path) -> tuple[Any, Any]:
    """The scenario of an arm as a log of 20 s shows it, and the true arm."""
    true, result = identified(name, 20.0)
    write_arm(result, {"kind": name}, folder / "arm.yaml")
    low, high = cases.box(getattr(arms, name)())
    home = np.round(np.clip(0.5 * (low + high), -1.5, 1.5), 3).tolist()
    text = SCENARIO.format(home=home, **ARMS[name])
    (folder / "scenario.yaml").write_text(text, encoding="utf-8")
    return load(folder / "scenario.yaml"), true


def mujoco_arm(chain: Chain, coulomb: np.ndarray, timestep: float) -> mujoco.MjModel:
    """MuJoCo's model of an arm that is given as numbers."""
    spec, arm = mujoco.MjSpec(), chain.struct()
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = list(arm.gravity)
    parent = spec.worldbody
    for i in range(arm.n):
        parent = parent.add_body(pos=list(arm.pos[i]), quat=quaternion(np.array(arm.rot[i][:]).reshape(3, 3)))
        parent.explicitinertial, parent.mass, parent.inertia = True, 1.0, [1.0, 1.0, 1.0]
        joint = parent.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0], armature=arm.rotor[i])
        joint.damping[0], joint.frictionloss = arm.viscous[i], coulomb[i]
    model = spec.compile()
    # After the compiler, which refuses what no body can have: a log shows combinations of links, not each link.
    for i in range(arm.n):
        moments, axes = np.linalg.eigh(np.array(arm.inertia[i][:]).reshape(3, 3))
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        model.body_mass[i + 1], model.body_ipos[i + 1], model.body_inertia[i + 1] = arm.mass[i], arm.com[i][:], moments
        model.body_iquat[i + 1] = quaternion(axes)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """The quaternion of a rotation matrix."""
    result = np.empty(4)
    mujoco.mju_mat2Quat(result, rotation.ravel())
    return result


def members(law: Any, true: Any, file: Path, rng: np.random.Generator) -> list[mujoco.MjModel]:
    """The true arm, and others at the edge of the set in the identified arm's file."""
    band = yaml.safe_load(file.read_text(encoding="utf-8"))["uncertainty"]["robot.plant.inertial"]
    rows, p = np.array(band["deviations"]), float(band["band"])
    region, inputs = law.uncertainty.region(law.bodies), law.uncertainty.inputs(law.arm)
    bound = cases.MassBound(law.arm, cases.arm_parameters(law.arm))
    step, nominal = law.loop.period / SUBSTEPS, Chain.of(law.arm)
    models = [mujoco_arm(Chain.of(true), np.asarray(true.coulomb), step)]
    for _ in range(MEMBERS - 1):
        share = rng.normal(size=len(region.deviations))
        share /= np.linalg.norm(share)
        share *= min(1.0, p / float(bound.of(share[None] @ rows)[0]))
        bodies, rotors = (np.tensordot(share, part, axes=1) for part in (region.deviations, region.rotor_deviations))
        arm = nominal.deviated(bodies, rotors)
        viscous = np.maximum(arm.viscous + rng.choice([-1.0, 1.0], size=law.arm.joints) * inputs.viscous_error, 0.0)
        size = rng.choice([0.0, 1.0, 1.0], size=law.arm.joints)
        models.append(mujoco_arm(Chain(**{**vars(arm), "viscous": viscous}), size * inputs.coulomb, step))
    return models


class Goals:
    """A law in C with its admission, and arms in MuJoCo that run it."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name = name
        self.scenario, true = scenario_of(name, folder)
        export_c(self.scenario, folder / "law", name="law", golden=False)
        self.admission = CompiledAdmission(self.scenario, folder / "law", "-O3", "-march=native")
        self.law = certified_law(self.scenario)
        self.models = members(self.law, true, folder / "arm.yaml", np.random.default_rng(1))
        self.data = [mujoco.MjData(model) for model in self.models]
        package = Path(mujoco.__file__).parent
        (library,) = package.glob("libmujoco.so.*")
        sources = [Path(__file__).with_name("goals.c"), *(folder / "law" / f"slidax_law{end}.c" for end in ENDS)]
        include = [f"-I{folder / 'law'}", f"-I{package / 'include'}"]
        built = ["-o", folder / "goals.so", library, f"-Wl,-rpath,{package}", "-lm"]
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", *include, *sources, *built], check=True)
        self.library = ctypes.CDLL(str(folder / "goals.so"))
        self.library.slidax_law_flat_size.restype = ctypes.c_size_t
        self.library.follow.restype = ctypes.c_uint32
        self.memory = ctypes.create_string_buffer(self.library.slidax_law_flat_size())
        self.library.slidax_law_flat_default(self.memory)

    def decide(self, plan: Any, slow_down: bool) -> Any:
        """The answer of the exported admission."""
        return self.admission.decide(plan, ALLOWED[self.name], True, slow_down)

    def run(self, plan: Any, member: int) -> tuple[np.ndarray, int]:
        """Largest error of each joint [n], and all bits of the status."""
        worst = np.zeros(self.admission.joints)
        bits = self.library.follow(
            *(ctypes.c_void_p(each._address) for each in (self.models[member], self.data[member])),
            self.memory,
            ctypes.byref(plan),
            ctypes.c_double(self.law.loop.period),
            SUBSTEPS,
            1,
            ctypes.c_double(REST),
            ctypes.c_double(ARMS[self.name]["resolution"]),
            worst.ctypes.data_as(ctypes.c_void_p),
        )
        return worst, bits


ENDS = ("", "_flat", "_admission")


def random_goal(index: int, arm: Any, rng: np.random.Generator) -> Any:
    """From rest to rest between random postures, at 0.1 to 1 of the arm's speeds: a quintic, or a planner's points."""
    share = rng.uniform(0.1, 1.0)
    return cases.knotted(arm, rng, share, most=PIECES) if index % 2 else cases.quintic(arm, rng, share)


def is_true(answer: Any, motion: Any, law: Any, name: str) -> bool | None:
    """Return whether `slidax admit` or the motion confirms joint and limit; None if it admits the motion.

    C has room for 6144 cells, and takes longer ones where a motion needs more, which makes its bound larger.
    """
    what, limits = REASONS.get(answer.reason), law.arm.limits
    if what in ("position", "speed"):
        q, dq, *_ = (part[0, answer.joint] for part in Pieces.of(motion).at(np.array([answer.time])))
        if what == "speed":
            size = abs(answer.value)
            return bool(abs(abs(dq) - size) < 1e-6 and size > float(limits.velocity[answer.joint]))
        return not float(limits.lower[answer.joint]) <= q <= float(limits.upper[answer.joint])
    there = admit(law, motion, allowed=ALLOWED[name], assume_steps=True, slow_down=False).limit
    if there is None:
        return None
    return there.what == what and there.joint == law.arm.joint_names[answer.joint]


def reason_of(answer: Any, law: Any) -> str:
    """The refusal in words."""
    joint, what = law.arm.joint_names[answer.joint], REASONS.get(answer.reason)
    return f"{what} of {joint} at {answer.time:.3f} s: {answer.value:.4g}, allowed {answer.limit:.4g}"


def measure_goals() -> None:
    """Decide on random goals in C, run the admitted and the slowed ones in MuJoCo, and check some refusals."""
    parser = argparse.ArgumentParser(description=measure_goals.__doc__)
    parser.add_argument("--arm", choices=sorted(ARMS), default="panda")
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--compared", type=int, default=40, help="refusals that are compared with `slidax admit`")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        goals = Goals(options.arm, Path(folder))
    rng, law = np.random.default_rng(options.seed), goals.law
    print(f"{options.arm}: p = {100 * law.uncertainty.region(law.bodies).p:.2f} %", flush=True)
    counts: Counter[str] = Counter()
    shares, factors, seconds, longest = [], [], [], 0.0
    for index in range(options.count):
        motion = random_goal(index, law.arm, rng)
        plan = goals.admission.plan(motion)
        begun = time.process_time()
        first = goals.decide(plan, slow_down=True)
        if first.reason == 0:
            seconds.append(time.process_time() - begun)
        counts["admitted as it is" if first.reason == 0 else f"refused: {REASONS.get(first.reason, 'no motion')}"] += 1
        bound = np.array(first.error[:])
        if first.reason:
            if counts["compared"] < options.compared:
                counts["compared"] += 1
                confirmed = is_true(first, motion, law, options.arm)
                counts["confirmed"] += confirmed is True
                counts["admitted by `slidax admit`"] += confirmed is None
                if confirmed is False:
                    print(f"  goal {index} not confirmed: {reason_of(first, law)}", flush=True)
            factor = first.slow_down
            if not factor:
                counts["not by a slow-down of at most 4"] += 1
                continue
            goals.admission.slow(plan, factor)
            second = goals.decide(plan, slow_down=False)
            counts["slowed"] += 1
            counts["slowed, and not admitted then"] += second.reason != 0
            factors.append(factor)
            bound = np.array(second.error[:])
        worst, bits = goals.run(plan, int(rng.integers(MEMBERS)))
        shares.append(float(np.max(worst / bound)))
        longest = max(longest, plan.times[plan.pieces])
        counts["outside the bound"] += shares[-1] > 1.0
        counts["a sample rejected"] += bool(bits & REJECTED)
        counts["a torque limited"] += bool(bits & LIMITED)
        if index % 100 == 99:
            print(f"  {index + 1}: {dict(counts)}", flush=True)
    print(f"of {options.count} goals: {dict(counts)}")
    print(f"error over its bound: median {np.median(shares):.2f}, largest {np.max(shares):.2f}")
    print(f"slow-down: median {np.median(factors):.2f} of those slowed; longest motion {longest:.1f} s")
    milliseconds = 1e3 * np.quantile(seconds, [0.5, 0.99])
    print("decision, where admitted: median {:.0f} ms, 99 % within {:.0f} ms".format(*milliseconds))


def law_of(
    name: str, horizon: float, density: float, resolution: float, seconds: float, tip: str | None = None
) -> CertifiedLaw:
    """The certified law of an identified arm, with the torque limits of its data sheet."""
    _, result = identified(name, seconds, tip)
    arm, period = result.robot, ARMS.get(name, OTHER)["period"]
    law = certified_law(load(ROOT / "examples" / "motions" / "panda.yaml"))
    gate = dataclasses.replace(
        law.gate,
        q_max=np.full(arm.joints, 7.0),
        speed=2.0 * np.asarray(arm.limits.velocity),
        acceleration=np.full(arm.joints, float(np.max(np.asarray(law.gate.acceleration)))),
        spread=np.full(arm.joints, float(np.max(np.asarray(law.gate.spread)))),
    )
    return dataclasses.replace(
        law,
        arm=arm,
        bodies=BodyPoints.of(arm),
        loop=JointLoop.with_density(period, horizon, density, resolution),
        uncertainty=ArmUncertainty.identified(arm, result.band, resolution=resolution),
        gate=gate,
        torque=np.asarray(arm.limits.torque),
        torque_rate=law.torque_rate if name == "panda" else np.full(arm.joints, np.inf),
    )


def law_parser(
    purpose: str | None, *, horizon: float, density: float, resolution: float, count: int
) -> argparse.ArgumentParser:
    """A parser for the arm, its law, and the number of cases, with these defaults."""
    parser = argparse.ArgumentParser(description=purpose)
    parser.add_argument("--arm", default="panda", help=f"{', '.join(ARMS)}, or a URDF file")
    parser.add_argument("--tip", help="link of the tip of a file's arm")
    parser.add_argument("--horizon", type=float, default=horizon, help="H of the law [s]")
    parser.add_argument("--density", type=float, default=density, help="of the Kalman filter [(rad/s³)² s]")
    parser.add_argument("--resolution", type=float, default=resolution, help="of the encoders [rad]")
    parser.add_argument("--allowed", type=float, default=3e-3, help="largest error [rad]")
    parser.add_argument("--count", type=int, default=count)
    return parser


SLOWEST = 2.0
"""Largest factor on a motion's time that counts."""


def measure_motions() -> None:
    """Count random motions, half point to point and half like a planner's, that are certified."""
    parser = law_parser(measure_motions.__doc__, horizon=0.007, density=3.0, resolution=1e-5, count=200)
    parser.add_argument("--slowest", type=float, default=0.2, help="least share of the largest speeds")
    parser.add_argument("--fastest", type=float, default=0.5, help="largest share of the largest speeds")
    parser.add_argument("--seconds", type=float, default=20.0, help="of the log that identifies the arm")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--slow-down", action="store_true", help="also search how much slower a motion must be")
    options = parser.parse_args()
    law = law_of(options.arm, options.horizon, options.density, options.resolution, options.seconds, options.tip)
    print(f"{options.arm}: p = {100 * law.uncertainty.region(law.bodies).p:.2f} %", flush=True)
    rng, answers, seconds = np.random.default_rng(options.seed), [], []
    for index in range(options.count):
        motion = (cases.quintic, cases.knotted)[index % 2](law.arm, rng, rng.uniform(options.slowest, options.fastest))
        begun = time.process_time()
        first = admit(law, motion, str(index), allowed=options.allowed, assume_steps=True, slow_down=False)
        seconds.append(time.process_time() - begun)
        proved = all("rate acts" not in line.text or line.status == "proved" for line in first.verdict.assumptions)
        step = first.admitted and proved
        slower = step
        if options.slow_down and not step:
            answer = admit(law, motion, str(index), allowed=options.allowed)
            slower = answer.slow_down is not None and answer.slow_down <= SLOWEST
        bound = np.inf if first.bound is None else float(np.max(first.bound))
        answers.append((bound, first.admitted, step, slower))
        if not first.admitted:
            print(f"  motion {index}: {first.limit}", flush=True)
    bounds, admitted, steps, slower = (np.array(column) for column in zip(*answers, strict=True))
    finite = bounds[np.isfinite(bounds)]
    print(
        f"of {options.count} motions: error within {1e3 * options.allowed:g} mrad {np.sum(bounds <= options.allowed)}, "
        f"and torque limits proved {np.sum(admitted)}, and torque steps proved {np.sum(steps)}"
        + (f", with a slow-down of at most {SLOWEST:g} {np.sum(slower)}" if options.slow_down else "")
    )
    print(f"error: median {1e3 * np.median(bounds):.2f} mrad, largest that is finite {1e3 * np.max(finite):.2f} mrad")
    print(f"time of a motion: median {np.median(seconds):.2f} s, largest {np.max(seconds):.2f} s of processor time")


def random_stream(kind: int, centre: np.ndarray, rng: np.random.Generator, times: np.ndarray) -> np.ndarray:
    """Positions from a host within 0.5 rad of a posture: jumps to new goals, ways to them, or a trembling hand."""
    rate, n = 1.0 / times[1], len(centre)
    if kind == 2:
        waves = rng.uniform(0.02, 0.15, (3, n, 1)) * np.sin(
            2.0 * np.pi * rng.uniform(0.1, 1.5, (3, n, 1)) * times + rng.uniform(0.0, 2.0 * np.pi, (3, n, 1))
        )
        hand: np.ndarray = centre + waves.sum(0).T + rng.normal(scale=5e-4, size=(len(times), n))
        return hand
    new = np.concatenate([[False], rng.random(len(times) - 1) < 1.0 / rate])
    goals = np.where(new[:, None], rng.uniform(-0.5, 0.5, (len(times), n)), 0.0)
    goals = centre + goals[np.maximum.accumulate(np.where(new, np.arange(len(times)), 0))]
    if kind == 1:
        for k in range(1, len(goals)):
            goals[k] = goals[k - 1] + np.clip(goals[k] - goals[k - 1], -1.0 / rate, 1.0 / rate)
    return goals


def measure_streams() -> None:
    """Bound the error along random streams of positions: jumps, ways and a trembling hand."""
    parser = law_parser(measure_streams.__doc__, horizon=0.012, density=0.3, resolution=1e-6, count=60)
    parser.add_argument("--bandwidth", type=float, default=20.0, help="of the filter [rad/s]")
    parser.add_argument("--acceleration", type=float, default=3.0, help="limit of the filter [rad/s²]")
    parser.add_argument("--speed", type=float, default=1.0, help="limit of the filter [rad/s]")
    parser.add_argument("--rate", type=float, default=50.0, help="the host's positions per second")
    options = parser.parse_args()
    law = law_of(options.arm, options.horizon, options.density, options.resolution, 20.0, options.tip)
    stream = StreamFilter.fitting(
        bandwidth=options.bandwidth,
        velocity=options.speed,
        acceleration=options.acceleration,
        period=ARMS.get(options.arm, OTHER)["period"],
        rate=options.rate,
    )
    rng, times = np.random.default_rng(7), np.arange(0.0, 4.0, 1.0 / options.rate)
    low, high = (np.clip(np.asarray(end), -3.0, 3.0) for end in (law.arm.limits.lower, law.arm.limits.upper))
    bounds, behind, admitted = [], [], []
    for index in range(options.count):
        centre = low + 0.6 + rng.random(law.arm.joints) * np.maximum(high - low - 1.2, 0.0)
        motion = Streamed.through(times, random_stream(index % 3, centre, rng, times), stream)
        answer = admit(law, motion, str(index), allowed=options.allowed, assume_steps=True, slow_down=False)
        admitted.append(answer.admitted)
        bounds.append(np.inf if answer.bound is None else float(np.max(answer.bound)))
        behind.append(float(np.max(motion.behind)))
        if not answer.admitted:
            print(f"  stream {index}: {answer.limit}, bound {1e3 * bounds[-1]:.3g} mrad", flush=True)
    lag = 1e3 * float(stream.lag(0.0))
    print(f"| {options.arm} | {lag:.0f} | {np.median(behind):.2f}, {np.max(behind):.2f} | {options.count} | ", end="")
    print(f"{sum(admitted)} | {1e3 * np.median(bounds):.2f}, {1e3 * np.max(bounds):.2f} |")
