"""The record of a run for its diagnosis: measured signals, envelope, and the law's model along the motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from slidax.law.adaptation import with_rotors
from slidax.law.joint_loop import LinearLoop
from slidax.law.sampled.controller import SampledData
from slidax.plant.sensors import AbstractSensor
from slidax.scenarios.scenario import Scenario
from slidax.simulation.run import Run, columns_of

Signal = NDArray[np.floating[Any]]

InertiaAndBias = Callable[[Signal, Signal], tuple[Signal, Signal]]
"""Function from positions and velocities [samples n] to `M(q)` [samples n n] and `C(q, q̇) q̇ + G(q)` [samples n].

All are in the units of the robot.
"""


def inertia_and_bias(robot: AbstractRobot, q: Signal, dq: Signal) -> tuple[Signal, Signal]:
    """Return `M(q)` [samples n n] and `C(q, q̇) q̇ + G(q)` [samples n] of an arm.

    - `q`, `dq`: positions and velocities [samples n].
    """
    return compiled_inertia_and_bias(robot)(q, dq)


def compiled_inertia_and_bias(robot: AbstractRobot) -> InertiaAndBias:
    """Return `inertia_and_bias` of an arm as a compiled function of (q, dq), for use on several motions."""

    def at(q: Any, dq: Any) -> Any:
        return robot.mass(q), robot.bias(q, dq)

    if llvm.available():
        with suppress(NoNativeCodeError):
            joint = jax.ShapeDtypeStruct((robot.joints,), float)
            program = trace(at, joint, joint, named=False)
            program.inputs[:] = [replace(variable, varying=True) for variable in program.inputs]
            kernel = llvm.compile(program)

            def native(q: Signal, dq: Signal) -> tuple[Signal, Signal]:
                mass, bias = kernel.batch([q, dq], runs=len(q), threads=1)
                return mass, bias

            return native
    batched = jax.jit(jax.vmap(at))

    def by_xla(q: Signal, dq: Signal) -> tuple[Signal, Signal]:
        mass, bias = batched(jnp.asarray(q), jnp.asarray(dq))
        return np.asarray(mass), np.asarray(bias)

    return by_xla


def low_pass(signal: Signal, cutoff: float, period: float) -> Signal:
    """Return a signal after a zero-phase low-pass filter, with a cut-off of at most half the Nyquist frequency.

    - `signal`: sampled values [samples ...].
    - `cutoff`: cut-off frequency [rad/s].
    - `period`: sampling period [s].
    """
    return _filtered(signal, min(cutoff, 0.5 * np.pi / period), "lowpass", period)


def band_pass(signal: Signal, band: tuple[float, float], period: float) -> Signal:
    """Return a signal after a zero-phase band-pass filter, limited to the frequencies that the samples resolve.

    - `signal`: sampled values [samples ...].
    - `band`: lower and upper frequency [rad/s].
    - `period`: sampling period [s].
    """
    return _filtered(signal, resolvable_band(band, period), "bandpass", period)


def resolvable_band(band: tuple[float, float], period: float) -> tuple[float, float]:
    """Return lower and upper frequency of the part of a band that the samples resolve well [rad/s].

    - `band`: lower and upper frequency [rad/s].
    - `period`: sampling period [s].
    """
    high = min(band[1], 0.5 * np.pi / period)
    return min(band[0], 0.2 * high), high


def held_torque(tau: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return the mean of the held torque over a period, for periods that begin at any times [m n].

    Between two samples it is a linear interpolation of the two torques.

    - `tau`: torque that is held from each sample on [samples n].
    - `times`: times at which the m periods begin, in periods after sample 0 [m].
    """
    integer = np.floor(times).astype(int)
    fraction = (times - integer)[:, None]
    return (1.0 - fraction) * tau[np.maximum(integer, 0)] + fraction * tau[np.clip(integer + 1, 0, len(tau) - 1)]


