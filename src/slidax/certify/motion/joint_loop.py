"""The linear loop of a joint with the law that is certified along motions; one period is a set of linear maps.

The error e with the velocity v obeys `ë = s + w + ρ` (docs/any-motion.md). w is the disturbance, and ρ the reference's
mean acceleration in a period less its actual one. s is the feedback acceleration of a computed torque with a steady
Kalman filter. Its estimates are ê, v̂, ŵ; ê⁻, v̂⁻, ŵ⁻ are their predictions from the sample before:

    r = y - ê⁻,  ê = ê⁻ + L1 r,  v̂ = v̂⁻ + L2 r,  ŵ = ŵ⁻ + L3 r        (measurement y = e + n)
    s = -kp ê_p - kd v̂_p + g - ŵ                                        (decided D periods before it acts)

`ê_p, v̂_p` is the estimate, predicted over the delay with `s + ŵ`. g is the goal: an acceleration that the law itself
adds, so that its prediction contains g. The sliding variable σ accumulates the deviation of v̂_p from its planned value.
It decays by the factor `1 - h/H` in each period h, with the law's horizon H (docs/sampled-data.md):

    σ⁺ = (1 - h/H) σ + v̂_p⁺ - (v̂_p + h (s + ŵ))

The state at the start of a period is `(e, v, ê⁻, v̂⁻, ŵ⁻, σ⁻, planned v̂_p)`, followed by `(ê_p, v̂_p, ŵ, g)` of each
command that is decided but does not act yet. In the maps the unit of time is the period.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError
from slidax.law.calm_step import CalmStep
from slidax.law.error_transformations import Unconstrained
from slidax.law.implicit_steps import AbstractSurfaceStep
from slidax.law.kalman import Kalman, steady_gains
from slidax.law.linear_controllers import ComputedTorque
from slidax.law.sampled.controller import SampledData
from slidax.law.sampled.recipe import ExplicitStep

Floats = NDArray[np.float64]

OUTPUTS: dict[str, int] = {
    "error": 0,
    "velocity": 1,
    "command": 2,
    "acceleration": 2,
    "command_step": 2,
    "position_miss": 0,
    "velocity_miss": 1,
    "model_position": 0,
    "model_velocity": 1,
    "model_position_step": 0,
    "model_velocity_step": 1,
    "estimate": 2,
    "innovation": 0,
    "led": 0,
    "sliding": 1,
}
"""Outputs of the loop, with the order of their time derivative: 0 for rad, 1 for rad/s, 2 for rad/s².

- `error`, `velocity`: e and v when a period starts. `command`: s. `acceleration`: `κ (s + w)`, at any time.
- `command_step`, `model_position_step`, `model_velocity_step`: changes of the value from the period before.
- `model_position`, `model_velocity`: position and velocity at which the model is evaluated, less the reference.
- `position_miss`, `velocity_miss`: q and q̇ less the position and velocity at which the model is evaluated, at any time
  of the period. The part that is odd about the middle of the period is left out.
