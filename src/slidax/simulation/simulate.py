"""The verb of the package."""

from __future__ import annotations

import time
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError, OutcomeError, is_traced
from slidax._types import Envelope, Reference, State
from slidax.controllers import AbstractController, SampledData
from slidax.numerics import runge_kutta_4
from slidax.trajectories import AbstractTrajectory

from .plant import Plant
from .progress import Progress
from .rollout import Carry, Integrator, Loop, advance, begin
from .run import Log, Run, Timing
from .tally import Windows

BANDS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-8)
"""The settling bands that are tallied unless others are asked for, rad or m."""

CHUNK = 50_000
"""About how many samples pass between two looks at the run: often enough for a bar, and each look costs as much as a
thousand samples."""

_begin = eqx.filter_jit(begin)
_advance: Any = eqx.filter_jit(advance)


def simulate(
    plant: Plant,
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
) -> Run:
    """The closed loop from 0 to `t1`, sampled at `k period`, k = 0 .. N: N + 1 samples for N periods.

    In mode "held" the law is evaluated once a period, its torque is held, and the plant takes `substeps` steps of the
    integrator. In mode "continuous" the law is evaluated at every stage of the integrator, whose step is the period;
    τ(k) is then the torque at the start of step k. The envelope and finiteness are watched at every evaluation of the
    law. The first violation ends the run, and `run.outcome` names it; with `outside="recover"` the run goes on, for a
    law that is defined there, and the outcome says when it left and when it was back.

    - `plant`: the true robot and the disturbance on it.
    - `controller`: the scheme.
    - `trajectory`: what the joints should do.
    - `state0`: state at t = 0.
    - `t1`: end [s], a whole number of periods.
    - `period`: time between samples [s], > 0.
    - `mode`: "held" or "continuous".
    - `integrator`: `slidax.numerics.runge_kutta_4` or `semi_implicit_euler`.
    - `substeps`: integrator steps per period in held mode.
    - `log_every`: log one in so many samples; None logs none. Metrics count all samples whatever is logged.
    - `bands`: error bands for the settling time, rad or m.
    - `outside`: what a sample outside the envelope does: "raise" ends the run; "recover", in held mode, counts it.
    - `throw`: raise OutcomeError on a bad outcome, instead of returning the run.
    - `progress`: a bar on the terminal; None shows it if the run is long and a person looks on.

    Works inside `jit`, `vmap` and `grad`; then nothing is checked or shown, and `run.log.valid` marks what is good.

    Raises DefinitionError if the parts do not fit each other or the start is outside the envelope.
    """
    loop, samples = _define(
        plant, controller, trajectory, state0, t1, period, mode, integrator, substeps, log_every, bands, outside
    )
    traced = is_traced((loop, state0))
    started = time.perf_counter()
    if traced:
        carry, _, _ = begin(loop, state0)
        points = -(-samples // (log_every or 1))
        carry, log = advance(loop, carry, points, log_every, pack=False)
        timing = None
    else:
        carry, envelope, reference = _begin(loop, state0)
        if outside == "raise":
            _require_start_inside(state0, reference, envelope)
        carry, log, timing = _drive(loop, carry, samples, log_every, progress, started)
    run = Run(
        log=log,
        tally=carry.tally,
        windows=loop.windows,
        fault=carry.fault,
        excursion=carry.excursion,
        state=carry.good,
        period=loop.period,
        t1=jnp.asarray(t1, float),
        joint_units=plant.robot.joint_units,
        has_envelope=eqx.filter_eval_shape(begin, loop, state0)[1] is not None,
        timing=timing,
    )
    if throw and not traced and not run.outcome.ok:
        raise OutcomeError(run.outcome, run)
    return run


def _drive(
    loop: Loop, carry: Carry, samples: int, every: int | None, progress: bool | None, started: float
) -> tuple[Carry, Log | None, Timing]:
    """Runs the loop in chunks of equal size, so that it is compiled once and can be watched."""
    chunks = max(1, round(samples / CHUNK))
    # In continuous mode a loop without a log is compiled otherwise and rounds otherwise (it fuses other products into
    # sums), and the metrics would depend on what is logged. So two lines per chunk are made there, and dropped.
    stride = every or (-(-samples // (2 * chunks)) if loop.continuous else None)
    points = max(2, -(-samples // (chunks * (stride or 1))))
    chunks = -(-samples // (points * (stride or 1)))
    compiled = _advance.lower(loop, carry, points, stride, pack=True).compile()
    ready = time.perf_counter()
    logs = []
    with Progress(chunks, progress) as bar:
        for _ in range(chunks):
            carry, log = compiled(loop, carry, points, stride, pack=True)
            if every is not None:
                logs.append(jax.tree.map(np.asarray, log))
            bar.advance()
            if int(carry.fault.kind):
                break
    log = None
    if every is not None:
        whole = jax.tree.map(lambda *parts: np.concatenate(parts), *logs)
        log = jax.tree.map(lambda x: x[whole.valid], whole)
    jax.block_until_ready(carry)
    return carry, log, Timing(compile_s=ready - started, run_s=time.perf_counter() - ready)


def _define(
    plant: Plant,
    controller: AbstractController,
    trajectory: AbstractTrajectory,
    state0: State,
    t1: float,
    period: Any,
    mode: str,
    integrator: Integrator,
    substeps: int,
    log_every: int | None,
    bands: tuple[float, ...],
    outside: str,
) -> tuple[Loop, int]:
    if not jax.config.read("jax_enable_x64"):
        raise DefinitionError(
            'slidax needs 64-bit numbers: call jax.config.update("jax_enable_x64", True) before anything else'
        )
    n = plant.robot.joints
    if controller.joints != n:
        raise DefinitionError(f"the controller commands {controller.joints} joints, but the plant has {n}")
    for name, value in (("q", state0.q), ("dq", state0.dq)):
        if value.shape != (n,):
            raise DefinitionError(f"`state0.{name}` must have one entry for each of the {n} joints; got {value.shape}")
        if not is_traced(value) and not np.isfinite(value).all():
            joint = int(np.argmin(np.isfinite(value))) + 1
            raise DefinitionError(f"`state0.{name}` must be finite; it is not for joint {joint}")
    shape = eqx.filter_eval_shape(trajectory.position, jax.ShapeDtypeStruct((), float)).shape
    if shape != (n,):
        raise DefinitionError(f"the trajectory gives {list(shape)} positions, but the plant has {n} joints")
    try:
        pushed = eqx.filter_eval_shape(plant.disturbance, jax.ShapeDtypeStruct((), float), state0).shape
    except (TypeError, ValueError) as error:
        raise DefinitionError(f"the disturbance does not fit the {n} joints of the plant: {error}") from error
    if pushed != (n,):
        raise DefinitionError(f"the disturbance gives {list(pushed)} forces, but the plant has {n} joints")
    if substeps < 1:
        raise DefinitionError(f"`substeps` must be >= 1; got {substeps}")
    if mode == "continuous" and substeps != 1:
        raise DefinitionError(f"`substeps` must be 1 in continuous mode, where `period` is the step; got {substeps}")
    if mode == "continuous":
        if isinstance(controller, SampledData):
            raise DefinitionError("a sampled-data law needs samples: simulate in held mode, not in continuous mode")
        for name, part in (("a sensor", plant.sensor), ("an actuator", plant.actuator)):
            if part is not None:
                raise DefinitionError(f"{name} needs samples: simulate in held mode, not in continuous mode")
        if outside == "recover":
            raise DefinitionError("`outside` must be `raise` in continuous mode: recovering needs samples")
    if log_every is not None and log_every < 1:
        raise DefinitionError(f"`log_every` must be >= 1, or None for no log; got {log_every}")
    if is_traced(period):
        raise DefinitionError("`period` sets the number of samples, so it must be a known number")
    steps = _steps(float(t1), float(period))
    if isinstance(controller, SampledData) and not is_traced(controller.period):
        made_for = float(controller.period)
        if abs(made_for - float(period)) > 1e-9 * made_for:
            raise DefinitionError(
                f"the sampled-data law is made for a period of {made_for:g} s; it cannot be sampled every "
                f"{float(period):g} s"
            )
    windows = Windows(
        steady=jnp.asarray(int(np.ceil(0.75 * steps))),
        iae=jnp.asarray(int(np.floor(2.0 / float(period) + 1e-6)) + 1),
        bands=jnp.asarray(bands, float),
    )
    loop = Loop(
        plant=plant,
        controller=controller,
        trajectory=trajectory,
        period=jnp.asarray(period, float),
        last=jnp.asarray(steps),
        windows=windows,
        integrator=integrator,
        substeps=substeps,
        continuous=mode == "continuous",
        recover=outside == "recover",
    )
    return loop, steps + 1


def _steps(t1: float, period: float) -> int:
    if not (np.isfinite(period) and period > 0):
        raise DefinitionError(f"`period` must be > 0 s; got {period:g}")
    if not (np.isfinite(t1) and t1 > 0):
        raise DefinitionError(f"`t1` must be > 0 s; got {t1:g}")
    steps = round(t1 / period)
    if steps < 1 or abs(steps * period - t1) > 1e-6 * period * max(1.0, 1e-3 * steps):
        raise DefinitionError(f"`t1` must be a whole number of periods of {period:g} s; got {t1:g} s")
    return steps


def _require_start_inside(state0: State, reference: Reference, envelope: Envelope | None) -> None:
    if envelope is None:
        return
    e = np.asarray(state0.q - reference.q)
    lower, upper = np.asarray(envelope.lower), np.asarray(envelope.upper)
    outside = ~((lower < e) & (e < upper))
    if outside.any():
        joint = int(np.argmax(outside))
        raise DefinitionError(
            f"`state0.q` must start inside the envelope, lower < e(0) < upper (eq. 12), so |e(0)| < rho0 (eq. 20); "
            f"got e(0) = {e[joint]:.4g} for joint {joint + 1}, whose bounds are {lower[joint]:.4g} and "
            f"{upper[joint]:.4g}; enlarge the initial radius or start nearer"
        )
