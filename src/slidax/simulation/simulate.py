"""Simulation of one closed loop."""

from __future__ import annotations

from typing import Any

from slidax._errors import DefinitionError, OutcomeError, is_traced
from slidax._types import State
from slidax.controllers import AbstractController
from slidax.trajectories import AbstractTrajectory
from slidax.transformations import PrescribedPerformance

from . import native_engine, xla_engine
from .define import constant, define_loop
from .engine import EngineResult, RunRequest, engine_for, native_or_xla
from .log_room import require_room
from .mujoco.drive import drive as drive_mujoco
from .mujoco_plant import MujocoPlant
from .plant import Plant
from .rollout import begin
from .run import Run
from .stepping import Stepping

BANDS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-8)
"""Default error bands for the settling time, rad or m."""


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
    """Simulate the closed loop from 0 to `t1`, sampled at `k period`, k = 0 .. N: N + 1 samples for N periods.

        simulate(plant, controller, trajectory, State([0.2, 0.8]), t1=10.0, period=1e-3)

    Every evaluation of the law checks the envelope and finiteness. The first violation ends the run, and `run.outcome`
    names it. With `outside="recover"` the run continues, for a law that is defined outside, and the outcome has the
    times of leaving and returning. In continuous mode τ(k) is the torque at the start of step k.

    - `plant`: the true robot with its disturbance; a `MujocoPlant` needs held mode.
    - `tolerance`: band of the error that judges the run, independent of the scheme's envelope; see
      `metrics.tolerance_margin` and `metrics.tolerance_violations`.
    - `t1`: end [s], a whole number of periods.
    - `stepping`: period, mode, integrator, engine.
    - `log_every`: log one in so many samples; None logs none. Metrics always count all samples.
    - `bands`: error bands for the settling time, rad or m.
    - `throw`: raise OutcomeError on a bad outcome, instead of returning the run.
    - `progress`: show a bar; None shows it for long runs if standard error is a terminal.
    - `changes`: fields of `Stepping` by keyword, each in place of that of `stepping`: `period`, `mode`, `substeps`,
      `integrator`, `outside`, `limits`, `engine`. `period` is needed in one of the two.

    Works inside `jit`, `vmap` and `grad`, with XLA; nothing is checked or shown there, and `run.log.valid` marks the
    valid samples. Use `simulate_batch` for many runs.

    Raises DefinitionError if the parts do not fit each other, the start is outside the envelope, the actuator cannot
    hold the arm there, or the start or the motion exceeds the joint limits.
    """
    stepping = Stepping.of(stepping, changes)
    own = plant.with_friction if isinstance(plant, MujocoPlant) else plant
    loop, samples = define_loop(own, controller, trajectory, state0, t1, stepping, log_every, bands, tolerance)
    traced = is_traced((plant, loop, state0))
    if log_every is not None and not traced:
        require_room(loop, state0, -(-samples // log_every))
    if isinstance(plant, MujocoPlant):
        _require_samples(stepping.mode, traced)
    timing = load = None
    if traced:
        carry, envelope, *_ = begin(loop, state0)
        points = -(-samples // (log_every or 1))
        carry, log = xla_engine.advance(loop, carry, points, log_every, pack=False)
    else:
        request = RunRequest(loop, state0, samples, log_every, progress)
        (carry, envelope, *_), log, timing, load = _driven(plant, stepping.engine, request)
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


def _driven(plant: Plant | MujocoPlant, engine: str, request: RunRequest) -> EngineResult:
    if isinstance(plant, MujocoPlant):
        return drive_mujoco(plant, engine, request)
    return native_or_xla(
        engine,
        engine_for(engine),
        lambda: native_engine.drive(request),
        lambda: xla_engine.drive(request),
        stacklevel=4,
    )


def _require_samples(mode: str, traced: bool) -> None:
    if mode == "continuous":
        raise DefinitionError("a MujocoPlant needs samples: simulate in held mode, not in continuous mode")
    if traced:
        raise DefinitionError("MuJoCo cannot be traced: simulate outside of `jit`, `vmap` and `grad`, or a `Plant`")
