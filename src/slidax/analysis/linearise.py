"""The closed loop linearised at a time of its run: eigenvalues, margins, Bode and step responses."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.arms.articulated import Articulated
from slidax.codegen.ir import NoNativeCodeError
from slidax.core.errors import DefinitionError
from slidax.law.sampled.controller import SampledData
from slidax.plant.sensors import AbstractSensor, Delayed, Exact, Lossy
from slidax.scenarios.scenario import Scenario
from slidax.simulation import native_engine, xla_engine
from slidax.simulation.define import constant, define_loop
from slidax.simulation.engine import RunRequest, engine_for
from slidax.simulation.loop import Carry, ClosedLoop
from slidax.simulation.plant import MujocoPlant, Plant

from .period_map import INPUTS, OUTPUTS, DelayLine, PeriodMap, period_map
from .sampled_system import Margins, SampledSystem, connected_states, margins_of, simultaneous_margins

QUIET = ("resolution", "position_noise", "velocity_noise")
"""Fields of a sensor that are set to zero, since rounding and noise have no derivative."""


def operating_point(scenario: Scenario, at: float) -> tuple[ClosedLoop, Carry, list[str]]:
    """Simulate a scenario until just before the sample at which it is to be linearised.

    Return the loop, its state at that time, and a note on each effect that was left out: sensor effects without a
    derivative, such as rounding.

    - `at`: time of the sample [s], a whole number of periods, at least one.

    Raises DefinitionError if the run ends earlier, MuJoCo simulates the arm, or the arm has a transmission.
    """
    if isinstance(scenario.plant, MujocoPlant):
        raise DefinitionError("an arm simulated by MuJoCo has no derivatives here: set `simulation.plant` to `own`")
    if scenario.plant.transmission is not None:
        raise DefinitionError("LuGre friction and elastic joints cannot be linearised here: leave `transmission` out")
    stepping = scenario.stepping
    plant, left_out = _smooth(scenario.plant, stepping.mode == "held")
    parts = plant, scenario.controller, scenario.trajectory, scenario.state0
    bands = (1e-3,)
    loop, samples = define_loop(*parts, at, replace(stepping, engine="auto"), None, bands)
    # Stop before the sample at `at`: that sample is linearised.
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
        event = "left its envelope" if kind == 1 else "became infinite"
        raise DefinitionError(
            f"the run {event} at t = {when:.4g} s, before the requested time {at:g} s: choose an earlier time"
        )
    return eqx.tree_at(lambda x: x.last, loop, constant(samples + 10)), carry, left_out


def _smooth(plant: Plant, held: bool) -> tuple[Plant, list[str]]:
    """Return the plant with a differentiable sensor, and notes on the effects that were left out."""
    left_out: list[str] = []
    sensor: AbstractSensor | None = Exact() if held else None
    if plant.sensor is not None:
        sensor = _quiet(plant.sensor, left_out)
    smooth: Plant = eqx.tree_at(lambda p: p.sensor, plant, sensor, is_leaf=lambda x: x is None)
    return smooth, left_out


def _quiet(sensor: AbstractSensor, left_out: list[str]) -> AbstractSensor:
    if isinstance(sensor, Lossy):
        loses = any(np.any(np.asarray(x) > 0) for x in (sensor.probability, sensor.counts, sensor.pattern))
        if loses:
            left_out.append("lost samples: left out, every sample arrives")
        return _quiet(sensor.sensor, left_out)
    if isinstance(sensor, Delayed):
        if sensor.jitter:
            left_out.append(f"jitter of {sensor.jitter:g} periods: left out, each sample has the mean delay")
        return DelayLine(_quiet(sensor.sensor, left_out), sensor.periods)
    for name in QUIET:
        value = getattr(sensor, name, None)
        if value is None or not np.any(np.asarray(value) > 0):
            continue
        label = "rounding by the encoders" if name == "resolution" else name.replace("_", " ")
        left_out.append(f"{label}: left out, the measurement is exact")
        sensor = replace(sensor, **{name: jnp.zeros_like(value)})
    return sensor


def arm_state(carry: Carry) -> tuple[np.ndarray, np.ndarray]:
    """Joint positions [n], rad or m, and velocities [n], rad/s or m/s, in a state of the loop."""
    q, dq = jax.tree.map(np.asarray, (carry.state.q, carry.state.dq))
    return q, dq


SLOW = 5.0
"""Velocity below which Coulomb friction acts as damping, as a multiple of the width v_s of its sign change."""


def linearisation_notes(loop: ClosedLoop, carry: Carry, *, rough: bool) -> list[str]:
    """Return sentences on the limits of a linearisation, which `LinearisedLoop.notes` has.

    They are about frozen learning, nonsmooth points, joints too slow for linear friction, and saturated drives.

    - `carry`: state of the loop.
    - `rough`: True if the derivative and central differences disagree.
    """
    notes = []
    law = loop.controller
    if isinstance(law, SampledData) and law.adaptation is not None:
        notes.append("learning: the learnt rotor inertias and friction are frozen at that time")
    if rough:
        notes.append(
            "not smooth: the derivative and central differences with relative steps of 1e-6 disagree, since a gate, a "
            "limit or a sign function switches nearby; the stability result holds only for smaller motions"
        )
    robot = loop.plant.robot
    if isinstance(robot, Articulated):
        slow = (np.asarray(robot.coulomb) > 0) & (np.abs(carry.state.dq) < SLOW * np.asarray(robot.smoothing))
        if slow.any():
            joints = ", ".join(name for name, applies in zip(robot.joint_names, slow, strict=True) if applies)
            units = " or ".join(dict.fromkeys(f"{unit}/s" for unit in np.array(robot.joint_units)[slow]))
            notes.append(
                f"Coulomb friction of {joints} counts as damping, `coulomb/smoothing` at rest: this holds only for "
                f"velocities below {float(robot.smoothing):g} {units}"
            )
    drive = loop.plant.actuator
    if drive is not None and carry.actuator is not None:
        last = np.asarray(carry.actuator.commands[0])
        limit = np.broadcast_to(np.asarray(drive.limits.torque), last.shape)
        full = np.abs(last) >= limit * (1 - 1e-9)
        if full.any():
            joints = ", ".join(name for name, applies in zip(robot.joint_names, full, strict=True) if applies)
            notes.append(f"the torque limit is reached at {joints}: there the loop is open")
    return notes


Array = NDArray[np.float64]

STEP = 1e-6
"""Relative step of the central differences; relative to 0.01 for smaller values."""

ROUNDING = 16.0
"""Assumed rounding error of a sample's values, in units in the last place."""

