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
"""Fields of a sensor that are set to zero."""


def operating_point(scenario: Scenario, at: float) -> tuple[ClosedLoop, Carry, list[str]]:
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
        return DelayLine(_quiet(sensor.sensor, left_out), sensor.periods)
    for name in QUIET:
        value = getattr(sensor, name, None)
        if value is None or not np.any(np.asarray(value) > 0):
            continue
        label = "rounding by the encoders" if name == "resolution" else name.replace("_", " ")
        left_out.append(f"{label}: measured as it is")
        sensor = replace(sensor, **{name: jnp.zeros_like(value)})
    return sensor


def arm_state(carry: Carry) -> tuple[np.ndarray, np.ndarray]:
    """Where the arm is, and how fast, [n] and [n]."""
    q, dq = jax.tree.map(np.asarray, (carry.state.q, carry.state.dq))
    return q, dq


SLOW = 5.0
"""Times v_s: below this velocity the Coulomb friction of a joint acts as damping."""


def linearisation_notes(loop: ClosedLoop, carry: Carry, *, rough: bool) -> list[str]:
    """Notes on frozen parts and on points where the loop is not smooth, one sentence each.

    - `carry`: what it has at the time.
    - `rough`: whether derivative and differences disagree.
    """
    notes = []
    law = loop.controller
    if isinstance(law, SampledData) and law.adaptation is not None:
        notes.append("learning: rotors and friction stay as they are believed to be at that time")
    if rough:
        notes.append(
            "not smooth: within a millionth the loop bends so much that derivative and differences disagree; a gate, a "
            "limit or a sign is near, and what is said of stability holds for smaller motions still"
        )
    robot = loop.plant.robot
    if isinstance(robot, Articulated):
        slow = (np.asarray(robot.coulomb) > 0) & (np.abs(carry.state.dq) < SLOW * np.asarray(robot.smoothing))
        if slow.any():
            joints = ", ".join(name for name, applies in zip(robot.joint_names, slow, strict=True) if applies)
            notes.append(
                f"Coulomb friction of {joints} counts as damping, f_c/v_s at rest: that holds for velocities below "
                f"{float(robot.smoothing):g} rad/s alone"
            )
    drive = loop.plant.actuator
    if drive is not None and carry.actuator is not None:
        last = np.asarray(carry.actuator.commands[0])
        limit = np.broadcast_to(np.asarray(drive.limits.torque), last.shape)
        full = np.abs(last) >= limit * (1 - 1e-9)
        if full.any():
            joints = ", ".join(name for name, applies in zip(robot.joint_names, full, strict=True) if applies)
            notes.append(f"{joints} is at its limit of torque: there its loop is open")
    return notes


Array = NDArray[np.float64]

STEP = 1e-6
"""Of the central differences, beside the size of a number, or 1 for what is smaller."""

ROUNDING = 16.0
"""Units in the last place that a sample's numbers may be off by rounding."""

ROUGH = 1e-3
"""Where they differ by more than this, the loop bends within so little that its derivative says nothing."""

BROKEN = {"torque": ("torque", "torque"), "measurement": ("position", "position")}
"""Where a loop is broken open: what is added there, and what comes round."""