def _filtered(signal: Signal, edges: float | tuple[float, float], kind: str, period: float) -> Signal:
    # Imported here, since `slidax run` imports this module but filters only after a failure.
    from scipy.signal import butter, sosfiltfilt

    sections = butter(2, edges, kind, fs=2.0 * np.pi / period, output="sos")
    # A run that ends at once has fewer samples than SciPy would add at its ends.
    padding = min(3 * (2 * len(sections) + 1), len(signal) - 1)
    return sosfiltfilt(sections, signal, axis=0, padlen=padding)


def joint_loops(scenario: Scenario) -> tuple[LinearLoop | None, ...]:
    """Return each joint's closed loop, linearised at zero error; None for each joint if this is not possible.

    This is possible for a law that plans over a horizon, with a linear estimator or `StrongTracking`. The latter is a
    Kalman filter whose bandwidth grows with its innovations; the result is for its least bandwidth.

    - `scenario`: a scenario with a law in sampled-data form.
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
    """Return the measured positions at each sample [samples n], and True for samples that arrived [samples].

    A simulated log has the true state, but the law received the measurement. The sensor's seed reproduces the noise of
    the run.

    - `sensor`: the run's sensor; None for an ideal sensor.
    - `q`, `dq`: true positions and velocities [samples n], from sample 0 on.
    - `period`: sampling period [s].
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
"""Length of the window in which causes are searched, until the run leaves its envelope [s]."""

SLOW = 20.0
"""Cut-off frequency [rad/s]: the model error is below, the loop's own motion above."""

NARROW = 1.05
"""An envelope counts as narrow when its width is at most this multiple of its final width."""


EACH = "a diagnosis needs every sample in the log: set `simulation.log_every=1`"


def require_explainable(scenario: Scenario) -> SampledData:
    """Return the law of a scenario, or raise DefinitionError if its runs cannot be diagnosed by `explain`.

    - `scenario`: the scenario to check.

    Raises DefinitionError if its scheme is not in sampled-data form or has no envelope, its encoders are at the motors
    of elastic joints, or its actuator has a map from commands to joint torques.
    """
    law, start = scenario.controller, scenario.state0
    transmission = getattr(scenario.plant, "transmission", None)
    elasticity = None if transmission is None else transmission.elasticity
    if elasticity is not None and elasticity.encoder == "motor":
        raise DefinitionError(
            "a diagnosis needs the measured positions: the encoders are at the motors, but a simulated log has the "
            "positions of the links; set `transmission.elasticity.encoder: link`"
        )
    if scenario.description.actuator.map or scenario.description.actuator.true_map:
        raise DefinitionError(
            "a diagnosis takes commands as joint torques: leave `actuator.map` and `actuator.true_map` out"
        )
    if isinstance(law, SampledData):

        def envelope(t: Scalar) -> Envelope | None:
            return law.envelope(t, law.init(t, start, scenario.trajectory.reference(t)))

        # Checks the structure only; nothing is computed.
        if eqx.filter_eval_shape(envelope, jax.ShapeDtypeStruct((), float)) is not None:
            return law
    raise DefinitionError(
        "only a scheme in sampled-data form with an envelope can be diagnosed: give `scheme.sampled_data`, and a "
        "scheme with `performance`"
    )