- `estimate`: ŵ. `innovation`: r. `led`: `ê_p + c v̂_p`, `c = H - h/2`. `sliding`: σ.
"""


@dataclass(frozen=True)
class JointLoop:
    """The linear loop of every joint; all joints have the same.

    - `period`: h [s]; `kp` [1/s²], `kd` [1/s]: gains of the computed torque.
    - `gains`: L1, L2 [1/s], L3 [1/s²] of the Kalman filter.
    - `delay`: D, from a measurement to the start of its torque, whole periods.
    - `lead`: c of the led error `ê_p + c v̂_p` [s]; 0 for a law that does not use the led error.

    Raises DefinitionError if a value is out of its range or the loop is unstable.
    """

    period: float
    kp: float
    kd: float
    gains: tuple[float, float, float]
    delay: int = 1
    lead: float = 0.0

    def __post_init__(self) -> None:
        if not self.period > 0:
            raise DefinitionError(f"`period` must be > 0 s; got {self.period:g}")
        if not (self.kp > 0 and self.kd > 0):
            raise DefinitionError(f"`kp` and `kd` must be > 0; got {self.kp:g} 1/s² and {self.kd:g} 1/s")
        if self.delay != int(self.delay) or not 0 <= self.delay <= 10:
            raise DefinitionError(f"`delay` must be 0 to 10 whole periods; got {self.delay:g}")
        radius = float(np.max(np.abs(np.linalg.eigvals(self.maps.step))))
        if not radius < 1.0 - 1e-6:
            raise DefinitionError(
                f"the loop of a joint is unstable: its largest eigenvalue is {radius:.4f}; choose a longer horizon "
                "or a slower filter"
            )

    @classmethod
    def of(cls, law: SampledData) -> JointLoop:
        """Return the loop of a law in sampled-data form. It holds while no limit acts and the gate accepts each sample.

        Raises DefinitionError for a law that this loop does not describe; the message names the setting to change.
        """
        if not isinstance(law.estimator, Kalman):
            raise DefinitionError(
                "a bound along a motion needs a Kalman filter; got the estimator "
                f"`{type(law.estimator).__name__}`: set `scheme.sampled_data.estimator` to `{ESTIMATOR}`"
            )
        block = "scheme.sampled_data"
        viscous = np.any(np.asarray(getattr(law.nominal, "viscous", 0.0)))
        for covered, problem, remedy in (
            (law.adaptation is None, "the law adapts its model", f"set `{block}.adaptation: null`"),
            (law.midpoint, "the model is evaluated at the start of a period", f"set `{block}.midpoint: true`"),
            (
                law.viscous_feedforward or not viscous,
                "the nominal arm's viscous friction is not compensated",
                f"set `{block}.viscous_feedforward: true`",
            ),
            (
                float(law.believed_delay).is_integer(),
                f"the measurement delay is {law.believed_delay:g} periods, not a whole number",
                "set `sensor.delay` to a whole number",
            ),
            (
                law.dead_time == 0,
                f"the dead time is {law.dead_time:g} periods",
                "set `actuator.dead_time: 0`, add it to `sensor.delay`, and evaluate the motion when the torque acts",
            ),
        ):
            if not covered:
                raise DefinitionError(f"a bound along a motion does not cover this law: {problem}; {remedy}")
        gains = tuple(
            equal_gain(f"L{k + 1}", gain, f"set `{block}.estimator` to `{ESTIMATOR}`, with one `variance`")
            for k, gain in enumerate(np.asarray(law.estimator.gains))
        )
        kp, kd, lead = _feedback(law)
        return cls(float(law.period), kp, kd, (gains[0], gains[1], gains[2]), int(law.believed_delay), lead)

    @classmethod
    def with_horizon(
        cls, period: float, horizon: float, gains: tuple[float, float, float], delay: int = 1
    ) -> JointLoop:
        """Return the loop of a computed torque with the horizon H [s], `kp = 1/H²`, `kd = (H - h/2)/H² + 1/H`.

        - `gains`, `delay`: as in `JointLoop`.
        """
        if not horizon >= period:
            raise DefinitionError(f"`horizon` must be at least the period; got {horizon:g} s")
        lead = horizon - 0.5 * period
        return cls(period, 1.0 / horizon**2, lead / horizon**2 + 1.0 / horizon, gains, delay, lead)

    @classmethod
    def with_density(
        cls, period: float, horizon: float, density: float, resolution: float, delay: int = 1
    ) -> JointLoop:
        """Return the loop with a horizon [s] and the steady Kalman filter of a random-walk disturbance.

        - `density`: spectral density of the rate of the disturbance, an acceleration, (rad/s³)² s.
        - `resolution`: r of the encoders [rad]; the filter assumes measurement noise with the variance r²/12.
        """
        first, second, third = np.asarray(steady_gains(density, resolution**2 / 12.0, period)).tolist()
        return cls.with_horizon(period, horizon, (first, second, third), delay)

    @cached_property
    def decay(self) -> float:
        """Rate at which the slowest state of the nominal loop decays [1/s]."""
        return -float(np.log(np.max(np.abs(np.linalg.eigvals(self.maps.step))))) / self.period

    @property
    def maps(self) -> PeriodMaps:
        """One period of the nominal loop as linear maps."""
        return self.maps_for(1.0)

    def maps_for(self, ratio: float) -> PeriodMaps:
        """Return one period of the loop as linear maps, for `ë = κ (s + w)` with the feedback s and the disturbance w.

        - `ratio`: κ, the nominal inertia over the true inertia.
        """
        size = OWN + PENDING * self.delay
        columns = [self._next(ratio, *parts) for parts in _unit_inputs(size)]
        states = np.stack([state for state, _ in columns], axis=1)
        outputs = np.stack([output for _, output in columns], axis=1)
        return PeriodMaps(
            step=states[:, :size],
            enters=states[:, size : size + 3],
            goal=states[:, size + 3],
            outputs=outputs[:, :size],
            direct=outputs[:, size],
            goal_direct=outputs[:, size + 3],
        )

    def _next(
        self, ratio: float, x: Floats, noise: float, pulse: float, velocity: float, goal: float
    ) -> tuple[Floats, Floats]:
        """Return the state after a period and the outputs in the period, with the period as the unit of time.

        - `x`: state at the start. `noise`: n. `pulse`, `velocity`: changes of e and v by w in the period. `goal`: g.
        """
        h = self.period
        first, second, third = self.gains[0], self.gains[1] * h, self.gains[2] * h * h
        kp, kd = self.kp * h * h, self.kd * h

        def aim(position: float, speed: float, goal: float) -> float:
            return -kp * position - kd * speed + goal

        e, v, position, speed, push = (float(value) for value in x[:5])
        residual = e + noise - position
        position, speed, push = position + first * residual, speed + second * residual, push + third * residual
        pending = [(float(a), float(b), float(c), float(d)) for a, b, c, d in x[OWN:].reshape(-1, PENDING)]
        prior = None
        for at, rate, known, added in pending:
            acceleration = aim(at, rate, added) - known + push
            position, speed = position + speed + 0.5 * acceleration, speed + acceleration
            prior = prior or (position, speed)
        pending.append((position, speed, push, goal))
        fade = 1.0 - h / (self.lead + 0.5 * h) if self.lead else 0.0
        sliding, planned = fade * x[5] + speed - x[6], speed + aim(position, speed, goal)
        if prior is None:
            acceleration = aim(position, speed, goal)
            prior = position + speed + 0.5 * acceleration, speed + acceleration
        at, rate, known, added = pending[0]
        aimed = aim(at, rate, added)
        s = aimed - known
        after = [e + v + 0.5 * ratio * s + pulse, v + ratio * s + velocity, *prior, push, sliding, planned]
        for entry in pending[1:]:
            after.extend(entry)
        outputs = {
            "error": e,
            "velocity": v,
            "command": s,
            "acceleration": ratio * s,
            "command_step": s,
            "model_position_step": at + 0.5 * rate + 0.125 * aimed,
            "model_velocity_step": rate + 0.5 * aimed,
            "position_miss": e - at + 0.5 * (v - rate) - 0.125 * known,
            "velocity_miss": v - rate - 0.5 * known,
            "model_position": at + 0.5 * rate + 0.125 * aimed,
            "model_velocity": rate + 0.5 * aimed,
            "estimate": known,
            "innovation": residual,
            "led": at + self.lead / h * rate,
            "sliding": sliding,
        }
        return np.array(after), np.array([outputs[name] for name in OUTPUTS])


ESTIMATOR = "{kind: kalman, acceleration_density: 1.0}"
"""Setting of a scenario file for an estimator with the same gains in all joints."""


OWN, PENDING = 7, 4
"""Entries of the state without pending commands, and further entries for each pending command."""


def _feedback(law: SampledData) -> tuple[float, float, float]:
    """Return kp [1/s²], kd [1/s] and the lead c [s] of a law."""
    if isinstance(law.step, AbstractSurfaceStep):
        assert law.horizon is not None
        period, horizon = float(law.period), float(law.horizon)
        lead, share = horizon - 0.5 * period, linear_share(law.step, horizon)
        return (1.0 - share) / horizon**2, (1.0 - share) * lead / horizon**2 + 1.0 / horizon, lead
    if isinstance(law.step, CalmStep):
        raise DefinitionError("a bound along a motion does not cover calm steps: leave `scheme.sampled_data.calm` out")
    explicit = law.step.law if isinstance(law.step, ExplicitStep) else None
    if not isinstance(explicit, ComputedTorque):
        kind = type(law.step if explicit is None else explicit).__name__
        raise DefinitionError(
            "a bound along a motion needs computed torque or a sliding-mode law with a plan over a horizon; got "
            f"`{kind}`: set `scheme.name: computed_torque`"
        )
    kp, kd = (
        equal_gain(f"scheme.{name}", gain, f"set `scheme.{name}` to one number")
        for name, gain in zip(("kp", "kd"), explicit.gains(), strict=True)
    )
    return kp, kd, 0.0


def linear_share(step: AbstractSurfaceStep, horizon: float) -> float:
    """Return θ0, the share of a small led error that is left at the end of the law's plan; 0 with an envelope.

    A plan without an envelope leads from the led error y to ψ(ε), near y = 0 to `θ0 y` with `θ0 = 1/(1 + H φ'(0))`, the
    mean over the joints. φ is the surface's function of the transformed error ε, and H the `horizon` [s].
    """
    if not isinstance(step.transformation, Unconstrained):
        return 0.0
    slope = np.asarray(step.surface.phi_and_slope(jnp.zeros(step.robot.joints))[1], float)
    return float(np.mean(1.0 / (1.0 + horizon * slope)))


def equal_gain(name: str, values: object, remedy: str) -> float:
    """Return the value of a gain that is the same in all joints.

    - `name`, `remedy`: the gain's name and the setting to change, for the message.

    Raises DefinitionError if the values differ.
    """
    each = np.asarray(values, float).reshape(-1)
    if np.ptp(each) > 0.0:
        raise DefinitionError(f"a bound along a motion needs the same `{name}` for all joints; got {each}: {remedy}")
    return float(each[0])


@dataclass(frozen=True)
class PeriodMaps:
    """One period of the loop as linear maps of the state x, measurement error n, disturbance w and goal g.

    `x⁺ = step x + enters (n, κ ∫(1-τ) w, κ ∫w) + goal g` with the time τ from 0 to 1 in the period, and
    `y = outputs x + direct n + goal_direct g` with the outputs y in the order of `OUTPUTS`. The effect of w on y in the
    same period is left out (`DIRECT` in loop_kernels.py). The state x is that of the module's docstring. κ is the
    nominal inertia over the true inertia. g belongs to the command that is decided in the period.
    """

    step: Floats
    enters: Floats
    goal: Floats
    outputs: Floats
    direct: Floats
    goal_direct: Floats


def _unit_inputs(size: int) -> list[tuple[Floats, float, float, float, float]]:
    nothing = np.zeros(size)
    states = [(row, 0.0, 0.0, 0.0, 0.0) for row in np.eye(size)]
    noise, pulse, velocity, goal = ((nothing, *map(float, row)) for row in np.eye(4))
    return [*states, noise, pulse, velocity, goal]  # type: ignore[list-item]
