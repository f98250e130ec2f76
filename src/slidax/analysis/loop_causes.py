"""Causes in the control loop: inertia, delay, estimator, encoders, sampling period, integration steps."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from slidax.arms.articulated import Articulated
from slidax.law.kalman import Kalman
from slidax.scenarios.scenario import Scenario

from .cause import AbstractCause, Finding, Remedy
from .log_estimate import LogEstimate, believed_inertia, encoder_resolution, estimate_from_log
from .run_record import RunRecord

GAIN = 0.08
"""The share of the unexplained torque that another delay must explain, to be believed."""

APART = 0.9
"""Periods by which a delay must be off, to be named: friction looks like three quarters of one."""


class DelayCause(AbstractCause):
    """The torque shows in the measured motion later than the law predicts."""

    name: ClassVar[str] = "delay"

    def finding(self, record: RunRecord) -> Finding | None:
        estimate, believed = estimate_from_log(record), float(record.law.delay)
        if not estimate.delay_gain > GAIN or estimate.delay - believed < APART:
            return None
        loops = [loop for loop in record.loops if loop is not None]
        radius = max((loop.radius(1.0, estimate.delay) for loop in loops), default=1.0)
        as_told = max((loop.radius() for loop in loops), default=0.0)
        evidence = (
            f"a torque shows in what is measured {estimate.delay:g} periods after it is decided, and the law is told "
            f"{believed:g}; its loop then has the modulus {radius:.3f}, in place of {as_told:.3f}"
        )
        return Finding(
            name=self.name,
            joint=None,
            weight=0.96 if radius >= 0.995 else 0.5,
            evidence=evidence,
            numbers={"seen": estimate.delay, "believed": believed, "radius": radius},
            remedies=[
                Remedy("tell the law the delay", {"scheme.sampled_data.delay": delay})
                for delay in dict.fromkeys((float(np.ceil(estimate.delay)), float(np.floor(estimate.delay))))
            ],
        )


COARSE = 0.25
"""Of the room in the envelope that one step of the encoders may be: a velocity is found from many of them."""


class EncoderCause(AbstractCause):
    """A step of the encoders is a good part of the envelope's room, or their noise alone needs the drives' rate."""

    name: ClassVar[str] = "encoder"

    def finding(self, record: RunRecord) -> Finding | None:
        steps = encoder_resolution(record.q)
        ratio, noise = steps / record.room, torque_step_noise(record)
        joint = int(np.argmax(np.maximum(ratio / COARSE, noise)))
        if ratio[joint] < COARSE and noise[joint] < 1.0:
            return None
        unit = record.units[joint]
        evidence = (
            f"{record.named(joint)}: its encoder has steps of {steps[joint]:.2g} {unit}, {ratio[joint]:.2g} of the "
            f"{record.room[joint]:.2g} {unit} that the envelope allows; their rounding alone asks for torque "
            "steps of "
            f"{noise[joint]:.2g} times the rate limit"
        )
        numbers = {"resolution": float(steps[joint]), "ratio": float(ratio[joint]), "noise": float(noise[joint])}
        weight = 0.98 if ratio[joint] >= COARSE else min(0.4 + 0.1 * float(noise[joint]), 0.75)
        return Finding(self.name, joint, weight, evidence, numbers, _encoder_remedies(record, float(np.max(steps))))


def torque_step_noise(record: RunRecord) -> np.ndarray:
    """Three standard deviations of the torque's steps from the encoders' rounding, over the rate limit [n]."""
    mass = np.einsum("kii->ki", record.mass_and_bias[0]).mean(axis=0)
    steps, noise = encoder_resolution(record.q), np.zeros(record.joints)
    for joint, loop in enumerate(record.loops):
        if loop is not None and steps[joint] > 0 and np.isfinite(record.rate_limits[joint]):
            step = loop.noise(steps[joint] ** 2 / 12.0)[1] * mass[joint]
            noise[joint] = 3.0 * step / (record.rate_limits[joint] * record.period)
    return noise


def _encoder_remedies(record: RunRecord, step: float) -> list[Remedy]:
    scheme: Any = record.scenario.description.scheme
    final = np.asarray(scheme.transformation.performance.final)
    side = record.room / np.broadcast_to(final, record.joints)
    remedies = []
    for times in (4.0, 8.0):
        wider = np.maximum(final, times * step / np.min(side))
        value = [float(f"{radius:.2g}") for radius in np.atleast_1d(wider)]
        path = "scheme.transformation.performance.final"
        remedies.append(Remedy("a final radius that they can resolve", {path: value if final.ndim else value[0]}))
    for part in (0.1, 0.01):
        finer = float(f"{part * step:.2g}")
        remedies.append(Remedy(f"encoders with steps of {finer:g}", {"sensor.resolution": finer}))
    return remedies


SLOW, FAST = 0.25, 4.0
"""ω H of an estimator that is slower or faster than a loop with that horizon can use; the built-in scenarios have .6 to
3."""

NOISY = 0.5
"""Of the torque's rate limit that noise may ask for, before a fast estimator is too fast."""

