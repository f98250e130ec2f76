"""The closed loop around MuJoCo: the law decides, MuJoCo moves."""

from __future__ import annotations

import time

import jax
import numpy as np

from slidax._types import State
from slidax.codegen import NoNativeCodeError

from ..engine import engine_for, say_xla_instead
from ..free_body import FreeBody
from ..loop import Begun, Inside, Loop
from ..mujoco_plant import MujocoPlant
from ..progress import Progress
from ..run import Log, Timing
from .native_steps import NativeSteps
from .needed import mujoco, quiet
from .world import World
from .xla_steps import XlaSteps

CHUNK = 1_000
"""How many samples pass between two looks at the bar."""


def drive(
    plant: MujocoPlant,
    loop: Loop,
    state0: State,
    samples: int,
    every: int | None,
    progress: bool | None,
    started: float,
    inside: Inside,
    engine: str,
) -> tuple[Begun, Log | None, Timing, FreeBody | None]:
    """The carry at the end, with envelope and reference at the beginning, the log, and the way of what was let go.

    - `plant`: what MuJoCo moves.
    - `loop`: what stays the same, with our own plant in place of it; in held mode.
    - `state0`: the state at t = 0.
    - `samples`: how many.
    - `every`: one in how many is logged; None logs none.
    - `progress`: whether a bar is shown; None if the run is long and standard error is a terminal.
    - `started`: when, by `time.perf_counter`.
    - `inside`: refuses a start that is not allowed.
    - `engine`: what computes the law.

    Raises DefinitionError if MuJoCo is missing or does not take the arm, NoNativeCodeError if there is no machine code
    for something in the law and `engine` asks for it.
    """
    period, substeps = float(loop.period), loop.substeps
    # The times at which our own plant would look, to the bit.
    h = period / substeps
    with quiet():
        world = World(plant, h, state0)
        steps = _steps(loop, state0, world, 0 if every is None else -(-samples // every), engine)
        inside(state0, *steps.begun[1:])
        ready = time.perf_counter()
        way: list[tuple[float, np.ndarray]] = []
        with Progress(-(-samples // CHUNK), progress) as bar:
            for k in range(samples):
                t = k * period
                keep = every is not None and k % every == 0
                world.arrive(t)
                pose = world.body if keep else None
                if pose is not None:
                    way.append((t, pose))
                goes_on = steps.decide(k, keep)
                if (k + 1) % CHUNK == 0:
                    bar.advance()
                if not goes_on or k == samples - 1:
                    break
                for i in range(substeps):
                    steps.push(i)
                    world.step(t + i * h)
    log = None
    if every is not None:
        whole = steps.log
        log = jax.tree.map(lambda x: x[whole.valid], whole)
    ended: Begun = jax.tree.map(jax.device_put, steps.begun)
    return ended, log, Timing(compile_s=ready - started, run_s=time.perf_counter() - ready), _path(way)


def _steps(loop: Loop, state0: State, world: World, rows: int, engine: str) -> NativeSteps | XlaSteps:
    if engine_for(engine) == "xla":
        return XlaSteps(loop, state0, world)
    try:
        return NativeSteps(loop, state0, world, rows)
    except NoNativeCodeError as error:
        if engine == "native":
            raise
        say_xla_instead(f"there is {error.message}")
        return XlaSteps(loop, state0, world)


def _path(way: list[tuple[float, np.ndarray]]) -> FreeBody | None:
    if not way:
        return None
    rotation = np.empty((len(way), 9))
    for row, (_, pose) in zip(rotation, way, strict=True):
        mujoco().mju_quat2Mat(row, pose[3:])
    return FreeBody(
        t=np.array([t for t, _ in way]),
        rotation=rotation.reshape(-1, 3, 3),
        place=np.stack([pose[:3] for _, pose in way]),
    )
