"""Seven joints: forward dynamics in slidax and other libraries, and closed loops relative to real time.

Run as `python -m benchmarks.robots`. The arm is the ready Panda with the same numbers everywhere. Each contestant takes
small explicit steps, so that no evaluation is of the same state as the one before, and all must end at the same place.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROUNDS = 9
EVALUATIONS = 20_000
FROM_PYTHON = 2_000
STEP = 1e-6
BATCH = 64
LONG_LISTS = ("-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS")
"""Pinocchio has more kinds of joints than Boost's lists hold by themselves."""

PROGRAM = Path(__file__).with_name("pinocchio_dynamics.cpp")


def measure() -> dict[str, Any]:
    """Nanoseconds per evaluation, least and median of all rounds, and how many times real time closed loops run."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    import jax

    from benchmarks import machine

    jax.config.update("jax_enable_x64", True)
    machine.well_made_from_the_start()
    from slidax import arms

    arm = arms.panda()
    start = np.full(arm.joints, 0.3), np.full(arm.joints, 0.2), np.full(arm.joints, 1.0)
    contestants = {
        "slidax, native": _native(arm, start),
        "slidax, xla": _xla(arm, start),
        "Pinocchio aba, from Python": _pinocchio(arm, start),
        "MuJoCo mj_forward, from Python": _mujoco(arm, start, from_python=True),
        "MuJoCo mj_step, its own loop in C": _mujoco(arm, start, from_python=False),
    }
    compiled = _pinocchio_in_cpp(arm, start)
    if compiled is not None:
        contestants["Pinocchio aba, C++ (gcc -O3)"] = compiled
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(ROUNDS):
        for name, run in contestants.items():
            times[name].append(run())
    return {
        "ns": {name: {"min": min(values), "median": statistics.median(values)} for name, values in times.items()},
        "real_time": _closed_loops(),
        "load_s": _loading(),
    }


def _stepped(arm: Any, evaluations: int) -> Any:
    import jax

    from slidax.core.types import State

    def run(arm: Any, q: Any, dq: Any, tau: Any) -> Any:
        def step(state: Any, _: Any) -> Any:
            q, dq = state
            ddq = arm.acceleration(State(q=q, dq=dq), tau)
            return (q + STEP * dq, dq + STEP * ddq), None

        return jax.lax.scan(step, (q, dq), None, length=evaluations)[0]

    return run


def _native(arm: Any, start: Any) -> Callable[[], float]:
    import jax

    from slidax.codegen import llvm, trace

    kernel = llvm.compile(trace(_stepped(arm, EVALUATIONS), arm, *start))
    arrays = [np.asarray(leaf) for leaf in jax.tree.leaves((arm, *start))]

    def run() -> float:
        started = time.perf_counter()
        q, _ = kernel(arrays)
        spent = time.perf_counter() - started
        _require_there(q, EVALUATIONS)
        return 1e9 * spent / EVALUATIONS

    return run


def _xla(arm: Any, start: Any) -> Callable[[], float]:
    import jax

    compiled = jax.jit(_stepped(arm, EVALUATIONS))
    jax.block_until_ready(compiled(arm, *start))

    def run() -> float:
        started = time.perf_counter()
        q, _ = jax.block_until_ready(compiled(arm, *start))
        spent = time.perf_counter() - started
        _require_there(np.asarray(q), EVALUATIONS)
        return 1e9 * spent / EVALUATIONS

    return run


def _pinocchio(arm: Any, start: Any) -> Callable[[], float]:
    import pinocchio as pin

    model = pin.Model()
    for i in range(arm.joints):
        place = pin.SE3(np.array(arm.rotations[i]), np.array(arm.translations[i]))
        joint = model.addJoint(arm.parents[i] + 1, pin.JointModelRZ(), place, arm.joint_names[i])
        inertia = pin.Inertia(float(arm.masses[i]), np.array(arm.centers[i]), np.array(arm.inertias[i]))
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model.gravity = pin.Motion(np.array(arm.gravity_vector), np.zeros(3))
    data = model.createData()

    def run() -> float:
        q, dq, tau = (array.copy() for array in start)
        started = time.perf_counter()
        for _ in range(FROM_PYTHON):
            ddq = pin.aba(model, data, q, dq, tau)
            q += STEP * dq
            dq += STEP * ddq
        spent = time.perf_counter() - started
        _require_there(q, FROM_PYTHON)
        return 1e9 * spent / FROM_PYTHON

    return run


def _mujoco(arm: Any, start: Any, *, from_python: bool) -> Callable[[], float]:
    """Called for each acceleration, or with its own loop over semi-implicit steps, which ends as near as those may."""
    import mujoco

    from slidax.plant import Sum
    from slidax.simulation import MujocoPlant
    from slidax.simulation.mujoco_model import build

    model = build(MujocoPlant(arm, Sum(()), integrator="euler"), arm, None, free=False, timestep=STEP).model
    data = mujoco.MjData(model)

    def run() -> float:
        q, dq, tau = (array.copy() for array in start)
        data.qfrc_applied[:] = tau
        if not from_python:
            data.qpos[:] = q
            data.qvel[:] = dq
            started = time.perf_counter()
            mujoco.mj_step(model, data, EVALUATIONS)
            spent = time.perf_counter() - started
            _require_there(np.array(data.qpos), EVALUATIONS, 1e-5)
            return 1e9 * spent / EVALUATIONS
        started = time.perf_counter()
        for _ in range(FROM_PYTHON):
            data.qpos[:] = q
            data.qvel[:] = dq
            mujoco.mj_forward(model, data)
            q += STEP * dq
            dq += STEP * data.qacc
        spent = time.perf_counter() - started
        _require_there(q, FROM_PYTHON)
        return 1e9 * spent / FROM_PYTHON

    return run


def _pinocchio_in_cpp(arm: Any, start: Any) -> Callable[[], float] | None:
    """None where its headers or a compiler are missing: they come with `pip install pin cmeel-eigen`."""
    import pinocchio as pin

    prefix = next(parent for parent in Path(pin.__file__).parents if parent.name == "cmeel.prefix")
    folder = Path(tempfile.mkdtemp())
    program = folder / "pinocchio_dynamics"
    if shutil.which("g++") is None or not (prefix / "include" / "eigen3").exists():
        return None
    command = [
        "g++",
        "-O3",
        "-march=native",
        "-DNDEBUG",
        "-std=c++17",
        "-w",
        *LONG_LISTS,
        str(PROGRAM),
        "-o",
        str(program),
    ]
    command += [f"-I{prefix}/include", f"-I{prefix}/include/eigen3", f"-L{prefix}/lib", "-lpinocchio_default"]
    command += [f"-Wl,-rpath,{prefix}/lib", f"-Wl,-rpath-link,{prefix}/lib"]
    if subprocess.run(command, stderr=subprocess.DEVNULL, check=False).returncode:
        return None
    numbers = [[arm.joints]]
    for i in range(arm.joints):
        numbers.append([arm.parents[i], 1])
        for leaf in (arm.rotations, arm.translations, arm.masses, arm.centers, arm.inertias, arm.armature):
            numbers.append(np.ravel(leaf[i]).tolist())
    numbers += [np.ravel(array).tolist() for array in (arm.gravity_vector, *start)]
    text = "\n".join(" ".join(repr(float(x)) for x in line) for line in numbers)

    def run() -> float:
        answer = subprocess.run(
            [str(program), str(EVALUATIONS)], input=text, stdout=subprocess.PIPE, text=True, check=True
        ).stdout.split()
        _require_there(np.array([float(answer[1]) / arm.joints]), EVALUATIONS)
        return float(answer[0])

    return run


def _require_there(q: np.ndarray, evaluations: int, near: float = 1e-9) -> None:
    """All contestants compute the same: the mean place of the joints after so many steps."""
    known = _THERE.setdefault(evaluations, float(np.mean(q)))
    assert abs(float(np.mean(q)) - known) < near, (float(np.mean(q)), known)


_THERE: dict[int, float] = {}


def _closed_loops() -> dict[str, float]:
    """Simulated over real time: `panda-payload`, 1 kHz, 10 steps of the plant a period, on one core."""
    import equinox as eqx
    import jax.numpy as jnp

    from slidax import scenarios, simulate_batch

    scenario = scenarios.load("panda-payload")

    def define(mass: Any) -> Any:
        plant = eqx.tree_at(lambda plant: plant.load.payload.mass, scenario.plant, mass)
        return plant, scenario.controller, scenario.trajectory, scenario.state0

    def batch(integrator: Any) -> float:
        started = time.perf_counter()
        simulate_batch(
            define,
            jnp.linspace(0.0, 3.0, BATCH),
            t1=scenario.t1,
            stepping=scenario.stepping,
            integrator=integrator,
            engine="native",
            threads=1,
        )
        return time.perf_counter() - started

    factors = {}
    for name, changes in (("semi-implicit Euler", {}), ("Runge-Kutta 4", {"simulation.integrator": "rk4"})):
        single = scenarios.load("panda-payload", {**changes, "simulation.engine": "native"})
        runs = [single.simulate(log_every=None).timing for _ in range(ROUNDS)]
        factors[f"one run, {name}"] = single.t1 / min(timing.run_s for timing in runs if timing is not None)
    found_batch = [batch(scenario.stepping.integrator) for _ in range(4)]
    factors[f"a batch of {BATCH}, semi-implicit Euler"] = BATCH * scenario.t1 / min(found_batch)
    other = scenarios.load("panda-payload", {"simulation.plant": "mujoco"})
    timings = [other.simulate(log_every=None).timing for _ in range(4)]
    factors["one run, the arm moved by MuJoCo"] = other.t1 / min(t.run_s for t in timings if t is not None)
    return factors


def _loading() -> dict[str, float]:
    """Seconds of a whole process that imports the package and loads an arm."""
    seconds = {}
    head = "import jax; jax.config.update('jax_enable_x64', True); import slidax as sx; "
    for name, call in (
        ("the ready Panda", "sx.arms.panda()"),
        ("the two-link arm's URDF", "sx.arms.from_urdf('examples/robots/two_link.urdf', armature=[5.0, 5.0])"),
    ):
        spent = []
        for _ in range(5):
            started = time.perf_counter()
            subprocess.run([sys.executable, "-c", head + call], check=True)
            spent.append(time.perf_counter() - started)
        seconds[name] = min(spent)
    return seconds


if __name__ == "__main__":
    json.dump(measure(), sys.stdout)
