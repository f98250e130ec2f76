"""Causes in the control loop: inertia, delay, estimator, encoders, sampling period, integration steps."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.law.kalman import Kalman, StrongTracking
from slidax.scenarios.scenario import Scenario

from .cause import AbstractCause, Finding, Remedy
from .log_estimate import LogEstimate, believed_inertia, encoder_resolution, estimate_from_log
from .run_record import RunRecord

GAIN = 0.08
"""Least share of the unexplained torque that a delay other than the law's must explain."""

APART = 0.9
"""Least difference of a delay from the believed one, in periods: friction looks like a delay of 0.75 periods."""


class DelayCause(AbstractCause):
    """The torque acts on the measured motion later than the law assumes."""

    name: ClassVar[str] = "delay"

    def finding(self, record: RunRecord) -> Finding | None:
        estimate, believed = estimate_from_log(record), float(record.law.believed_delay)
        if not estimate.delay_gain > GAIN or estimate.delay - believed < APART:
            return None
        loops = [loop for loop in record.loops if loop is not None]
        radius = max((loop.radius(1.0, estimate.delay) for loop in loops), default=1.0)
        nominal_radius = max((loop.radius() for loop in loops), default=0.0)
        evidence = (
            f"the delay from torque to measurement is {estimate.delay:g} periods, but the law assumes {believed:g}; "
            f"the loop's spectral radius is then {radius:.3f} instead of {nominal_radius:.3f}"
        )
        return Finding(
            name=self.name,
            joint=None,
            weight=0.96 if radius >= 0.995 else 0.5,
            evidence=evidence,
            numbers={"seen": estimate.delay, "believed": believed, "radius": radius},
            remedies=[
                Remedy("set the law's delay to the estimated one", {"scheme.sampled_data.delay": delay})
                for delay in dict.fromkeys((float(np.ceil(estimate.delay)), float(np.floor(estimate.delay))))
            ],
        )


COARSE = 0.25
"""Largest encoder step as a share of the envelope's half width: a velocity estimate needs many steps."""


class EncoderCause(AbstractCause):
    """A joint's encoder is too coarse.

    Its step is a large share of the envelope, or the torque steps that its rounding alone causes exceed the rate limit.
    """

    name: ClassVar[str] = "encoder"

    def finding(self, record: RunRecord) -> Finding | None:
        steps = encoder_resolution(record.q)
        ratio, noise = steps / record.half_width, torque_step_noise(record)
        joint = int(np.argmax(np.maximum(ratio / COARSE, noise)))
        if ratio[joint] < COARSE and noise[joint] < 1.0:
            return None
        unit = record.units[joint]
        evidence = (
            f"{record.named(joint)}: its encoder has steps of {steps[joint]:.2g} {unit}, {ratio[joint]:.2g} of the "
            f"{record.half_width[joint]:.2g} {unit} that the envelope allows; their rounding alone causes torque "
            f"steps of {noise[joint]:.2g} times the rate limit"
        )
        numbers = {"resolution": float(steps[joint]), "ratio": float(ratio[joint]), "noise": float(noise[joint])}
        weight = 0.98 if ratio[joint] >= COARSE else min(0.4 + 0.1 * float(noise[joint]), 0.75)
        return Finding(self.name, joint, weight, evidence, numbers, _encoder_remedies(record, float(np.max(steps))))


def torque_step_noise(record: RunRecord) -> np.ndarray:
    """Three standard deviations of the torque steps due to encoder rounding, relative to the rate limit [n].

    They are 0 for a joint whose nominal loop is unstable: its noise has no bound, and `EstimatorCause` finds it.
    """
    mass = np.einsum("kii->ki", record.mass_and_bias[0]).mean(axis=0)
    steps, noise = encoder_resolution(record.q), np.zeros(record.joints)
    for joint, loop in enumerate(record.loops):
        if loop is not None and steps[joint] > 0 and np.isfinite(record.rate_limits[joint]):
            step = loop.noise(steps[joint] ** 2 / 12.0)[1] * mass[joint]
            noise[joint] = 3.0 * step / (record.rate_limits[joint] * record.period)
    return np.where(np.isfinite(noise), noise, 0.0)


def _encoder_remedies(record: RunRecord, step: float) -> list[Remedy]:
    scheme: Any = record.scenario.description.scheme
    final = np.asarray(scheme.transformation.performance.final)
    side = record.half_width / np.broadcast_to(final, record.joints)
    remedies = []
    for times in (4.0, 8.0):
        wider = np.maximum(final, times * step / np.min(side))
        value = [float(f"{radius:.2g}") for radius in np.atleast_1d(wider)]
        path = "scheme.transformation.performance.final"
        remedies.append(Remedy("a final radius that the encoders resolve", {path: value if final.ndim else value[0]}))
    for part in (0.1, 0.01):
        finer = float(f"{part * step:.2g}")
        remedies.append(Remedy(f"encoders with steps of {finer:g}", {"sensor.resolution": finer}))
    return remedies


