"""What is known of a run without knowing the true arm: its log, and what its law believes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import butter, sosfiltfilt

from slidax._errors import DefinitionError
from slidax.controllers import SampledData
from slidax.robots import AbstractRobot
from slidax.scenarios import Scenario
from slidax.simulation import Run

from .along import along
from .linear_loop import LinearLoop
from .measured import as_measured
from .seen import Seen, as_seen, late

BEFORE = 0.3
"""How long before a run left its envelope its reason is looked for [s]."""

SLOW = 20.0
"""Below it is what the model lacks, and above it the loop's own motion [rad/s]."""

NARROW = 1.05
"""An envelope has reached its final width where it is at most so many times as wide as at the end."""


@dataclass(frozen=True)
class Record:
    """A run as a robot's own log would have it, and the law's side of its scenario; arrays of N samples, n joints.

    - `scenario`: what was run; of its plant nothing is read here.
    - `law`: its law in sampled-data form.
    - `t`: time [s], [N].
    - `q`: positions as they were measured, at the sample at which they arrived [N n]; `fresh`: whether they did [N].
    - `tau`: torque that was set [N n], N m or N.
    - `q_d`, `dq_d`, `ddq_d`: what the joints should do [N n].
    - `lower`, `upper`: the envelope [N n].
    - `error`: as the law's outcome counts it [N n].
    - `signals`: of the law, by name.
    - `names`, `units`: of the joints.
    """

    scenario: Scenario
    law: SampledData
    t: np.ndarray
    q: np.ndarray
    fresh: np.ndarray
    tau: np.ndarray
    q_d: np.ndarray
    dq_d: np.ndarray
    ddq_d: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    error: np.ndarray
    signals: dict[str, np.ndarray]
    names: tuple[str, ...]
    units: tuple[str, ...]

    @classmethod
    def of(cls, scenario: Scenario, run: Run) -> Record:
        """The record of a simulated run.

        - `scenario`: what was run, in sampled-data form and with an envelope.
        - `run`: its run, with each sample in its log.

        Raises DefinitionError if the log is missing or has not each sample, or the scheme is not of that form.
        """
        law, log = scenario.controller, run.log
        if not isinstance(law, SampledData) or not run.has_envelope:
            raise DefinitionError(
                "only a scheme in sampled-data form with an envelope can be diagnosed: give `scheme.sampled_data` and "
                "`scheme.performance`"
            )
        if log is None or log.envelope is None or len(log.t) < 3 or np.any(np.diff(log.k) != 1):
            raise DefinitionError("a diagnosis needs each sample: set `simulation.log_every=1`")
        true = np.asarray(log.state.q), np.asarray(log.state.dq)
        q, fresh = as_measured(scenario.plant.sensor, *true, scenario.period)
        return cls(
            scenario=scenario,
            law=law,
            t=np.asarray(log.t),
            q=q,
            fresh=fresh,
            tau=np.asarray(log.tau),
            q_d=np.asarray(log.reference.q),
            dq_d=np.asarray(log.reference.dq),
            ddq_d=np.asarray(log.reference.ddq),
            lower=np.asarray(log.envelope.lower),
            upper=np.asarray(log.envelope.upper),
            error=np.asarray(log.e),
            signals={name: np.asarray(values) for name, values in log.signals.items()},
            names=run.joint_names,
            units=run.joint_units,
        )

    @property
    def joints(self) -> int:
        """The number of joints."""
        return self.q.shape[1]

    @property
    def period(self) -> float:
        """h [s]."""
        return float(self.law.period)

    @property
    def nominal(self) -> AbstractRobot:
        """The arm as the law knows it."""
        return self.law.nominal

    @property
    def horizon(self) -> float:
        """H [s]; the period for a law that does not plan."""
        return self.period if self.law.horizon is None else float(self.law.horizon)

    @cached_property
    def outside(self) -> np.ndarray:
        """Whether each joint is outside its envelope at each sample [N n]."""
        return (self.error <= self.lower) | (self.error >= self.upper)

    @cached_property
    def left(self) -> int:
        """The first sample outside; the last one if none is."""
        out = self.outside.any(axis=1)
        return int(np.argmax(out)) if out.any() else len(out) - 1

    @cached_property
    def narrow(self) -> np.ndarray:
        """Whether the envelope has its final width [N]: until then larger errors are allowed for."""
        width = (self.upper - self.lower).min(axis=1)
        return width <= NARROW * width[-1]

    @cached_property
    def torque_limits(self) -> np.ndarray:
        """That the law knows [n], N m or N."""
        return np.broadcast_to(np.asarray(self.law.limits.torque), self.joints)

    @cached_property
    def rate_limits(self) -> np.ndarray:
        """That the law knows [n], N m/s or N/s."""
        return np.broadcast_to(np.asarray(self.law.limits.rate), self.joints)

    @cached_property
    def mass_and_bias(self) -> tuple[np.ndarray, np.ndarray]:
        """The nominal arm's `M0` [N n n] and `C0 q̇ + G0` [N n] where it was."""
        dq = np.gradient(self.q, self.period, axis=0)
        return along(self.nominal, self.q, dq)

    @cached_property
    def lumped(self) -> np.ndarray:
        """`M0 w`, the torque by which the law makes up for what its model does not explain [N n]."""
        return np.einsum("kij,kj->ki", self.mass_and_bias[0], self.signals["push"])

    @cached_property
    def seen(self) -> Seen:
        """Each joint's inertia and delay as the log shows them."""
        return as_seen(self)

    @cached_property
    def loops(self) -> tuple[LinearLoop | None, ...]:
        """Each joint's loop near its goal, with what the law believes; None where its estimator is not linear."""
        sensor = self.scenario.description.sensor
        differenced = sensor.instrument is None and sensor.velocity == "differenced"
        cutoffs = np.broadcast_to(np.asarray(sensor.cutoff, float), self.joints)
        return tuple(
            LinearLoop.of(self.law, joint, float(cutoffs[joint]) if differenced else None)
            for joint in range(self.joints)
        )

    @cached_property
    def before(self) -> slice:
        """The samples just before it left."""
        return slice(max(0, self.left - round(BEFORE / self.period)), self.left + 1)

    @cached_property
    def room(self) -> np.ndarray:
        """What the envelope allows at its narrowest on its nearer side, ϑ ρ∞ [n], rad or m."""
        return np.min(np.minimum(self.upper, -self.lower), axis=0)

    @cached_property
    def missed(self) -> np.ndarray:
        """w̄ of the loop-rate rule, what the estimate misses [n]: while the envelope is narrow, rad/s² or m/s²."""
        d = float(self.law.delay)
        missed = np.abs(self.signals["residual"][1:]) + d * np.abs(np.diff(self.signals["push"], axis=0))
        narrow = self.narrow[1:]
        worst: np.ndarray = missed[narrow].max(axis=0) if narrow.any() else missed.max(axis=0)
        return worst

    @cached_property
    def unexplained(self) -> np.ndarray:
        """`τ̄ - M0 a - C0 q̇ - G0` below the loop's band [N n], N m or N: what the model lacks, whatever u covers."""
        a = np.zeros_like(self.q)
        a[1:-1] = np.diff(self.q, 2, axis=0) / self.period**2
        mass, bias = self.mass_and_bias
        delay = np.arange(len(self.t)) - float(self.law.delay)
        torque = 0.5 * (late(self.tau, delay) + late(self.tau, delay - 1.0))
        low = butter(2, min(SLOW, 0.5 * np.pi / self.period), fs=2.0 * np.pi / self.period, output="sos")
        rest: np.ndarray = sosfiltfilt(low, torque - np.einsum("kij,kj->ki", mass, a) - bias, axis=0)
        return rest

    def named(self, joint: int) -> str:
        """A joint for a sentence.

        - `joint`: its number, from 0.
        """
        own = f"joint {joint + 1}"
        return own if self.names[joint] == own else f"{own} (`{self.names[joint]}`)"

    def torque_unit(self, joint: int) -> str:
        """Of a joint's torque.

        - `joint`: its number, from 0.
        """
        return "N m" if self.units[joint] == "rad" else "N"