@dataclass(frozen=True, eq=False)
class LinearisedLoop:
    """The closed loop near a point of its run.

    - `scenario`: its name.
    - `at`: the time [s].
    - `q`, `dq`: where the arm is there, and how fast [n].
    - `system`: from all that can enter to all that is asked, with the states that matter.
    - `joint_names`: of its joints.
    - `held`: whether the torque is held over the period, so that the loop can be broken open.
    - `notes`: what was left out, frozen, or is not smooth there, in words.
    - `apart`: the largest difference of a derivative from central differences of the simulated sample, as a part of the
      largest number in its column.
    """

    scenario: str
    at: float
    q: Array
    dq: Array
    system: SampledSystem
    joint_names: tuple[str, ...]
    held: bool
    notes: tuple[str, ...]
    apart: float
    _known: dict[str, Any] = field(init=False, default_factory=dict, repr=False)

    @property
    def stable(self) -> bool:
        """True if the loop is stable there: its spectral radius is below 1."""
        return self.system.radius < 1.0

    @cached_property
    def modes(self) -> list[tuple[complex, float, float]]:
        """Eigenvalues on or above the real axis, the slowest first: each with its frequency [rad/s] and damping.

        Those of a natural frequency beyond half of the sampling frequency are left out: they are over in a period.
        """
        modes = []
        for z in self.system.eigenvalues:
            if z.imag < 0 or abs(z) < 1e-9:
                continue
            s = np.log(complex(z)) / self.system.period
            size = abs(s)
            modes.append((complex(z), size, -s.real / size if size else 1.0))
        return modes

    def closed(self, where: str) -> SampledSystem:
        """From what is added at a place to what comes round there.

        - `where`: "torque", between law and drives, or "measurement", between arm and sensor.

        Raises DefinitionError for another place, or in continuous mode.
        """
        if where not in BROKEN:
            raise DefinitionError(f'a loop can be broken at the "torque" or the "measurement"; got "{where}"')
        if not self.held:
            raise DefinitionError(
                "in continuous mode the torque follows within a period, so that no sampled loop can be broken open: "
                "set `simulation.mode` to `held`"
            )
        return self.system.part(*BROKEN[where])

    def loop(self, where: str, joint: int) -> SampledSystem:
        """L of one joint, the others closed: what comes round, with its sign turned, where the loop is broken there.

        - `where`: as in `closed`.

        Raises DefinitionError as `closed` does.
        """
        closed = self._of_joint(where, joint)
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
        """Of each joint with the others closed; None for a loop that is not stable, which has none.

        - `where`: as in `closed`.

        Raises DefinitionError as `closed` does.
        """
        if not self.stable:
            return None
        names = [f"{where}[{name}]" for name in self.joint_names]
        if where not in self._known:
            self._known[where] = [margins_of(self._of_joint(where, k), name) for k, name in enumerate(names)]
        return self._known[where]

    def together(self, where: str) -> tuple[float, float, float] | None:
        """Disk margin, peak of the largest singular value of S, and its frequency [rad/s], for all joints at once.

        - `where`: as in `closed`.

        None for a loop that is not stable.
        """
        return simultaneous_margins(self.closed(where), where) if self.stable else None

    def _of_joint(self, where: str, joint: int) -> SampledSystem:
        closed = self.closed(where)
        return closed.part([closed.inputs[joint]], [closed.outputs[joint]])

    def as_json(self) -> dict[str, Any]:
        """All of it, as `slidax linear --json` prints it."""
        margins: dict[str, Any] = {}
        if self.held and self.stable:
            for where in BROKEN:
                disk, peak, omega = self.together(where) or (math.nan,) * 3
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
            "difference": self.apart,
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
    """The closed loop of a scenario near a point of its run: one period of it, by its exact derivative.

    The linearised map is the simulated sample: sensor, estimator, prediction, law, drives, and the arm between
    two samples. Parts without a derivative are left out or frozen, and listed in `notes`: rounding, noise
    and lost samples of sensors, and learning, which stays as it is at that time. For a
    motion the system is that of the moment, as if it stayed; at rest it is the loop's.

    - `at`: when [s]; the nearest sample is taken; the end of the run if not given.

    Raises DefinitionError if the run ends before, or the arm is MuJoCo's.
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
            f"the loop has no derivative at t = {at:g} s: a part of it is infinitely steep there, as the sign in a law "
            "without a layer is at zero; give `layer` a width, or another time"
        )
    names = tuple(loop.plant.robot.joint_names)
    inputs, outputs = _names(INPUTS, names), _names(OUTPUTS, names)
    a, b, c, d = derivative[:m, :m], derivative[:m, m:], derivative[m:, :m], derivative[m:, m:]
    kept = connected_states(a, b, c)
    apart = _apart(loop_map, derivative, kept)
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
        notes=(*notes, *linearisation_notes(loop, carry, rough=apart > ROUGH)),
        apart=apart,
    )


def _apart(loop_map: PeriodMap, derivative: Array, kept: Any) -> float:
    """Largest relative difference between derivatives and central differences, over the connected states."""
    m = loop_map.x.size
    here = np.concatenate([loop_map.x, np.zeros(loop_map.inputs)])
    steps = STEP * np.maximum(np.abs(here), 1e-2)
    value = loop_map.evaluate(here, np.zeros_like(here))[0]
    rows = np.concatenate([kept, np.arange(m, m + loop_map.outputs)])
    columns = np.concatenate([kept, np.arange(m, m + loop_map.inputs)])
    place = np.ix_(rows, columns)
    off = np.abs(derivative - loop_map.differences(steps))[place]
    # Subtract the rounding error of the differences.
    rounding = ROUNDING * np.finfo(float).eps * (np.abs(value)[:, None] + np.abs(derivative).max(axis=1)[:, None])
    off = np.maximum(off - (rounding / steps)[place], 0.0)
    size = np.abs(derivative)[place].max(axis=0)
    return float((off.max(axis=0) / np.where(size > 0, size, 1.0)).max())


def _names(groups: tuple[str, ...], joints: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{group}[{joint}]" for group in groups for joint in joints)


def _units(groups: tuple[str, ...], joints: tuple[str, ...]) -> tuple[str, ...]:
    of: dict[str, str] = {
        "reference_velocity": "{0}/s",
        "velocity": "{0}/s",
        "reference_acceleration": "{0}/s²",
    }
    torque = {"rad": "N m", "m": "N"}
    return tuple(
        torque[unit] if group in ("disturbance", "torque") else of.get(group, "{0}").format(unit)
        for group in groups
        for unit in joints
    )