SLOW, FAST = 0.25, 4.0
"""Useful range of ω H, an estimator's bandwidth ω times the horizon H; the built-in scenarios have 0.6 to 3."""

NOISY = 0.5
"""Share of the torque rate limit above which noise makes an estimator too fast."""

ESTIMATOR, HORIZON = "scheme.sampled_data.estimator", "scheme.sampled_data.horizon"


class EstimatorCause(AbstractCause):
    """The nominal loop is unstable, or the estimator's bandwidth times the horizon is far from 1."""

    name: ClassVar[str] = "estimator"

    def finding(self, record: RunRecord) -> Finding | None:
        kind = type(record.law.estimator).__name__
        loops = [loop for loop in record.loops if loop is not None]
        if not loops:
            return self._nonlinear_estimator(record, kind)
        radius = [loop.radius() for loop in loops]
        joint = int(np.argmax(radius))
        if radius[joint] >= 1.0:
            evidence = (
                f"{record.named(joint)}: even with the nominal inertia and delay, the loop with the estimator "
                f"`{kind}` is unstable (spectral radius {radius[joint]:.3f})"
            )
            numbers = {"radius": radius[joint]}
            return Finding(self.name, joint, 0.97, evidence, numbers, _estimator_remedies(record))
        pace = [loop.bandwidth * record.horizon for loop in loops]
        slowest, fastest = int(np.argmin(pace)), int(np.argmax(pace))
        if pace[slowest] < SLOW and isinstance(record.law.estimator, Kalman | StrongTracking):
            bandwidth = loops[slowest].bandwidth
            evidence = (
                f"{record.named(slowest)}: the estimator's bandwidth is {bandwidth:.3g} rad/s, {pace[slowest]:.2g}/H "
                "with the horizon H"
            )
            numbers = {"bandwidth": bandwidth, "pace": pace[slowest]}
            return Finding(self.name, slowest, 0.75, evidence, numbers, _estimator_remedies(record))
        if pace[fastest] > FAST:
            noise = torque_step_noise(record)
            if noise[fastest] < NOISY:
                return None
            bandwidth = loops[fastest].bandwidth
            evidence = (
                f"{record.named(fastest)}: the estimator's bandwidth is {bandwidth:.3g} rad/s, {pace[fastest]:.2g}/H "
                f"with the horizon H, and encoder rounding alone causes torque steps of {noise[fastest]:.2g} times the "
                "rate limit"
            )
            numbers = {"bandwidth": bandwidth, "pace": pace[fastest], "noise": float(noise[fastest])}
            return Finding(self.name, fastest, 0.92, evidence, numbers, _estimator_remedies(record))
        return None

    def _nonlinear_estimator(self, record: RunRecord, kind: str) -> Finding | None:
        if record.law.horizon is None:
            return None
        evidence = f"the estimator `{kind}` is nonlinear, so the stability of its loop cannot be checked"
        return Finding(self.name, None, 0.45, evidence, {}, _estimator_remedies(record))


def _estimator_remedies(record: RunRecord) -> list[Remedy]:
    """Return remedies: torque densities for a bandwidth near 1/H, and the default Kalman filter.

    H is the horizon; the bandwidth is proportional to the sixth root of the density.
    """
    block: Any = record.scenario.description.scheme.sampled_data
    remedies = []
    density = getattr(block.estimator, "torque_density", None)
    if isinstance(density, float):
        pace = [loop.bandwidth * record.horizon for loop in record.loops if loop is not None]
        for target in (1.0, 0.6, 1.6):
            value = float(f"{density * (target / np.exp(np.mean(np.log(pace)))) ** 6:.3g}")
            remedies.append(
                Remedy("an estimator as fast as the horizon allows", {f"{ESTIMATOR}.torque_density": value})
            )
    remedies.append(Remedy("the Kalman filter with its usual density", {ESTIMATOR: {"kind": "kalman"}}))
    return remedies


SURE = 0.85
"""Least share of a joint's torque in the band of `log_estimate.py` that its inertia must explain."""

ADAPTATION = "adaptation"
"""Optional field of `sampled_data` for learning the arm's inertia."""

EDGE = 0.995
"""Spectral radius from which a loop counts as unstable: at 1 kHz an error then takes 0.14 s to halve."""


