"""The closed loop as it is simulated, near a point of its run, as a linear system."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError
from slidax.scenarios import Scenario

from .margins import Margins, margins_of, together
from .notes import said_of
from .operating_point import operating_point, reached
from .period_map import INPUTS, OUTPUTS, PeriodMap, period_map
from .sampled_system import SampledSystem, needed

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
class Linear:
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
        return together(self.closed(where), where) if self.stable else None

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


def linearise(scenario: Scenario, at: float | None = None) -> Linear:
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
    kept = needed(a, b, c)
    apart = _apart(loop_map, derivative, kept)
    q, dq = reached(carry)
    units = loop.plant.robot.joint_units
    return Linear(
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
        notes=(*notes, *said_of(loop, carry, rough=apart > ROUGH)),
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
