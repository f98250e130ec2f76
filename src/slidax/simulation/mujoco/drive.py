"""MuJoCo engine: the law decides, MuJoCo moves the arm."""

from __future__ import annotations

import time
from typing import Any

import jax
import numpy as np

from ..define import require_start
from ..engine import EngineResult, RunRequest, engine_for, native_or_xla
from ..free_body import FreeBody
from ..loop import LoopStart
from ..mujoco_plant import MujocoPlant
from ..progress import Progress
from ..run import Timing
from .native_steps import NativeSteps
from .needed import mujoco, quiet
from .world import World
from .xla_steps import XlaSteps

CHUNK = 1_000
"""Samples between two updates of the bar."""


def drive(plant: MujocoPlant, engine: str, request: RunRequest) -> EngineResult:
    """Run a loop in held mode, in which MuJoCo moves the arm in place of slidax's own plant.

    - `engine`: of the law.

    Raises DefinitionError if MuJoCo is missing or rejects the arm, NoNativeCodeError if `engine` is `native` and a
    part of the law has no machine code.
    """
    loop, state0, samples, every = request.loop, request.state0, request.samples, request.log_every
    period, substeps = float(loop.period), loop.substeps
    # The times of slidax's own plant, to the bit.
    h = period / substeps
    with quiet():
        world = World(plant, h, state0)
        steps: Any = native_or_xla(
            engine,
            engine_for(engine),
            lambda: NativeSteps(loop, state0, world, request.rows),
            lambda: XlaSteps(loop, state0, world),
            stacklevel=5,
        )
        require_start(loop, state0, *steps.start[1:])
        ready = time.perf_counter()
        poses: list[tuple[float, np.ndarray]] = []
        with Progress(-(-samples // CHUNK), request.progress) as bar:
            for k in range(samples):
                t = k * period
                keep = every is not None and k % every == 0
                world.advance_to(t)
                pose = world.body if keep else None
                if pose is not None:
                    poses.append((t, pose))
                running = steps.decide(k, keep)
                if (k + 1) % CHUNK == 0:
                    bar.advance()
                if not running or k == samples - 1:
                    break
                for i in range(substeps):
                    steps.set_force(i)
                    world.step(t + i * h)
    log = None if every is None else steps.log.without_padding()
    start: LoopStart = jax.tree.map(jax.device_put, steps.start)
    timing = Timing(compile_s=ready - request.started, run_s=time.perf_counter() - ready)
    return EngineResult(start, log, timing, _path(poses))


def _path(poses: list[tuple[float, np.ndarray]]) -> FreeBody | None:
    if not poses:
        return None
    rotation = np.empty((len(poses), 9))
    for row, (_, pose) in zip(rotation, poses, strict=True):
        mujoco().mju_quat2Mat(row, pose[3:])
    return FreeBody(
        t=np.array([t for t, _ in poses]),
        rotation=rotation.reshape(-1, 3, 3),
        place=np.stack([pose[:3] for _, pose in poses]),
    )