class InertiaCause(AbstractCause):
    """The loop is unstable, or nearly so, for the inertia that the log shows."""

    name: ClassVar[str] = "inertia"

    def finding(self, record: RunRecord) -> Finding | None:
        estimate = estimate_from_log(record)
        believed = believed_inertia(record, estimate)
        kappa = np.divide(believed, estimate.inertia, where=estimate.inertia > 0, out=np.full_like(believed, np.nan))
        known = np.isfinite(kappa) & (estimate.coherence > SURE)
        radius = np.array(
            [
                loop.radius(kappa[joint]) if known[joint] and loop is not None else 0.0
                for joint, loop in enumerate(record.loops)
            ]
        )
        if not radius.size or radius.max() < EDGE:
            return None
        beyond = np.where(radius >= EDGE, np.abs(np.log(np.where(known, kappa, 1.0))), 0.0)
        joint = int(np.argmax(beyond))
        loop = record.loops[joint]
        assert loop is not None
        factor = float(1.0 / kappa[joint])
        unit = "kg m²" if record.units[joint] == "rad" else "kg"
        own = believed[joint] - estimate.nominal[joint]
        learnt = "" if record.law.adaptation is None else f", {own:.2g} of it learnt"
        least, most = loop.stable_range()
        known_range = not np.isnan(least)
        stable_for = (
            f"stable for {1.0 / most:.2g} to {1.0 / least:.2g} times the inertia"
            if known_range
            else "unstable even for the inertia in the model"
        )
        evidence = (
            f"{record.named(joint)}: the arm has {factor:.2g} times the inertia in the law's model (estimated "
            f"{estimate.inertia[joint]:.3g}, modelled {believed[joint]:.3g} {unit}{learnt}); its loop is {stable_for}"
        )
        return Finding(
            name=self.name,
            joint=joint,
            weight=0.95 if radius[joint] >= 1.0 else 0.7,
            evidence=evidence,
            numbers={
                "seen": float(estimate.inertia[joint]),
                "believed": float(believed[joint]),
                "nominal": float(estimate.nominal[joint]),
                "kappa": float(kappa[joint]),
                **({"stable_from": least, "stable_to": most} if known_range else {}),
            },
            remedies=[*_adaptation_remedies(record), *_model_remedies(record, estimate, known)],
        )


def _adaptation_remedies(record: RunRecord) -> list[Remedy]:
    """Return a remedy that enables the adaptation, for a law that can learn the inertia but has `adaptation: null`."""
    block = record.scenario.description.scheme.sampled_data
    field = {} if block is None else type(block).model_fields
    if ADAPTATION not in field or getattr(block, ADAPTATION) is not None:
        return []
    default = field[ADAPTATION].get_default(call_default_factory=True)
    value: Any = {} if default is None else {"kind": default.kind}
    return [
        Remedy("let the law learn the inertia: remove `adaptation: null`", {f"scheme.sampled_data.{ADAPTATION}": value})
    ]


def _model_remedies(record: RunRecord, estimate: LogEstimate, known: np.ndarray) -> list[Remedy]:
    """Return a remedy that sets the nominal arm's inertia to the estimate; empty without such a field."""
    robot = record.scenario.description.robot
    nominal: Any = getattr(robot, "nominal", None)
    fields = {} if nominal is None else type(nominal).model_fields
    if "armature" in fields:
        believed = np.broadcast_to(np.asarray(record.nominal.armature), record.joints)  # type: ignore[attr-defined]
        change = np.where(known, estimate.inertia - estimate.nominal, 0.0)
        armature = [float(f"{value:.3g}") for value in np.maximum(believed + np.nan_to_num(change), 0.0)]
        words = "set the nominal inertia to the estimate, or run `slidax identify`"
        return [Remedy(words, {"robot.nominal.armature": armature})]
    if {"masses", "inertias"} <= fields.keys():
        factor = float(np.exp(np.mean(np.log(1.0 / estimate.kappa[known]))))
        changes = {}
        for name in ("masses", "inertias"):
            values = np.asarray(getattr(record.nominal, name)) * factor
            changes[f"robot.nominal.{name}"] = [float(f"{value:.4g}") for value in np.atleast_1d(values)]
        return [Remedy(f"set the nominal inertia to {factor:.3g} times its value", changes)]
    return []


