"""The record of a run for its diagnosis: measured signals, envelope, and the law's model along the motion."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.arms.arm import AbstractRobot
from slidax.codegen import llvm
from slidax.codegen.ir import NoNativeCodeError
from slidax.codegen.trace.tracing import trace
from slidax.core.errors import DefinitionError
from slidax.core.types import Envelope, Scalar, State
from slidax.law.joint_loop import LinearLoop
from slidax.law.sampled.controller import SampledData
from slidax.plant.sensors import AbstractSensor
from slidax.scenarios.scenario import Scenario
from slidax.simulation.run import Run, columns_of


def inertia_and_bias(robot: AbstractRobot, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`M(q)` [N n n] and `C(q, q̇) q̇ + G(q)` [N n] at each of N samples, in the units of the robot.

    - `robot`: whose.
    - `q`, `dq`: positions and velocities [N n].
    """

    def at(q: Any, dq: Any) -> Any:
        return robot.mass(q), robot.bias(q, dq)

    if llvm.available():
        with suppress(NoNativeCodeError):
            joint = jax.ShapeDtypeStruct((robot.joints,), float)
            program = trace(at, joint, joint, named=False)
            program.inputs[:] = [replace(variable, varying=True) for variable in program.inputs]
            mass, bias = llvm.compile(program).batch([q, dq], runs=len(q), threads=1)
            return mass, bias
    mass, bias = jax.jit(jax.vmap(at))(jnp.asarray(q), jnp.asarray(dq))
    return np.asarray(mass), np.asarray(bias)


Signal = NDArray[np.floating[Any]]


def low_pass(signal: Signal, cutoff: float, period: float) -> Signal:
    """Zero-phase low-pass filter, with a cut-off of at most half of the Nyquist frequency.

    - `signal`: samples [N ...].
    - `cutoff`: the frequency [rad/s].
    - `period`: between two samples [s].
    """
    return _filtered(signal, min(cutoff, 0.5 * np.pi / period), "lowpass", period)


def band_pass(signal: Signal, band: tuple[float, float], period: float) -> Signal:
    """Zero-phase band-pass filter, limited to the frequencies that the samples resolve.

    - `signal`: samples [N ...].
    - `band`: the frequencies [rad/s].
    - `period`: between two samples [s].
    """
    return _filtered(signal, resolvable_band(band, period), "bandpass", period)


def resolvable_band(band: tuple[float, float], period: float) -> tuple[float, float]:
    """The part of a band that samples can show well [rad/s].

    - `band`: its two frequencies [rad/s].
    - `period`: between two samples [s].
    """
    high = min(band[1], 0.5 * np.pi / period)
    return min(band[0], 0.2 * high), high