ROUGH = 1e-3
"""Relative difference between derivative and central differences above which the loop counts as nonsmooth."""

BROKEN = {"torque": ("torque", "torque"), "measurement": ("position", "position")}
"""Input and output of the opened loop, for each point where it can be opened."""


@dataclass(frozen=True, eq=False)
class LinearisedLoop:
    """The closed loop, linearised at a point of its run.

    - `scenario`: name of the scenario.
    - `at`: time [s].
    - `q`, `dq`: joint positions [n], rad or m, and velocities [n], rad/s or m/s, at this time.
    - `system`: linear system from all injected signals (`INPUTS` of `period_map.py`) to all `OUTPUTS`, with the states
      that connect them.
    - `joint_names`: names of the joints.
    - `held`: True if the torque is held over the period. Only then `closed_loop`, `loop_gain` and the margins exist.
    - `notes`: sentences on effects that are left out, frozen or nonsmooth.
    - `derivative_error`: largest difference between the Jacobian and central differences of the simulated sample,
      relative to the largest entry of the same column.
    """

    scenario: str
    at: float
    q: Array
    dq: Array
    system: SampledSystem
    joint_names: tuple[str, ...]
    held: bool
    notes: tuple[str, ...]
    derivative_error: float
    _known: dict[str, Any] = field(init=False, default_factory=dict, repr=False)

    @property
    def stable(self) -> bool:
        """True if the spectral radius is below 1."""
        return self.system.radius < 1.0

    @cached_property
    def modes(self) -> list[tuple[complex, float, float]]:
        """Eigenvalues on or above the real axis, slowest first, each with natural frequency [rad/s] and damping ratio.

        Modes with a modulus below 1e-9 are left out: they decay within a period.
        """
        modes = []
        for z in self.system.eigenvalues:
            if z.imag < 0 or abs(z) < 1e-9:
                continue
            s = np.log(complex(z)) / self.system.period
            size = abs(s)
            modes.append((complex(z), size, -s.real / size if size else 1.0))
        return modes

    def closed_loop(self, where: str) -> SampledSystem:
        """Return the closed loop from a signal injected at a point to the signal that returns there, for all joints.

        With the loop gain L at this point it is `-L (1 + L)⁻¹`.

        - `where`: "torque", between law and drives, or "measurement", between arm and sensor.

        Raises DefinitionError for another point, or in continuous mode.
        """
        if where not in BROKEN:
            raise DefinitionError(f'a loop can be opened at `where="torque"` or `where="measurement"`; got "{where}"')
        if not self.held:
            raise DefinitionError(
                "in continuous mode the torque changes within a period, and no sampled loop can be opened: "
                "set `simulation.mode` to `held`"
            )
        return self.system.select(*BROKEN[where])

    def loop_gain(self, where: str, joint: int) -> SampledSystem:
        """Return the loop gain L of a joint, with the loop opened at a point and the loops of all other joints closed.

        - `where`: as in `closed_loop`.

        Raises DefinitionError as `closed_loop` does.
        """
        closed = self._closed_joint(where, joint)
        return SampledSystem(
            a=closed.a - closed.b @ closed.c,
            b=closed.b,
            c=-closed.c,
            d=-closed.d,
            period=closed.period,
            inputs=closed.inputs,
            outputs=closed.outputs,
            input_units=closed.input_units,
            output_units=closed.output_units,
        )

    def margins(self, where: str) -> list[Margins] | None:
        """Margins of each joint, with the loops of the other joints closed; None if the closed loop is unstable.

        - `where`: as in `closed_loop`.

        Raises DefinitionError as `closed_loop` does.
        """
        if not self.stable:
            return None
        names = [f"{where}[{name}]" for name in self.joint_names]
        if where not in self._known:
            self._known[where] = [margins_of(self._closed_joint(where, k), name) for k, name in enumerate(names)]
        return self._known[where]

    def simultaneous_margins(self, where: str) -> tuple[float, float, float] | None:
        """Disk margin for simultaneous changes in all joints, peak of the sensitivity S, and its frequency [rad/s].

        The peak is the largest singular value of `S = (1 + L)⁻¹`, with the loop gain L. None if the loop is unstable.

        - `where`: as in `closed_loop`.

        Raises DefinitionError as `closed_loop` does.
        """
        return simultaneous_margins(self.closed_loop(where)) if self.stable else None

    def _closed_joint(self, where: str, joint: int) -> SampledSystem:
        closed = self.closed_loop(where)
        return closed.select([closed.inputs[joint]], [closed.outputs[joint]])

    def as_json(self) -> dict[str, Any]:
        """The result as the dictionary that `slidax linear --json` prints."""
        margins: dict[str, Any] = {}
        if self.held and self.stable:
            for where in BROKEN:
                disk, peak, omega = self.simultaneous_margins(where) or (math.nan,) * 3
                margins[where] = {
                    "joints": [margin.as_json() for margin in self.margins(where) or []],
                    "together": {"disk": disk, "sensitivity": peak, "at_peak": omega},
                }
        system = self.system
        return {
            "scenario": self.scenario,
            "at": self.at,
            "period": system.period,
            "stable": self.stable,
            "radius": system.radius,
            "eigenvalues": [[float(z.real), float(z.imag)] for z in system.eigenvalues],
            "margins": margins or None,
            "notes": list(self.notes),
            "difference": self.derivative_error,
            "system": {
                "A": system.a.tolist(),
                "B": system.b.tolist(),
                "C": system.c.tolist(),
                "D": system.d.tolist(),
                "inputs": list(system.inputs),
                "outputs": list(system.outputs),
            },
        }


