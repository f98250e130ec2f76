"""The verb of the package."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from typing import Any, Literal

from slidax._errors import DefinitionError, OutcomeError, is_traced
from slidax._types import State
from slidax.codegen.trace import NoNativeCodeError
from slidax.controllers import AbstractController
from slidax.numerics import runge_kutta_4
from slidax.trajectories import AbstractTrajectory

from . import native_engine, xla_engine
from .define import constant, define_loop, require_start
from .engine import Engine, engine_for, say_xla_instead
from .loop import Begun, Integrator, Loop
from .mujoco.drive import drive as mujoco_drive
from .mujoco_plant import MujocoPlant
from .plant import Plant
from .rollout import begin
from .run import Log, Run, Timing

BANDS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-8)
"""The settling bands that are tallied unless others are asked for, rad or m."""


def simulate(
    plant: Plant | MujocoPlant,
    controller: AbstractController,
    trajectory: AbstractTrajectory,
    state0: State,
    *,
    t1: float,
    period: Any,
    mode: Literal["held", "continuous"] = "held",
    integrator: Integrator = runge_kutta_4,
    substeps: int = 1,
    log_every: int | None = 1,
    bands: tuple[float, ...] = BANDS,
    outside: Literal["raise", "recover"] = "raise",
    throw: bool = False,
    progress: bool | None = None,
    engine: Engine = "auto",
) -> Run:
    """The closed loop from 0 to `t1`, sampled at `k period`, k = 0 .. N: N + 1 samples for N periods.

    In mode "held" the law is evaluated once a period, its torque is held, and the plant takes `substeps` steps of the
    integrator. In mode "continuous" the law is evaluated at every stage of the integrator, whose step is the period;
    τ(k) is then the torque at the start of step k. The envelope and finiteness are watched at every evaluation of the
    law. The first violation ends the run, and `run.outcome` names it; with `outside="recover"` the run goes on, for a
    law that is defined there, and the outcome says when it left and when it was back.

    - `plant`: the true robot and the disturbance on it; a `MujocoPlant` in held mode.
    - `controller`: the scheme.
    - `trajectory`: what the joints should do.
    - `state0`: state at t = 0.
    - `t1`: end [s], a whole number of periods.
    - `period`: time between samples [s], > 0.
    - `mode`: "held" or "continuous".
    - `integrator`: `slidax.numerics.runge_kutta_4` or `semi_implicit_euler`; a `MujocoPlant` has its own.
    - `substeps`: integrator steps per period in held mode.
    - `log_every`: log one in so many samples; None logs none. Metrics count all samples whatever is logged.
    - `bands`: error bands for the settling time, rad or m.
    - `outside`: what a sample outside the envelope does: "raise" ends the run; "recover", in held mode, counts it.
    - `throw`: raise OutcomeError on a bad outcome, instead of returning the run.
    - `progress`: a bar on the terminal; None shows it if the run is long and a person looks on.
    - `engine`: "native" is machine code of our own, "xla" the reference; "auto" takes the first where it can.

    Works inside `jit`, `vmap` and `grad`, by XLA; then nothing is checked or shown, and `run.log.valid` marks what is
    good. Many runs at once go faster by `simulate_batch`.

    Raises DefinitionError if the parts do not fit each other, the start is outside the envelope, or the actuator has no
    torque to hold the arm there.
    """
    own = plant.pushed if isinstance(plant, MujocoPlant) else plant
    loop, samples = define_loop(
        own, controller, trajectory, state0, t1, period, mode, integrator, substeps, log_every, bands, outside
    )
    traced = is_traced((plant, loop, state0))
    started = time.perf_counter()
    inside = functools.partial(require_start, loop)
    load = None
    if isinstance(plant, MujocoPlant):
        _require_samples(mode, traced)
        (carry, envelope, *_), log, timing, load = mujoco_drive(
            plant, loop, state0, samples, log_every, progress, started, inside, engine
        )
    elif traced:
        carry, envelope, *_ = begin(loop, state0)
        points = -(-samples // (log_every or 1))
        carry, log = xla_engine.advance(loop, carry, points, log_every, pack=False)
        timing = None
    else:
        drive: Callable[..., tuple[Begun, Log | None, Timing]] = xla_engine.drive
        if engine_for(engine) == "native":
            drive = native_engine.drive if engine == "native" else _native_if_it_can_be
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