ESTIMATOR = "scheme.sampled_data.estimator"


class EstimatorCause(AbstractCause):
    """With the believed inertia and delay the loop is unstable; or ω H of its estimator is far from 1."""

    name: ClassVar[str] = "estimator"

    def finding(self, record: RunRecord) -> Finding | None:
        kind = type(record.law.estimator).__name__
        loops = [loop for loop in record.loops if loop is not None]
        if not loops:
            return self._not_known(record, kind)
        radius = [loop.radius() for loop in loops]
        joint = int(np.argmax(radius))
        if radius[joint] >= 1.0:
            evidence = (
                f"{record.named(joint)}: with exactly the believed inertia and delay, the loop with the "
                f"estimator `{kind}` "
                f"is unstable (modulus {radius[joint]:.3f} a period)"
            )
            numbers = {"radius": radius[joint]}
            return Finding(self.name, joint, 0.97, evidence, numbers, _estimator_remedies(record))
        pace = [loop.bandwidth * record.horizon for loop in loops]
        slowest, fastest = int(np.argmin(pace)), int(np.argmax(pace))
        if pace[slowest] < SLOW and isinstance(record.law.estimator, Kalman):
            bandwidth = loops[slowest].bandwidth
            evidence = (
                f"{record.named(slowest)}: the estimator follows at {bandwidth:.3g} rad/s, {pace[slowest]:.2g} of 1/H"
            )
            numbers = {"bandwidth": bandwidth, "pace": pace[slowest]}
            return Finding(self.name, slowest, 0.75, evidence, numbers, _estimator_remedies(record))
        if pace[fastest] > FAST:
            noise = torque_step_noise(record)
            if noise[fastest] < NOISY:
                return None
            bandwidth = loops[fastest].bandwidth
            evidence = (
                f"{record.named(fastest)}: the estimator follows at {bandwidth:.3g} rad/s, "
                f"{pace[fastest]:.2g} times 1/H, "
                f"so that the encoders' rounding alone asks for torque steps of {noise[fastest]:.2g} times "
                "the rate limit"
            )
            numbers = {"bandwidth": bandwidth, "pace": pace[fastest], "noise": float(noise[fastest])}
            return Finding(self.name, fastest, 0.92, evidence, numbers, _estimator_remedies(record))
        return None

    def _not_known(self, record: RunRecord, kind: str) -> Finding | None:
        if record.law.horizon is None:
            return None
        evidence = f"the estimator `{kind}` is not linear, so that its loop cannot be told to be stable"
        return Finding(self.name, None, 0.45, evidence, {}, _estimator_remedies(record))


def _estimator_remedies(record: RunRecord) -> list[Remedy]:
    """Another density, so that ω H is near 1, as ω goes with its sixth root; and the filter as it is by default."""
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
"""The share of a joint's torque in the band that its inertia must explain."""

ADAPTATION = "adaptation"
"""The field of `sampled_data` that says whether and how the law learns its arm's inertia, where there is one."""

EDGE = 0.995
"""The largest modulus of a loop that is as good as unstable: it takes .2 s at 1 kHz to forget half of an error."""


class InertiaCause(AbstractCause):
    """The loop with the inertia that is seen is unstable, or nearly so, and with the believed one it is not."""

    name: ClassVar[str] = "inertia"

    def finding(self, record: RunRecord) -> Finding | None:
        estimate = estimate_from_log(record)
        believed = believed_inertia(record, estimate)
        kappa = np.divide(believed, estimate.inertia, where=estimate.inertia > 0, out=np.full_like(believed, np.nan))
        told = np.isfinite(kappa) & (estimate.coherence > SURE)
        radius = np.array(
            [
                loop.radius(kappa[joint]) if told[joint] and loop is not None else 0.0
                for joint, loop in enumerate(record.loops)
            ]
        )
        if not radius.size or radius.max() < EDGE:
            return None
        beyond = np.where(radius >= EDGE, np.abs(np.log(np.where(told, kappa, 1.0))), 0.0)
        joint = int(np.argmax(beyond))
        loop = record.loops[joint]
        assert loop is not None
        factor = float(1.0 / kappa[joint])
        unit = "kg m²" if record.units[joint] == "rad" else "kg"
        own = believed[joint] - estimate.nominal[joint]
        learnt = "" if record.law.adaptation is None else f", {own:.2g} of it learnt"
        compared = f"is {factor:.2g} times as heavy as" if factor > 1 else f"has {factor:.2g} of the inertia that"
        least, most = loop.stable_range()
        evidence = (
            f"{record.named(joint)}: the arm {compared} the law believes (seen {estimate.inertia[joint]:.3g}, believed "
            f"{believed[joint]:.3g} {unit}{learnt}); its loop bears {1.0 / most:.2g} to {1.0 / least:.2g} times"
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
                "stable_from": least,
                "stable_to": most,
            },
            remedies=[*_learnt(record), *_told(record, estimate, told)],
        )