def linearise(scenario: Scenario, at: float | None = None) -> LinearisedLoop:
    """Linearise a scenario's closed loop at a time of its run, by the exact derivative of a sampling period.

    The linearised map is one period of the simulation: sensor, estimator, prediction, law, drives, and the arm between
    two samples. Parts without a derivative are left out or frozen, and listed in `notes`: sensor rounding, noise and
    lost samples, and learning. The result is time-invariant; along a motion it describes the loop frozen at this time.

    - `at`: time [s], rounded to the nearest sample; by default the end of the run.

    Raises DefinitionError if the time is not within the run, the run ends earlier, MuJoCo simulates the arm, the arm
    has a transmission, or the loop has no derivative at this time.
    """
    h = scenario.period
    at = scenario.t1 if at is None else at
    if not (math.isfinite(at) and h <= at <= scenario.t1 + 0.5 * h):
        raise DefinitionError(f"`at` must be from {h:g} to {scenario.t1:g} s; got {at:g}")
    at = round(at / h) * h
    loop, carry, notes = operating_point(scenario, at)
    loop_map = period_map(loop, carry)
    derivative = loop_map.derivative()
    m = loop_map.x.size
    if not np.isfinite(derivative).all():
        raise DefinitionError(
            f"the loop has no derivative at t = {at:g} s: a part of it is infinitely steep there, such as the sign "
            "function of a law without a boundary layer; give `layer` a width, or choose another time"
        )
    names = tuple(loop.plant.robot.joint_names)
    inputs, outputs = _names(INPUTS, names), _names(OUTPUTS, names)
    a, b, c, d = derivative[:m, :m], derivative[:m, m:], derivative[m:, :m], derivative[m:, m:]
    kept = connected_states(a, b, c)
    error = _derivative_error(loop_map, derivative, kept)
    q, dq = arm_state(carry)
    units = loop.plant.robot.joint_units
    return LinearisedLoop(
        scenario=scenario.name,
        at=at,
        q=q,
        dq=dq,
        system=SampledSystem(
            a=a[np.ix_(kept, kept)],
            b=b[kept],
            c=c[:, kept],
            d=d,
            period=h,
            inputs=inputs,
            outputs=outputs,
            input_units=_units(INPUTS, units),
            output_units=_units(OUTPUTS, units),
        ),
        joint_names=names,
        held=not loop.continuous,
        notes=(*notes, *linearisation_notes(loop, carry, rough=error > ROUGH)),
        derivative_error=error,
    )