class PeriodCause(AbstractCause):
    """The loop rate is too low for the envelope: `(H + D h)² w̄ < ϑ ρ∞` does not hold (docs/loop-rate.md).

    H is the horizon, D the delay in periods, h the period, w̄ the largest error of the disturbance estimate, and ϑ ρ∞
    the final half width of the envelope.
    """

    name: ClassVar[str] = "period"

    def finding(self, record: RunRecord) -> Finding | None:
        age = record.horizon + float(record.law.believed_delay) * record.period
        deviation = age**2 * record.missed
        ratio = deviation / record.half_width
        joint = int(np.argmax(ratio))
        if ratio[joint] < 1.0:
            return None
        unit = record.units[joint]
        evidence = (
            f"{record.named(joint)}: at a period of {1e3 * record.period:g} ms the estimated disturbance is off by "
            f"up to {record.missed[joint]:.3g} {unit}/s², which over horizon and delay moves the error by "
            f"{deviation[joint]:.2g} {unit}, but the envelope allows {record.half_width[joint]:.2g} {unit}"
        )
        # A slow loop is a cause of its own; in a fast loop the rule fails because of another cause.
        alone = np.clip(np.log10(record.period / 1e-3), 0.0, 1.0)
        return Finding(
            name=self.name,
            joint=joint,
            weight=0.4 + 0.3 * float(alone),
            evidence=evidence,
            numbers={
                "ratio": float(ratio[joint]),
                "missed": float(record.missed[joint]),
                "horizon": record.horizon,
                "period": record.period,
            },
            remedies=[*_same_rate(record), *(_shorter(record, factor) for factor in (2, 4, 8))],
        )


def _same_rate(record: RunRecord) -> list[Remedy]:
    """Return remedies that keep the sampling rate: other horizons, and the default Kalman filter."""
    own, h = record.law.horizon, record.period
    horizons = (3.0 * h, 7.0 * h) if own is None else tuple(factor * float(own) for factor in (0.7, 0.5, 1.5))
    remedies = [
        Remedy(f"a horizon of {1e3 * horizon:.3g} ms at the same rate", {HORIZON: float(f"{horizon:.3g}")})
        for horizon in horizons
        if horizon > 1.5 * h
    ]
    usual = Remedy("the Kalman filter with its usual density", {ESTIMATOR: {"kind": "kalman"}})
    return remedies if isinstance(record.law.estimator, Kalman | StrongTracking) else [*remedies, usual]


def _shorter(record: RunRecord, factor: int) -> Remedy:
    simulation = record.scenario.description.simulation
    block = record.scenario.description.scheme.sampled_data
    changes: dict[str, float | int] = {
        "simulation.period": float(f"{simulation.period / factor:.6g}"),
        "simulation.substeps": max(1, simulation.substeps // factor),
    }
    if block is not None and block.horizon is not None:
        changes[HORIZON] = float(f"{block.horizon / factor:.6g}")
    return Remedy(f"a period of {1e3 * simulation.period / factor:g} ms, and a horizon in proportion", changes)


STABLE = {"rk4": 2.78, "semi_implicit_euler": 2.0}
"""Stability limit of each integrator: the largest product of step and decay rate."""


class SubstepsCause(AbstractCause):
    """The integrator's step is too long for the simulated friction.

    Near rest, friction is `(f_c/v_s + f_v) q̇` with the Coulomb friction f_c, its velocity scale v_s and the viscous
    coefficient f_v. So the velocity decays with the rate `(f_c/v_s + f_v)` over the inertia, and the step must be short
    relative to the inverse of this rate. The cause is in the simulation, not in the law, so this check uses the plant.
    """

    name: ClassVar[str] = "substeps"

    def finding(self, record: RunRecord) -> Finding | None:
        ratio_and_joint = step_ratio(record.scenario)
        if ratio_and_joint is None or ratio_and_joint[0] <= 1.0:
            return None
        ratio, joint = ratio_and_joint
        simulation = record.scenario.description.simulation
        more = int(np.ceil(2.0 * ratio)) * simulation.substeps
        step = 1e3 * simulation.period / simulation.substeps
        evidence = (
            f"{record.named(joint)}: the integrator's step of {step:.3g} ms is {ratio:.2g} times the longest stable "
            "step for the simulated friction near rest"
        )
        return Finding(
            name=self.name,
            joint=joint,
            weight=0.96,
            evidence=evidence,
            numbers={"ratio": ratio, "substeps": float(simulation.substeps)},
            remedies=[Remedy("integrate in smaller steps", {"simulation.substeps": min(more, 10_000)})],
        )


def step_ratio(scenario: Scenario) -> tuple[float, int] | None:
    """Return the integrator's step over the longest stable step for the plant's friction, and the joint that limits it.

    The inertia is that at the initial position. None if MuJoCo simulates the arm, or the arm is not `Articulated`.
    """
    simulation, robot = scenario.description.simulation, scenario.plant.robot
    if simulation.plant != "own" or not isinstance(robot, Articulated):
        return None
    slope = np.asarray(robot.coulomb) / float(robot.smoothing) + np.asarray(robot.viscous)
    inverse = np.linalg.inv(np.asarray(robot.mass(scenario.state0.q)))
    rates, modes = np.linalg.eig(inverse @ np.diag(slope))
    fastest = int(np.argmax(np.abs(rates)))
    step = simulation.period / simulation.substeps
    ratio = float(np.abs(rates[fastest])) * step / STABLE[simulation.integrator]
    return ratio, int(np.argmax(np.abs(modes[:, fastest])))