def _learnt(record: RunRecord) -> list[Remedy]:
    """Where a law can learn the inertia and its file says null: let it. Here, and nowhere else, is this said."""
    block = record.scenario.description.scheme.sampled_data
    field = {} if block is None else type(block).model_fields
    if ADAPTATION not in field or getattr(block, ADAPTATION) is not None:
        return []
    default = field[ADAPTATION].get_default(call_default_factory=True)
    value: Any = {} if default is None else {"kind": default.kind}
    return [Remedy("let it be learnt: remove `adaptation: null`", {f"scheme.sampled_data.{ADAPTATION}": value})]


def _told(record: RunRecord, estimate: LogEstimate, told: np.ndarray) -> list[Remedy]:
    """The inertia that was seen, as numbers of the nominal arm."""
    robot = record.scenario.description.robot
    nominal: Any = getattr(robot, "nominal", None)
    fields = {} if nominal is None else type(nominal).model_fields
    if "armature" in fields:
        known = np.broadcast_to(np.asarray(record.nominal.armature), record.joints)  # type: ignore[attr-defined]
        change = np.where(told, estimate.inertia - estimate.nominal, 0.0)
        armature = [float(f"{value:.3g}") for value in np.maximum(known + np.nan_to_num(change), 0.0)]
        words = "tell the law what was seen, or find it by `slidax identify`"
        return [Remedy(words, {"robot.nominal.armature": armature})]
    if {"masses", "inertias"} <= fields.keys():
        factor = float(np.exp(np.mean(np.log(1.0 / estimate.kappa[told]))))
        changes = {}
        for name in ("masses", "inertias"):
            values = np.asarray(getattr(record.nominal, name)) * factor
            changes[f"robot.nominal.{name}"] = [float(f"{value:.4g}") for value in np.atleast_1d(values)]
        return [Remedy(f"tell the law {factor:.3g} times the inertia", changes)]
    return []


class PeriodCause(AbstractCause):
    """`(H + D h)² w̄ < ϑ ρ∞` does not hold (docs/loop-rate.md)."""

    name: ClassVar[str] = "period"

    def finding(self, record: RunRecord) -> Finding | None:
        age = record.horizon + float(record.law.delay) * record.period
        reached = age**2 * record.missed
        ratio = reached / record.room
        joint = int(np.argmax(ratio))
        if ratio[joint] < 1.0:
            return None
        unit = record.units[joint]
        evidence = (
            f"{record.named(joint)}: at a period of {1e3 * record.period:g} ms the estimate misses up to "
            f"{record.missed[joint]:.3g} {unit}/s², which moves the error by (H + D h)² w = "
            f"{reached[joint]:.2g} {unit} far, "
            f"and the envelope allows {record.room[joint]:.2g} {unit}"
        )
        # A slow loop is the reason by itself; in a fast one, the rule fails since something else does.
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
            remedies=[_shorter(record, factor) for factor in (2, 4, 8)],
        )


def _shorter(record: RunRecord, factor: int) -> Remedy:
    simulation = record.scenario.description.simulation
    block = record.scenario.description.scheme.sampled_data
    changes: dict[str, float | int] = {
        "simulation.period": float(f"{simulation.period / factor:.6g}"),
        "simulation.substeps": max(1, simulation.substeps // factor),
    }
    if block is not None and block.horizon is not None:
        changes["scheme.sampled_data.horizon"] = float(f"{block.horizon / factor:.6g}")
    return Remedy(f"a period of {1e3 * simulation.period / factor:g} ms, and a horizon that goes with it", changes)


STABLE = {"rk4": 2.78, "semi_implicit_euler": 2.0}
"""The largest step times rate at which friction still decays in an integrator."""


class SubstepsCause(AbstractCause):
    """Friction changes faster than a step of the integrator can follow.

    Near rest friction is `(f_c/v_s + f_v) q̇`, which decays at that slope over the inertia. This is about the simulation
    and not about the law, so that the plant is looked at.
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
            f"{record.named(joint)}: a step of {step:.3g} ms is {ratio:.2g} times as long as the integrator "
            "needs to follow "
            "the simulated friction near rest"
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
    """Step length over the longest stable one for the plant's friction, and the joint with the largest ratio."""
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