def _derivative_error(loop_map: PeriodMap, derivative: Array, kept: Any) -> float:
    """Largest relative difference between derivatives and central differences, over the connected states."""
    m = loop_map.x.size
    here = np.concatenate([loop_map.x, np.zeros(loop_map.inputs)])
    steps = STEP * np.maximum(np.abs(here), 1e-2)
    value = loop_map.evaluate(here, np.zeros_like(here))[0]
    rows = np.concatenate([kept, np.arange(m, m + loop_map.outputs)])
    columns = np.concatenate([kept, np.arange(m, m + loop_map.inputs)])
    connected = np.ix_(rows, columns)
    off = np.abs(derivative - loop_map.differences(steps))[connected]
    # Subtract the rounding error of the differences.
    rounding = ROUNDING * np.finfo(float).eps * (np.abs(value)[:, None] + np.abs(derivative).max(axis=1)[:, None])
    off = np.maximum(off - (rounding / steps)[connected], 0.0)
    size = np.abs(derivative)[connected].max(axis=0)
    return float((off.max(axis=0) / np.where(size > 0, size, 1.0)).max())


def _names(groups: tuple[str, ...], joints: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{group}[{joint}]" for group in groups for joint in joints)


def _units(groups: tuple[str, ...], joints: tuple[str, ...]) -> tuple[str, ...]:
    motion_units: dict[str, str] = {
        "reference_velocity": "{0}/s",
        "velocity": "{0}/s",
        "reference_acceleration": "{0}/s²",
    }
    torque = {"rad": "N m", "m": "N"}
    return tuple(
        torque[unit] if group in ("disturbance", "torque") else motion_units.get(group, "{0}").format(unit)
        for group in groups
        for unit in joints
    )