@dataclass(frozen=True)
class RunRecord:
    """Signals of a run that a real robot's log would also have, and the law; n is the number of joints.

    - `scenario`: the scenario of the run; the diagnosis does not read its true plant.
    - `law`: the law in sampled-data form.
    - `t`: time [s], [samples].
    - `q`: measured positions at the sample of their arrival [samples n].
    - `fresh`: True if a measurement arrived [samples].
    - `tau`: applied torque [samples n], N m or N.
    - `q_d`, `dq_d`, `ddq_d`: reference positions, velocities and accelerations [samples n].
    - `lower`, `upper`: the envelope [samples n].
    - `error`: the position error, which the envelope bounds [samples n].
    - `signals`: signals of the law by name: `disturbance`, the estimated disturbance as an acceleration, `residual`,
      the acceleration that the last prediction missed, and, if the law has them, `u`, the robust torque, and `rotor`,
      the learnt rotor inertias.
    - `names`, `units`: names and position units of the joints.
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
        """Return the record of a simulated run.

        - `scenario`: the scenario of the run, in sampled-data form and with an envelope.
        - `run`: the run, with every sample in its log.

        Raises DefinitionError if the log is missing or lacks samples, and as `require_explainable` does.
        """
        if run.log is None:
            raise DefinitionError(EACH)
        numbered = [f"_{joint + 1}" for joint in range(run.joints)]
        return cls.of_columns(scenario, {name: values for name, (values, _) in columns_of(run, numbered).items()})

    @classmethod
    def of_columns(cls, scenario: Scenario, columns: Mapping[str, np.ndarray]) -> RunRecord:
        """Return the record of a saved log.

        - `scenario`: as in `of`.
        - `columns`: arrays over the samples by column name, as `slidax run --out` writes them: `t`, `q_1`, `tau_1`,
          `lower_1` and others, with the number of the joint.

        Raises DefinitionError as `of` does, and if a column is missing.
        """
        law = require_explainable(scenario)
        n = law.joints

        def per_joint(name: str) -> np.ndarray:
            parts = [columns.get(f"{name}_{joint + 1}") for joint in range(n)]
            if any(column is None for column in parts):
                raise DefinitionError(f"the log has no columns `{name}_1` to `{name}_{n}`: use the log's own scenario")
            return np.stack([np.asarray(column, float) for column in parts], axis=1)

        t = np.asarray(columns.get("t", ()), float)
        if np.any(np.abs(np.diff(t) / scenario.period - 1.0) > 0.01):
            raise DefinitionError(EACH)
        if len(t) < 3:
            raise DefinitionError(
                f"a diagnosis needs three samples or more; the log has {len(t)}: make `simulation.t1` longer"
            )
        signals = {name: per_joint(name) for name in ("disturbance", "residual")}
        if "u" in columns:
            signals["u"] = np.asarray(columns["u"], float)
        if law.adaptation is not None:
            signals["rotor"] = per_joint("rotor")
        true = per_joint("q"), per_joint("dq")
        q, fresh = measured_positions(scenario.plant.sensor, *true, scenario.period)
        return cls(
            scenario=scenario,
            law=law,
            t=t,
            q=q,
            fresh=fresh,
            tau=per_joint("tau"),
            q_d=per_joint("q_d"),
            dq_d=per_joint("dq_d"),
            ddq_d=per_joint("ddq_d"),
            lower=per_joint("lower"),
            upper=per_joint("upper"),
            error=per_joint("e"),
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
        """The nominal arm, which the law uses as its model."""
        return self.law.nominal

    @property
    def horizon(self) -> float:
        """Horizon H over which the law plans [s]; the period for a law without a plan."""
        return self.period if self.law.horizon is None else float(self.law.horizon)

    @cached_property
    def outside(self) -> np.ndarray:
        """True where a joint is at or outside its envelope's bounds [samples n]."""
        return (self.error <= self.lower) | (self.error >= self.upper)

    @property
    def kept(self) -> bool:
        """True if the run stayed inside its envelope until its end."""
        complete = len(self.t) == round(self.scenario.t1 / self.period) + 1
        return complete and not self.outside.any()

    @cached_property
    def left(self) -> int:
        """Index of the first sample outside the envelope; index of the last sample if all are inside."""
        out: np.ndarray = self.outside.any(axis=1)
        first = int(np.argmax(out)) if out.any() else len(out) - 1
        return first

    @cached_property
    def narrow(self) -> np.ndarray:
        """True where the envelope has its final width, up to the factor `NARROW` [samples]."""
        width = (self.upper - self.lower).min(axis=1)
        return width <= NARROW * width[-1]

    @cached_property
    def torque_limits(self) -> np.ndarray:
        """Torque limits of the law [n], N m or N."""
        return np.broadcast_to(np.asarray(self.law.limits.torque), self.joints)

    @cached_property
    def rate_limits(self) -> np.ndarray:
        """Torque rate limits of the law [n], N m/s or N/s."""
        return np.broadcast_to(np.asarray(self.law.limits.rate), self.joints)

    @cached_property
    def mass_and_bias(self) -> tuple[np.ndarray, np.ndarray]:
        """The nominal arm's `M0` [samples n n] and `C0 q̇ + G0` [samples n] along the measured motion."""
        dq = np.gradient(self.q, self.period, axis=0)
        return inertia_and_bias(self.nominal, self.q, dq)

    @cached_property
    def lumped(self) -> np.ndarray:
        """Torque `M0 w` that compensates the law's estimated disturbance w [samples n], N m or N.

        w is an acceleration. For a law that learns, M0 has the learnt rotor inertias.
        """
        mass = self.mass_and_bias[0]
        if self.law.adaptation is not None:
            mass = np.asarray(
                jax.vmap(with_rotors, (0, 0, None))(mass, self.signals["rotor"], self.law.adaptation.counted)
            )
        return np.einsum("kij,kj->ki", mass, self.signals["disturbance"])

    @cached_property
    def loops(self) -> tuple[LinearLoop | None, ...]:
        """Each joint's closed loop by the law's model, as `joint_loops` returns it."""
        return joint_loops(self.scenario)

    @cached_property
    def before(self) -> slice:
        """The samples just before the run left its envelope."""
        return slice(max(0, self.left - round(BEFORE / self.period)), self.left + 1)

    @cached_property
    def half_width(self) -> np.ndarray:
        """Least width of the envelope's narrower side over the run [n], rad or m; `ϑ ρ∞` in docs/loop-rate.md."""
        return np.min(np.minimum(self.upper, -self.lower), axis=0)

    @cached_property
    def missed(self) -> np.ndarray:
        """Largest error of the disturbance estimate while the envelope is narrow [n], rad/s² or m/s².

        It is w̄ of docs/loop-rate.md: the largest |r| + D |Δw|, with the signals r = `residual` and w = `disturbance`,
        the change Δw of w in a period, and the delay of D periods.
        """
        d = float(self.law.believed_delay)
        missed = np.abs(self.signals["residual"][1:]) + d * np.abs(np.diff(self.signals["disturbance"], axis=0))
        narrow = self.narrow[1:]
        return missed[narrow].max(axis=0) if narrow.any() else missed.max(axis=0)

    @cached_property
    def unexplained(self) -> np.ndarray:
        """Torque that the nominal arm does not explain, `τ̄ - M0 a - C0 q̇ - G0` [samples n], N m or N.

        τ̄ is the mean torque over two periods, a the measured acceleration. A low-pass filter removes the loop's own
        motion.
        """
        a = np.zeros_like(self.q)
        a[1:-1] = np.diff(self.q, 2, axis=0) / self.period**2
        mass, bias = self.mass_and_bias
        delay = np.arange(len(self.t)) - float(self.law.believed_delay)
        torque = 0.5 * (held_torque(self.tau, delay) + held_torque(self.tau, delay - 1.0))
        return low_pass(torque - np.einsum("kij,kj->ki", mass, a) - bias, SLOW, self.period)

    def named(self, joint: int) -> str:
        """Return a joint's number and name for messages."""
        own = f"joint {joint + 1}"
        return own if self.names[joint] == own else f"{own} (`{self.names[joint]}`)"

    def torque_unit(self, joint: int) -> str:
        """Unit of a joint's torque."""
        return self.nominal.torque_units[joint]
