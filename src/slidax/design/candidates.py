"""Candidate designs: the values that a search chooses, and the scenario for each of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import as_array
from slidax.scenarios.draft import DRIFT, EXPONENT, OVERSHOOT, RADIUS, REACHING, SURFACE, WIDTH
from slidax.scenarios.sampled_data import KalmanDescription, MeasuredDescription
from slidax.scenarios.scenario import OpenLoop, ScenarioDescription

Floats = NDArray[np.floating[Any]]

HORIZONS = (6.0, 9.0, 14.0, 20.0, 28.0)
"""H that are tried, in periods, or in ms where a period is shorter than that."""

LONG_HORIZONS = (40.0, 56.0)
"""Further H that are tried for a bound, which needs less torque the longer H is."""

DRIFTS = (0.25, 1.0, 4.0)
"""Times the drift of the disturbance that `slidax new` takes: the torque density goes with its square."""

SLOPES = (1.0, 2.0, 4.0)
"""Times k1 and k2 of `slidax new`."""

EXACT = {"inverse_inertia_min": 1.0, "inverse_inertia_max": 1.0, "b0": 0.0, "b1": 0.0, "b2": 0.0}
"""Bound (19) that is its margin u alone."""

LARGEST = 0.25
"""Of the envelope at the start, that the final one may be at most."""

ROOM = 1.6
"""The envelope at the start over the largest error there."""

UNRATED = 2.0
"""A drive without a limit is taken for one of so many times the torque that holds and moves the arm."""


def template(deadline: float) -> dict[str, Any]:
    """Return a scheme as a scenario file has it, of which `Frame.described` sets the searched values.

    - `deadline`: T [s].
    """
    performance = {"kind": "fixed_time", "initial": 1.0, "final": 0.1, "deadline": deadline, "exponent": EXPONENT}
    return {
        "name": "cftsmppc",
        "performance": performance,
        "overshoot": OVERSHOOT,
        "surface": SURFACE,
        "reaching": REACHING,
        "sampled_data": {"monitor": {"share": 1.0, "led": 1.0}},
    }


@dataclass(frozen=True)
class DesignPoint:
    """Searched values of a law.

    - `horizon`: H [s].
    - `drift`: of the estimator's disturbance, as in `DRIFTS`; None with the `measured` estimator.
    - `slope`: times k1 and k2; `bend`: times k2 besides.
    - `final`: ρ∞ of each joint [n], rad or m.
    - `deadline`: T [s].
    - `margin`: u [N m]; None where the arm's own is taken.
    - `even`: 0 where drifts of the joints go with their torques, 1 where they are the same.
    - `overshoot`: ϑ, the width of the envelope's far side over ρ.
    - `gain`: of the `measured` estimator, times its own for this horizon.
    """

    horizon: float
    drift: float | None
    slope: float
    final: Floats
    deadline: float
    margin: float | None = None
    even: float = 0.0
    bend: float = 1.0
    overshoot: float = OVERSHOOT
    gain: float = 1.0


@dataclass(frozen=True)
class DesignSpace:
    """Values that all choices for an arm share.

    - `base`: the scenario with the template of `template`.
    - `initial`: ρ0 of each joint [n], rad or m.
    - `shape`: ρ∞ of each joint for a radius of 1 [n].
    - `torque`: rated, or what takes its place [n], N m or N.
    - `middle`: for each joint the geometric mean of those of the same unit [n].
    - `period`: h [s]; `delay`: of measurement and command [periods].
    - `has_velocity`: whether velocities are measured.
    - `changes`: of torque in a period that each drive allows [n], N m or N; infinite where it has no such limit.
    - `least_margin`: the smallest u where it is searched for, too [N m]; None where it is not.
    - `along`: whether the law has the form that `tracking_bound` covers: the same loop in all joints, no learning. If
      not, it learns the inertia.
    """

    base: ScenarioDescription
    initial: Floats
    shape: Floats
    torque: Floats
    middle: Floats
    period: float
    delay: float
    has_velocity: bool
    changes: Floats
    least_margin: float | None = None
    along: bool = False

    @property
    def radius(self) -> float:
        """The radius that `slidax new` takes for this period."""
        return RADIUS * self.period

    @property
    def least(self) -> float:
        """The shortest H that is tried, by what a delay leaves: `(2 + 2 D) h` [s]."""
        return (2.0 + 2.0 * self.delay) * self.period

    @property
    def horizons(self) -> tuple[float, ...]:
        """H that are tried first [s]."""
        unit, counts = max(self.period, 1e-3), (*HORIZONS, *LONG_HORIZONS) if self.along else HORIZONS
        return tuple(sorted({round(max(count * unit, self.least), 9) for count in counts}))

    def density(self, drift: float, even: float = 0.0) -> Floats:
        """The torque density of the Kalman filter of each joint, `(drift √density)²` [n], (N m/s)² s.

        - `drift`: times that of `slidax new`.
        - `even`: of the choice.
        """
        return (drift * DRIFT * self.torque * (self.middle / self.torque) ** even) ** 2

    def common_density(self, drift: float) -> float:
        """The acceleration density of the Kalman filter of every joint, (rad/s³)² s.

        - `drift`: of the choice.
        """
        return float(f"{drift**2:.4g}")

    def measured_gain(self, choice: DesignPoint) -> float:
        """The gain of the `measured` estimator: after the horizon, as a scenario without one has it.

        - `choice`: its numbers.
        """
        return float(f"{min(choice.gain * min(0.5, 2.0 * self.period / choice.horizon), 1.0):.4g}")

    def described(self, choice: DesignPoint, monitor: float = 1.0) -> ScenarioDescription:
        """Return the scenario of a choice, a copy of `base`.

        - `monitor`: share of the envelope at which the monitor warns.
        """
        scheme: Any = self.base.scheme
        performance = scheme.transformation.performance.model_copy(
            update={
                "initial": round_for_file(self.initial),
                "final": round_for_file(choice.final),
                "deadline": choice.deadline,
            }
        )
        surface = {"k1": SURFACE["k1"] * choice.slope, "k2": SURFACE["k2"] * choice.slope * choice.bend}
        sampled: dict[str, Any] = {
            "horizon": float(f"{choice.horizon:.6g}"),
            "estimator": self._estimator(choice),
            "monitor": scheme.sampled_data.monitor.model_copy(update={"share": monitor, "led": monitor}),
        }
        if self.along:
            viscous = hasattr(self.base.robot.build().nominal, "viscous")
            sampled |= {"adaptation": None, "midpoint": True, "viscous_feedforward": viscous}
        changes = {
            "transformation": scheme.transformation.model_copy(
                update={"performance": performance, "overshoot": choice.overshoot}
            ),
            "surface": scheme.surface.model_copy(update=surface),
            "sampled_data": scheme.sampled_data.model_copy(update=sampled),
        }
        if choice.margin is not None:
            bound = {**EXACT, "margin": float(f"{choice.margin:.4g}")}
            changes["bound"] = scheme.bound.model_copy(update=bound)
        return self.base.model_copy(update={"scheme": scheme.model_copy(update=changes)})

    def _estimator(self, choice: DesignPoint) -> KalmanDescription | MeasuredDescription:
        if choice.drift is None:
            return MeasuredDescription(kind="measured", gain=self.measured_gain(choice))
        if self.along:
            return KalmanDescription(kind="kalman", acceleration_density=self.common_density(choice.drift))
        density = round_for_file(self.density(choice.drift, choice.even))
        return KalmanDescription(kind="kalman", torque_density=density)

    def at_period(self, period: float, t1: float) -> DesignSpace:
        """Return the same frame at another `period` [s]; runs end at `t1`, rounded to whole periods [s]."""
        simulation = self.base.simulation.model_copy(
            update={"period": period, "t1": float(round(t1 / period) * period)}
        )
        return replace(self, base=self.base.model_copy(update={"simulation": simulation}), period=period)

    def values(self, choice: DesignPoint) -> dict[str, Any]:
        """The numbers of a choice by their paths in a scenario, u where it is searched for.

        - `choice`: its numbers.
        """
        performance = "scheme.transformation.performance"
        result: dict[str, Any] = {
            "scheme.sampled_data.horizon": choice.horizon,
            "scheme.surface.k1": SURFACE["k1"] * choice.slope,
            "scheme.surface.k2": SURFACE["k2"] * choice.slope * choice.bend,
            "scheme.transformation.overshoot": choice.overshoot,
            f"{performance}.final": np.asarray(round_for_file(choice.final)),
            f"{performance}.deadline": choice.deadline,
        }
        if self.least_margin is not None and choice.margin is not None:
            result["scheme.bound.margin"] = float(f"{choice.margin:.4g}")
        if choice.drift is not None:
            if self.along:
                result["scheme.sampled_data.estimator.acceleration_density"] = self.common_density(choice.drift)
            else:
                density = np.asarray(round_for_file(self.density(choice.drift, choice.even)))
                result["scheme.sampled_data.estimator.torque_density"] = density
        else:
            result["scheme.sampled_data.estimator.gain"] = self.measured_gain(choice)
        return result


def design_space(
    base: ScenarioDescription,
    moving: OpenLoop,
    starts: tuple[Floats, Floats],
    shape: Floats,
    *,
    period: float,
    delay: float,
    has_velocity: bool,
) -> DesignSpace:
    """Return the frame for an arm and its starts.

    - `base`: the scenario with the template; `moving`: its closed loop without the law.
    - `starts`: the least and the largest position of each joint at t = 0 [n].
    - `shape`: ρ∞ of each joint for a radius of 1 [n].
    - `period`: h [s]; `delay`: of measurement and command [periods].
    - `has_velocity`: whether velocities are measured.
    """
    arm = moving.arms.nominal
    n = arm.joints
    reference = moving.trajectory.reference(as_array(0.0))
    q, dq, ddq = (np.asarray(item, float) for item in (reference.q, reference.dq, reference.ddq))
    away = np.maximum(np.abs(starts[0] - q), np.abs(starts[1] - q))
    wide = np.array([WIDTH[unit] for unit in arm.joint_units])
    limits = moving.drive.limits()
    torque = np.broadcast_to(np.asarray(limits.torque, float), (n,))
    mass, bias = np.asarray(arm.mass(moving.state0.q)), np.asarray(arm.bias(moving.state0.q, moving.state0.dq))
    holds = np.abs(bias) + np.abs(mass) @ (np.abs(ddq) + np.abs(dq) + 1.0)
    torque = np.where(np.isfinite(torque), torque, UNRATED * holds)
    initial = np.maximum(wide, np.ceil(20.0 * ROOM * away) / 20.0)
    alike = np.array([[item == other for other in arm.joint_units] for item in arm.joint_units], float)
    middle = np.exp(alike @ np.log(torque) / alike.sum(axis=1))
    changes = period * np.broadcast_to(np.asarray(limits.rate, float), (n,))
    return DesignSpace(base, initial, shape, torque, middle, period, delay, has_velocity, changes)


def round_for_file(values: Any) -> list[float]:
    """Numbers as a file has them.

    - `values`: [n].
    """
    return [float(f"{value:.4g}") for value in np.asarray(values, float)]
