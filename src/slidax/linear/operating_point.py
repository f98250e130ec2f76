"""The closed loop at a time of its run, without what no derivative has: rounding, noise, losses, uneven instants."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError
from slidax.codegen import NoNativeCodeError
from slidax.scenarios import Scenario
from slidax.sensors import AbstractSensor, Delayed, Exact, Lossy
from slidax.simulation import MujocoPlant, Plant, native_engine, xla_engine
from slidax.simulation.define import constant, define_loop
from slidax.simulation.engine import RunRequest, engine_for
from slidax.simulation.loop import Carry, Loop

from .late import Late

QUIET = ("resolution", "position_noise", "velocity_noise")
"""Fields of a sensor that are set to zero."""


def operating_point(scenario: Scenario, at: float) -> tuple[Loop, Carry, list[str]]:
    """The loop, what it has at a sample, and what was left out of it.

    - `at`: time of the sample [s], a whole number of periods, at least one.

    Raises DefinitionError if the run ends before, or the arm is MuJoCo's.
    """
    if isinstance(scenario.plant, MujocoPlant):
        raise DefinitionError("an arm that MuJoCo moves has no derivatives here: set `simulation.plant` to `own`")
    stepping = scenario.stepping
    plant, left_out = _smooth(scenario.plant, stepping.mode == "held")
    parts = plant, scenario.controller, scenario.trajectory, scenario.state0
    bands = (1e-3,)
    loop, samples = define_loop(*parts, at, replace(stepping, engine="auto"), None, bands)
    # The sample at `at` itself is not decided yet: that is what is linearised.
    request = RunRequest(loop, scenario.state0, samples - 1, log_every=None, progress=False)
    begun: Any
    try:
        drive = native_engine.drive if engine_for("auto") == "native" else xla_engine.drive
        begun = drive(request).start
    except NoNativeCodeError:
        begun = xla_engine.drive(request).start
    carry: Carry = begun[0]
    kind = int(carry.fault.kind)
    if kind:
        when = float(carry.fault.t)
        what = "left its envelope" if kind == 1 else "became infinite"
        raise DefinitionError(f"the run {what} at t = {when:.4g} s, before the time that is asked for, {at:g} s")
    return eqx.tree_at(lambda x: x.last, loop, constant(samples + 10)), carry, left_out


def _smooth(plant: Plant, held: bool) -> tuple[Plant, list[str]]:
    """The plant, and what was left out."""
    left_out: list[str] = []
    sensor: AbstractSensor | None = Exact() if held else None
    if plant.sensor is not None:
        sensor = _quiet(plant.sensor, left_out)
    smooth: Plant = eqx.tree_at(lambda p: p.sensor, plant, sensor, is_leaf=lambda x: x is None)
    return smooth, left_out


def _quiet(sensor: AbstractSensor, left_out: list[str]) -> AbstractSensor:
    if isinstance(sensor, Lossy):
        loses = float(sensor.probability) > 0 or bool(np.asarray(sensor.counts).sum() > 0)
        if loses:
            left_out.append("lost samples: every one arrives")
        return _quiet(sensor.sensor, left_out)
    if isinstance(sensor, Delayed):
        if sensor.jitter:
            left_out.append(f"jitter of {sensor.jitter:g} periods: each sample has the mean age")
        return Late(_quiet(sensor.sensor, left_out), sensor.periods)
    for field in QUIET:
        value = getattr(sensor, field, None)
        if value is None or not np.any(np.asarray(value) > 0):
            continue
        name = "rounding by the encoders" if field == "resolution" else field.replace("_", " ")
        left_out.append(f"{name}: measured as it is")
        sensor = replace(sensor, **{field: jnp.zeros_like(value)})
    return sensor


def reached(carry: Carry) -> tuple[np.ndarray, np.ndarray]:
    """Where the arm is, and how fast, [n] and [n]."""
    q, dq = jax.tree.map(np.asarray, (carry.state.q, carry.state.dq))
    return q, dq