def held_torque(tau: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Torque at some times, held constant over each period, interpolated between two periods at a fractional time.

    - `tau`: torques [N n].
    - `times`: in periods [m].
    """
    integer = np.floor(times).astype(int)
    fraction = (times - integer)[:, None]
    return (1.0 - fraction) * tau[np.maximum(integer, 0)] + fraction * tau[np.clip(integer + 1, 0, len(tau) - 1)]


def _filtered(signal: Signal, edges: float | tuple[float, float], kind: str, period: float) -> Signal:
    # Here, since `slidax run` imports this room and only a run that failed is filtered.
    from scipy.signal import butter, sosfiltfilt

    sections = butter(2, edges, kind, fs=2.0 * np.pi / period, output="sos")
    return sosfiltfilt(sections, signal, axis=0)


def joint_loops(scenario: Scenario) -> tuple[LinearLoop | None, ...]:
    """Each joint's loop near its goal; None where its estimator is not linear.

    - `scenario`: with a law in sampled-data form.
    """
    law, sensor = scenario.controller, scenario.description.sensor
    assert isinstance(law, SampledData)
    differenced = sensor.instrument is None and sensor.velocity == "differenced"
    cutoffs = np.broadcast_to(np.asarray(sensor.cutoff, float), law.joints)
    return tuple(
        LinearLoop.of(law, joint, float(cutoffs[joint]) if differenced else None) for joint in range(law.joints)
    )


def measured_positions(
    sensor: AbstractSensor | None, q: np.ndarray, dq: np.ndarray, period: float
) -> tuple[np.ndarray, np.ndarray]:
    """The positions that a sensor gives at each sample [N n], and whether they arrived [N].

    A simulated log has the true state; the law had this. The same seed gives the same noise as in the run.

    - `sensor`: the run's; None for a perfect one.
    - `q`, `dq`: true positions and velocities [N n], from sample 0 on.
    - `period`: h [s].
    """
    if sensor is None:
        return q, np.ones(len(q), bool)

    def measure(memory: Any, sample: Any) -> Any:
        k, q, dq = sample
        measured, memory = sensor(k, State(q=q, dq=dq), jnp.asarray(period), memory)
        return memory, (measured.state.q, measured.fresh)

    @jax.jit
    def all_of(q: Any, dq: Any) -> Any:
        first = sensor.init(State(q=q[0], dq=dq[0]))
        return jax.lax.scan(measure, first, (jnp.arange(len(q)), q, dq))[1]

    positions, fresh = all_of(jnp.asarray(q), jnp.asarray(dq))
    return np.asarray(positions), np.asarray(fresh)


BEFORE = 0.3
"""Window before the run left its envelope in which causes are searched [s]."""

SLOW = 20.0
"""Below it is what the model lacks, and above it the loop's own motion [rad/s]."""

NARROW = 1.05
"""An envelope has reached its final width where it is at most so many times as wide as at the end."""


EACH = "a diagnosis needs each sample of the log: set `simulation.log_every=1`"


def require_explainable(scenario: Scenario) -> SampledData:
    """The law of a scenario that can be diagnosed.

    - `scenario`: any.

    Raises DefinitionError if its scheme is not in sampled-data form, or has no envelope.
    """
    law, start = scenario.controller, scenario.state0
    if isinstance(law, SampledData):

        def envelope(t: Scalar) -> Envelope | None:
            return law.envelope(t, law.init(t, start, scenario.trajectory.reference(t)))

        # Only whether there is one: nothing is computed.
        if eqx.filter_eval_shape(envelope, jax.ShapeDtypeStruct((), float)) is not None:
            return law
    raise DefinitionError(
        "only a scheme in sampled-data form with an envelope can be diagnosed: give `scheme.sampled_data`, "
        "and a scheme "
        "with `performance`"
    )


@dataclass(frozen=True)
class RunRecord:
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
    def of(cls, scenario: Scenario, run: Run) -> RunRecord:
        """The record of a simulated run.

        - `scenario`: what was run, in sampled-data form and with an envelope.
        - `run`: its run, with each sample in its log.

        Raises DefinitionError if the log is missing or has not each sample, or the scheme is not of that form.
        """
        if run.log is None:
            raise DefinitionError(EACH)
        numbered = [f"_{joint + 1}" for joint in range(run.joints)]
        return cls.of_columns(scenario, {name: values for name, (values, _) in columns_of(run, numbered).items()})

    @classmethod
    def of_columns(cls, scenario: Scenario, columns: Mapping[str, np.ndarray]) -> RunRecord:
        """The record of a log as flat columns: `t`, `q_1`, ..., `tau_1`, the bounds, and the signals by name.

        - `scenario`, as above.
        - `columns`: as `slidax run --out` writes them.

        Raises DefinitionError as above, and if a column is missing.
        """
        law = require_explainable(scenario)
        n = law.joints

        def wide(name: str) -> np.ndarray:
            parts = [columns.get(f"{name}_{joint + 1}") for joint in range(n)]
            if any(column is None for column in parts):
                raise DefinitionError(f"the log has no columns `{name}_1` to `{name}_{n}`: is it of this scenario?")
            return np.stack([np.asarray(column, float) for column in parts], axis=1)

        t = np.asarray(columns.get("t", ()), float)
        if len(t) < 3 or np.any(np.abs(np.diff(t) / scenario.period - 1.0) > 0.01):
            raise DefinitionError(EACH)
        signals = {name: wide(name) for name in ("disturbance", "residual")}
        if "u" in columns:
            signals["u"] = np.asarray(columns["u"], float)
        if law.adaptation is not None:
            signals["rotor"] = wide("rotor")
        true = wide("q"), wide("dq")
        q, fresh = measured_positions(scenario.plant.sensor, *true, scenario.period)
        return cls(
            scenario=scenario,
            law=law,
            t=t,
            q=q,
            fresh=fresh,
            tau=wide("tau"),
            q_d=wide("q_d"),
            dq_d=wide("dq_d"),
            ddq_d=wide("ddq_d"),
            lower=wide("lower"),
            upper=wide("upper"),
            error=wide("e"),
            signals=signals,
            names=law.nominal.joint_names,
            units=law.nominal.joint_units,
        )

    @property
    def joints(self) -> int:
        """The number of joints."""
        return len(self.names)

    @property
    def period(self) -> float:
        """The period h [s]."""
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
        """True where a joint is outside its envelope [N n]."""
        return (self.error <= self.lower) | (self.error >= self.upper)

    @property
    def kept(self) -> bool:
        """True if the run reached its end inside its envelope."""
        complete = len(self.t) == round(self.scenario.t1 / self.period) + 1
        return complete and not self.outside.any()

    @cached_property
    def left(self) -> int:
        """The first sample outside; the last one if none is."""
        out: np.ndarray = self.outside.any(axis=1)
        first = int(np.argmax(out)) if out.any() else len(out) - 1
        return first

    @cached_property
    def narrow(self) -> np.ndarray:
        """True where the envelope has its final width [N]."""
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
        return inertia_and_bias(self.nominal, self.q, dq)

    @cached_property
    def lumped(self) -> np.ndarray:
        """`M0 w`, the torque by which the law makes up for what its model does not explain [N n]."""
        return np.einsum("kij,kj->ki", self.mass_and_bias[0], self.signals["disturbance"])

    @cached_property
    def loops(self) -> tuple[LinearLoop | None, ...]:
        """Each joint's loop near its goal, with what the law believes; None where its estimator is not linear."""
        return joint_loops(self.scenario)

    @cached_property
    def before(self) -> slice:
        """The samples just before it left."""
        return slice(max(0, self.left - round(BEFORE / self.period)), self.left + 1)

    @cached_property
    def room(self) -> np.ndarray:
        """The envelope's distance from zero at its narrowest, on the nearer side, ϑ ρ∞ [n], rad or m."""
        return np.min(np.minimum(self.upper, -self.lower), axis=0)

    @cached_property
    def missed(self) -> np.ndarray:
        """w̄ of the loop-rate rule, what the estimate misses [n]: while the envelope is narrow, rad/s² or m/s²."""
        d = float(self.law.delay)
        missed = np.abs(self.signals["residual"][1:]) + d * np.abs(np.diff(self.signals["disturbance"], axis=0))
        narrow = self.narrow[1:]
        return missed[narrow].max(axis=0) if narrow.any() else missed.max(axis=0)

    @cached_property
    def unexplained(self) -> np.ndarray:
        """`τ̄ - M0 a - C0 q̇ - G0` below the loop's band [N n], N m or N: what the model lacks, whatever u covers."""
        a = np.zeros_like(self.q)
        a[1:-1] = np.diff(self.q, 2, axis=0) / self.period**2
        mass, bias = self.mass_and_bias
        delay = np.arange(len(self.t)) - float(self.law.delay)
        torque = 0.5 * (held_torque(self.tau, delay) + held_torque(self.tau, delay - 1.0))
        return low_pass(torque - np.einsum("kij,kj->ki", mass, a) - bias, SLOW, self.period)

    def named(self, joint: int) -> str:
        """A joint for a sentence."""
        own = f"joint {joint + 1}"
        return own if self.names[joint] == own else f"{own} (`{self.names[joint]}`)"

    def torque_unit(self, joint: int) -> str:
        """Unit of a joint's torque."""
        return self.nominal.torque_units[joint]
