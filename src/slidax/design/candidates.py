"""Candidate designs: the values that a search chooses, and the scenario for each of them.

The searched law is `cftsmppc` in its sampled-data form. Its symbols and parameters are those of a scenario file.
"""

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
"""Horizons H of the grid, in periods, or in ms if a period is shorter than 1 ms."""

LONG_HORIZONS = (40.0, 56.0)
"""Further horizons of the grid if a bound is required: a law with a longer horizon needs less torque."""

DRIFTS = (0.25, 1.0, 4.0)
"""Factors of the disturbance drift of `slidax new`; the torque density is proportional to the drift's square."""

SLOPES = (1.0, 2.0, 4.0)
"""Factors of k1 and k2 of `slidax new`."""

EXACT = {"inverse_inertia_min": 1.0, "inverse_inertia_max": 1.0, "b0": 0.0, "b1": 0.0, "b2": 0.0}
"""Parameters of `UncertaintyBound` for which the size u of the robust torque is equal to its margin k."""

LARGEST = 0.25
"""Largest final radius of the envelope, as a share of its initial radius."""

ROOM = 1.6
"""Least initial radius of the envelope, as a multiple of the largest initial error."""

UNRATED = 2.0
"""Assumed rated torque of a drive without a torque limit, as a multiple of the torque that holds and moves the arm."""


def template(deadline: float) -> dict[str, Any]:
    """Return the block `scheme` of a scenario file, in which `DesignSpace.described` sets the searched values.

    - `deadline`: T, time from which on the envelope has its final radius [s].
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

    - `horizon`: planning horizon H of the law [s].
    - `drift`: factor of the assumed disturbance drift, to whose square the Kalman filter's noise density is
      proportional; None with the `measured` estimator.
    - `slope`, `bend`: factor of the surface gains k1 and k2, relative to `slidax new`, and a further factor of k2.
    - `final`: final radius ρ∞ of each joint's envelope [n], rad or m.
    - `deadline`: T, time from which on the envelope has its final radius [s].
    - `margin`: u, size of the robust torque [N m]; None for the default bound of the arm.
    - `even`: distribution of the assumed drift over the joints: 0 in proportion to each joint's rated torque, 1 equal.
    - `overshoot`: ϑ, width of the envelope's narrower side over its radius ρ.
    - `gain`: factor of the `measured` estimator's gain, relative to its default for this horizon.
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
    """Values that are common to all candidate laws for an arm.

    - `base`: the scenario with the scheme from `template`.
    - `initial`: initial radius ρ0 of each joint's envelope [n], rad or m.
    - `shape`: final radius of each joint [n], rad or m, up to a common factor that is searched.
    - `torque`: rated torque of each joint; without a torque limit an assumed one [n], N m or N.
    - `middle`: for each joint, the geometric mean of `torque` over all joints with the same unit [n].
    - `period`, `delay`: sampling period h [s], and the delay of measurement and command together [periods].
    - `has_velocity`: True if velocities are measured.
    - `changes`: largest torque change of each drive in a period [n], N m or N; infinite without a rate limit.
    - `least_margin`: lower limit of the robust torque's size u if u is searched [N m]; None if it is not.
    - `along`: True if the law must have the form that the certificate `tracking_bound` covers: equal estimator gains in
      all joints, and no adaptation. Otherwise the law learns the inertia.
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
        """Final radius that `slidax new` chooses for this period."""
        return RADIUS * self.period

    @property
    def least(self) -> float:
        """Shortest horizon for this delay of D periods h, `(2 + 2 D) h` [s]."""
        return (2.0 + 2.0 * self.delay) * self.period

    @property
    def horizons(self) -> tuple[float, ...]:
        """Horizons of the grid [s]."""
        unit, counts = max(self.period, 1e-3), (*HORIZONS, *LONG_HORIZONS) if self.along else HORIZONS
        return tuple(sorted({round(max(count * unit, self.least), 9) for count in counts}))

    def density(self, drift: float, even: float = 0.0) -> Floats:
        """Return the Kalman filters' `torque_density`, the drift noise of the disturbance torques, [n], (N m/s)² s.

        - `drift`, `even`: as in `DesignPoint`.
        """
        return (drift * DRIFT * self.torque * (self.middle / self.torque) ** even) ** 2

    def common_density(self, drift: float) -> float:
        """Return the Kalman filters' `acceleration_density`, equal for all joints, (rad/s³)² s.

        It is the density of the white noise that drives the disturbance acceleration.

        - `drift`: as in `DesignPoint`.
        """
        return float(f"{drift**2:.4g}")

    def measured_gain(self, choice: DesignPoint) -> float:
        """Return the gain of the `measured` estimator: `choice.gain` times the default for the horizon, at most 1."""
        return float(f"{min(choice.gain * min(0.5, 2.0 * self.period / choice.horizon), 1.0):.4g}")

    def described(self, choice: DesignPoint, monitor: float = 1.0) -> ScenarioDescription:
        """Return the scenario of a law: a copy of `base` with the law's values.

        - `choice`: searched values of the law.
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
        """Return the space for another `period` [s], with runs until `t1` [s], rounded to whole periods."""
        simulation = self.base.simulation.model_copy(
            update={"period": period, "t1": float(round(t1 / period) * period)}
        )
        return replace(self, base=self.base.model_copy(update={"simulation": simulation}), period=period)

    def values(self, choice: DesignPoint) -> dict[str, Any]:
        """Return the searched values of a law by their dotted paths in the scenario, such as `scheme.surface.k1`."""
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
    """Return the design space for an arm and its initial states.

    - `base`: the scenario with the scheme from `template`.
    - `moving`: its arms, drives, plant, trajectory and initial state, without a law.
    - `starts`: least and largest position of each joint at t = 0, [n] each.
    - `shape`, `period`, `delay`, `has_velocity`: as in `DesignSpace`.
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
    """Return values [n], rounded to the four significant digits of a design file."""
    return [float(f"{value:.4g}") for value in np.asarray(values, float)]
