"""Simulation of a closed loop."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any

from slidax._errors import DefinitionError, OutcomeError, is_traced
from slidax._types import State
from slidax.codegen import NoNativeCodeError
from slidax.controllers import AbstractController
from slidax.trajectories import AbstractTrajectory
from slidax.transformations import PrescribedPerformance

from . import native_engine, xla_engine
from .define import constant, define_loop, require_start
from .engine import engine_for, say_xla_instead
from .log_room import require_room
from .loop import Begun, Loop
from .mujoco.drive import drive as mujoco_drive
from .mujoco_plant import MujocoPlant
from .plant import Plant
from .rollout import begin
from .run import Log, Run, Timing
from .stepping import Stepping

BANDS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-8)
"""The settling bands that are tallied unless others are asked for, rad or m."""


def simulate(
    plant: Plant | MujocoPlant,
    controller: AbstractController,
    trajectory: AbstractTrajectory,
    state0: State,
    tolerance: PrescribedPerformance | None = None,
    *,
    t1: float,
    stepping: Stepping | None = None,
    log_every: int | None = 1,
    bands: tuple[float, ...] = BANDS,
    throw: bool = False,
    progress: bool | None = None,
    **changes: Any,
) -> Run:
    """The closed loop from 0 to `t1`, sampled at `k period`, k = 0 .. N: N + 1 samples for N periods.

        simulate(plant, controller, trajectory, State([0.2, 0.8]), t1=10.0, period=1e-3)

    How time passes is said by the fields of `Stepping`, as keywords or as a whole: the period, held torque or the law
    at every stage of the integrator, what ends a run, the engine. In continuous mode τ(k) is the torque at the start of
    step k. The envelope and finiteness are watched at every evaluation of the law. The first violation ends the run,
    and `run.outcome` names it; with `outside="recover"` the run goes on, for a law that is defined there, and the
    outcome says when it left and when it was back.

    - `plant`: the true robot and the disturbance on it; a `MujocoPlant` in held mode.
    - `controller`: the scheme.
    - `trajectory`: what the joints should do.
    - `state0`: state at t = 0.
    - `tolerance`: band of the error that judges the run, independent of the scheme's envelope; see
      `metrics.tolerance_margin` and `metrics.tolerance_violations`.
    - `t1`: end [s], a whole number of periods.
    - `stepping`: how time passes.
    - `log_every`: log one in so many samples; None logs none. Metrics count all samples whatever is logged.
    - `bands`: error bands for the settling time, rad or m.
    - `throw`: raise OutcomeError on a bad outcome, instead of returning the run.
    - `progress`: a bar on the terminal; None shows it if the run is long and standard error is a terminal.
    - `changes`: fields of `Stepping` by keyword: `period`, `mode`, `substeps`, `integrator`, `outside`, `limits`,
      `engine`; each replaces that of `stepping`. `period` must be given in one or the other.

    Works inside `jit`, `vmap` and `grad`, by XLA; then nothing is checked or shown, and `run.log.valid` marks what is
    good. Many runs at once go faster by `simulate_batch`.

    Raises DefinitionError if the parts do not fit each other, the start is outside the envelope, the actuator has no
    torque to hold the arm there, or start or motion are beyond the limits of the robot's joints.
    """
    stepping = Stepping.of(stepping, changes)
    own = plant.pushed if isinstance(plant, MujocoPlant) else plant
    loop, samples = define_loop(own, controller, trajectory, state0, t1, stepping, log_every, bands, tolerance)
    traced = is_traced((plant, loop, state0))
    if log_every is not None and not traced:
        require_room(loop, state0, -(-samples // log_every))
    started = time.perf_counter()
    inside = functools.partial(require_start, loop)
    load = None
    if isinstance(plant, MujocoPlant):
        _require_samples(stepping.mode, traced)
        (carry, envelope, *_), log, timing, load = mujoco_drive(
            plant, loop, state0, samples, log_every, progress, started, inside, stepping.engine
        )
    elif traced:
        carry, envelope, *_ = begin(loop, state0)
        points = -(-samples // (log_every or 1))
        carry, log = xla_engine.advance(loop, carry, points, log_every, pack=False)
        timing = None
    else:
        drive: Callable[..., tuple[Begun, Log | None, Timing]] = xla_engine.drive
        if engine_for(stepping.engine) == "native":
            drive = native_engine.drive if stepping.engine == "native" else _native_if_it_can_be
        (carry, envelope, *_), log, timing = drive(loop, state0, samples, log_every, progress, started, inside)
    run = Run(
        log=log,
        tally=carry.tally,
        windows=loop.windows,
        fault=carry.fault,
        excursion=carry.excursion,
        state=carry.good,
        period=loop.period,
        t1=constant(float(t1)),
        joint_units=plant.robot.joint_units,
        joint_names=plant.robot.joint_names,
        has_envelope=envelope is not None,
        timing=timing,
        load=load,
    )
    if throw and not traced and not run.outcome.ok:
        raise OutcomeError(run.outcome, run)
    return run


def _native_if_it_can_be(loop: Loop, *how: Any) -> tuple[Begun, Log | None, Timing]:
    try:
        return native_engine.drive(loop, *how)
    except NoNativeCodeError as error:
        say_xla_instead(f"there is {error.message}")
        return xla_engine.drive(loop, *how)


def _require_samples(mode: str, traced: bool) -> None:
    if mode == "continuous":
        raise DefinitionError("a MujocoPlant needs samples: simulate in held mode, not in continuous mode")
    if traced:
        raise DefinitionError("MuJoCo cannot be traced: simulate outside of `jit`, `vmap` and `grad`, or a `Plant`")
