"""Causes in the torques: drive limits, robust torque, payload, contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.arms.arm import Payload as Carried
from slidax.arms.articulated import Articulated
from slidax.core.errors import as_array, percent

from .cause import AbstractCause, Finding, Remedy, data_sheet_limit, slower_motion
from .run_record import SLOW, RunRecord, Signal, compiled_inertia_and_bias, inertia_and_bias, low_pass

REACHED = 0.999
"""A torque of at least this share of its limit counts as saturated."""

TORQUE_SPARE = 1.15
"""Smallest proposed torque limit, as a multiple of the torque that the motion needs: feedback needs the rest."""


class TorqueCause(AbstractCause):
    """A joint's torque is at its limit when the run leaves its envelope."""

    name: ClassVar[str] = "torque"

    def finding(self, record: RunRecord) -> Finding | None:
        share = np.mean(np.abs(record.tau[record.before]) >= REACHED * record.torque_limits, axis=0)
        joint = int(np.argmax(share))
        if share[joint] < 0.1:
            return None
        needed, limit, unit = needed_torque(record), record.torque_limits, record.torque_unit(joint)
        evidence = (
            f"{record.named(joint)}: its torque is at its limit of {limit[joint]:.4g} {unit} in "
            f"{percent(share[joint])} of the samples just before the run left its envelope; the motion needs up to "
            f"{needed[joint]:.3g} {unit}"
        )
        weak = needed > limit
        return Finding(
            name=self.name,
            joint=joint,
            weight=(0.5 if weak[joint] else 0.3) + 0.35 * float(share[joint]),
            evidence=evidence,
            numbers={"share": float(share[joint]), "limit": float(limit[joint]), "needed": float(needed[joint])},
            remedies=_torque_remedies(record, needed),
        )


def needed_torque(record: RunRecord) -> np.ndarray:
    """Largest torque along the motion [n], N m or N: the nominal arm's, plus the unexplained torque in the log."""
    mass, bias = inertia_and_bias(record.nominal, record.q_d, record.dq_d)
    wanted = np.einsum("kij,kj->ki", mass, record.ddq_d) + bias
    unexplained = np.median(record.unexplained[record.before], axis=0)
    return np.max(np.abs(wanted + unexplained), axis=0)


def _torque_remedies(record: RunRecord, needed: np.ndarray) -> list[Remedy]:
    limits, sheet = record.torque_limits, data_sheet_limit(record, "torque")
    remedies = []
    if np.any(sheet > limits):
        words = "allow the torque of the arm's data sheet"
        remedies.append(Remedy(words, {"actuator.torque": sheet.tolist()}))
    remedies += slower_motion(record)
    for factor in (TORQUE_SPARE, 1.5, 2.0):
        enough = [float(f"{value:.3g}") for value in np.maximum(limits, factor * needed)]
        remedies.append(Remedy("use drives with the torque that the motion needs", {"actuator.torque": enough}))
    return remedies


class TorqueRateCause(AbstractCause):
    """A joint's torque rate is at its limit when the run leaves its envelope."""

    name: ClassVar[str] = "torque_rate"

    def finding(self, record: RunRecord) -> Finding | None:
        limits = record.rate_limits
        steps = np.abs(np.diff(record.tau[record.before], axis=0))
        share = np.mean(steps >= REACHED * limits * record.period, axis=0) if len(steps) else np.zeros(record.joints)
        joint = int(np.argmax(share))
        if share[joint] < 0.3:
            return None
        unit = f"{record.torque_unit(joint)}/s"
        evidence = (
            f"{record.named(joint)}: its torque rate is at its limit of {limits[joint]:.4g} {unit} in "
            f"{percent(share[joint])} of the samples just before the run left its envelope"
        )
        return Finding(
            name=self.name,
            joint=joint,
            weight=0.4 + 0.45 * float(share[joint]),
            evidence=evidence,
            numbers={"share": float(share[joint]), "limit": float(limits[joint])},
            remedies=_rate_remedies(record),
        )


def _rate_remedies(record: RunRecord) -> list[Remedy]:
    limits, sheet = record.rate_limits, data_sheet_limit(record, "torque_rate")
    remedies = []
    if np.any(sheet > limits):
        words = "allow the torque rate of the arm's data sheet"
        remedies.append(Remedy(words, {"actuator.rate": np.maximum(sheet, limits).tolist()}))
    remedies += slower_motion(record)
    for factor in (3.0, 10.0, 30.0):
        words = f"use drives with {factor:g} times the torque rate"
        remedies.append(Remedy(words, {"actuator.rate": (factor * limits).tolist()}))
    return remedies


COVER_SPARE = 1.5
"""Least proposed robust torque u, as a multiple of the largest unexplained torque."""


class RobustTorqueCause(AbstractCause):
    """The robust torque u limits the law's compensation when the run leaves its envelope.

    The compensation is `M0 w` for the estimated disturbance w, with `‖M0 w‖ <= u`.
    """

    name: ClassVar[str] = "robust_torque"

    def finding(self, record: RunRecord) -> Finding | None:
        if "u" not in record.signals or record.signals["u"].ndim != 1:
            return None
        u = record.signals["u"][record.before]
        share = float(np.mean(np.linalg.norm(record.lumped[record.before], axis=1) >= 0.99 * u))
        if share < 0.3:
            return None
        lacks = float(np.percentile(np.linalg.norm(record.unexplained[: record.left + 1], axis=1), 99))
        covers = float(np.median(u))
        # The estimate of a loop that oscillates reaches u as well, and a larger u would not help it.
        if lacks <= covers:
            return None
        evidence = (
            f"the robust torque u limits the compensation in {percent(share)} of the samples just before the run left "
            f"its envelope: the model error is up to {lacks:.3g} N m, but u covers {covers:.3g} N m"
        )
        return Finding(
            name=self.name,
            joint=None,
            weight=0.4 + 0.4 * share,
            evidence=evidence,
            numbers={"share": share, "u": covers, "needed": lacks},
            remedies=_cover_remedies(record, covers, lacks),
        )


def _cover_remedies(record: RunRecord, covers: float, lacks: float) -> list[Remedy]:
    bound: Any = getattr(record.scenario.description.scheme, "bound", None)
    # A value missing in the file was computed for the arm, and is in the law.
    bound_of_law: Any = getattr(record.law.step, "bound", None)
    remedies = []
    for factor in (1.0, 2.0, 4.0):
        more = factor * max(COVER_SPARE * lacks - covers, 0.5 * covers)
        for name in ("margin", "size"):
            if hasattr(bound, name):
                now = getattr(bound, name)
                value = float(f"{float(getattr(bound_of_law, name) if now is None else now) + more:.3g}")
                remedies.append(Remedy("raise u to cover the model error", {f"scheme.bound.{name}": value}))
    return remedies


OFFSETS = (0.0, 0.2)
"""Two positions of a trial mass of 1 kg along the tip's axis [m]; the payload's centre is between or near them."""

SURE = 4.0
"""Least ratio of an estimated mass to its standard error."""

AROUND = (0.2, 2.0)
"""Time after leaving the envelope that a fit includes [s]: for a payload from the start, and for one picked up."""

LEAST = 0.2
"""Smallest payload to report [kg]."""

HALF = 0.5
"""Share of the largest payload from which on a payload is likely too heavy, although the drives can carry it."""


@dataclass(frozen=True)
class PayloadEstimate:
    """Estimated payload in addition to the one in the law's model.

    - `mass`: its mass [kg].
    - `spread`: standard error of the mass [kg].
    - `explained`: share that the payload explains of the torque which the law's model, friction and a factor on the
      arm's mass leave unexplained.
    - `most`: largest mass with which the drives can follow the reference [kg].
    - `height`: position of its centre on the z axis of the tip [m].
    """

    mass: float
    spread: float
    explained: float
    most: float
    height: float


class PayloadCause(AbstractCause):
    """The unexplained torque is that of a payload."""

    name: ClassVar[str] = "payload"

    def finding(self, record: RunRecord) -> Finding | None:
        if not isinstance(record.nominal, Articulated) or not np.any(np.isfinite(record.torque_limits)):
            return None
        estimate = estimate_payload(record, record.nominal)
        if estimate.mass < max(SURE * estimate.spread, LEAST) or estimate.explained < 0.3:
            return None
        # Includes the samples after leaving: before, u or the rate limit may have held the torque back.
        share = np.mean(np.abs(record.tau[record.before.start :]) >= REACHED * record.torque_limits, axis=0)
        joint = int(np.argmax(share))
        unit = record.torque_unit(joint)
        evidence = (
            f"the tip carries about {estimate.mass:.2g} kg more than in the law's model "
            f"(± {2.0 * estimate.spread:.1g} kg)"
        )
        if estimate.most < estimate.mass:
            evidence += (
                f"; the torque limits allow {max(estimate.most, 0.0):.2g} kg for this motion, and "
                f"{record.named(joint)} is at its limit of {record.torque_limits[joint]:.4g} {unit} in "
                f"{percent(share[joint])} of the samples just before and after the run left its envelope"
            )
        return Finding(
            name=self.name,
            joint=joint,
            weight=self._weight(record, estimate),
            evidence=evidence,
            numbers={
                "mass": estimate.mass,
                "spread": estimate.spread,
                "most": estimate.most,
                "share": float(share[joint]),
            },
            remedies=_payload_remedies(record, estimate),
        )

    def _weight(self, record: RunRecord, estimate: PayloadEstimate) -> float:
        """Return the weight, 0.62 to 0.93: it rises as the payload nears the largest one that the drives can carry.

        With torque limits below the data sheet's it is at most 0.7. At a low weight, u may be the cause instead.
        """
        if np.any(record.torque_limits < data_sheet_limit(record, "torque")):
            return 0.7 if estimate.most < estimate.mass else 0.62
        return 0.62 + 0.62 * float(np.clip(estimate.mass / max(estimate.most, LEAST) - HALF, 0.0, HALF))


Torque = Callable[[Signal, Signal, Signal], Signal]
"""Function from q, q̇ and q̈ [samples n] to the torque of an arm [samples n]."""


def estimate_payload(record: RunRecord, nominal: Articulated) -> PayloadEstimate:
    """Estimate a payload from the unexplained torque by least squares, with friction and a factor on the arm's mass.

    The first fit uses the samples until shortly after the run left its envelope. The second uses those around and after
    that time, when the arm may have picked the payload up. Return the fit in which the payload explains more.
    """
    short, long = (round(seconds / record.period) for seconds in AROUND)
    until = slice(0, min(len(record.t), max(record.left + short, long // 2)))
    after = slice(max(record.left - short // 4, 0), min(len(record.t), record.left + long))
    own, *loaded = (_compiled_torque(arm) for arm in (nominal, *(_with_mass(nominal, x) for x in OFFSETS)))
    fits = [_fit_payload(record, own, loaded, part) for part in (until, after) if part.stop - part.start > short]
    return max(fits, key=lambda fit: fit.explained)


def _fit_payload(record: RunRecord, unloaded: Torque, loaded: list[Torque], part: slice) -> PayloadEstimate:
    h = record.period
    q = low_pass(record.q, SLOW, h)[part]
    dq = np.gradient(q, h, axis=0)
    ddq = np.gradient(dq, h, axis=0)
    own = unloaded(q, dq, ddq)
    torques = [torque(q, dq, ddq) - own for torque in loaded]
    n, scale = record.joints, np.where(np.isfinite(record.torque_limits), record.torque_limits, 1.0)
    friction = [np.where(np.arange(n) == joint, shape, 0.0) for shape in (np.tanh(dq / 0.02), dq) for joint in range(n)]
    lacks = (record.unexplained[part] / scale).ravel()
    columns = np.stack([(column / scale).ravel() for column in (*torques, own, *friction)], axis=1)
    solved = np.linalg.lstsq(columns, lacks, rcond=1e-8)[0]
    without = np.linalg.lstsq(columns[:, 2:], lacks, rcond=1e-8)[0]
    rest = float(np.sum((lacks - columns @ solved) ** 2))
    more = float(np.sum((lacks - columns[:, 2:] @ without) ** 2))
    mass = float(solved[0] + solved[1])
    # The filtered residual is correlated: only samples at the filter's time constant are independent.
    independent = max(len(q) * h * SLOW / np.pi * n, len(solved) + 1.0)
    covariance = np.linalg.pinv(columns.T @ columns) * rest / independent
    spread = float(np.sqrt(max(np.sum(covariance[:2, :2]), 0.0)))
    # Position of the payload between the two offsets.
    position = float(np.clip(solved[1] / mass if mass > LEAST else 0.5, 0.0, 1.0))
    wanted = unloaded(record.q_d, record.dq_d, record.ddq_d)
    needed = (1.0 + solved[2]) * wanted
    each = [torque(record.q_d, record.dq_d, record.ddq_d) for torque in loaded]
    per_kg = (1.0 - position) * each[0] + position * each[1] - wanted
    spare = record.torque_limits - np.abs(solved[3 : 3 + n])
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = (spare - np.sign(per_kg) * needed) / np.abs(per_kg)
    most = float(np.nanmin(np.where(np.abs(per_kg) > 1e-9, bounds, np.inf)))
    explained = 1.0 - rest / more if more > 0 else 0.0
    return PayloadEstimate(mass, spread, explained, most, OFFSETS[1] * position)


def _with_mass(nominal: Articulated, offset: float) -> Articulated:
    """Return the arm with an additional mass of 1 kg on the tip's axis, at an offset [m]."""
    more = Carried(mass=as_array(1.0), center=as_array([0.0, 0.0, offset]))
    return eqx.tree_at(lambda robot: robot.payload, nominal, nominal.payload.joined(more))


def _compiled_torque(robot: Articulated) -> Torque:
    inertia_and_bias_at = compiled_inertia_and_bias(robot)

    def torque(q: Signal, dq: Signal, ddq: Signal) -> Signal:
        mass, bias = inertia_and_bias_at(q, dq)
        return np.einsum("kij,kj->ki", mass, ddq) + bias

    return torque


def _payload_remedies(record: RunRecord, estimate: PayloadEstimate) -> list[Remedy]:
    robot: Any = record.scenario.description.robot
    nominal, load = (getattr(getattr(robot, name, None), "load", None) for name in ("nominal", "plant"))
    remedies = []
    if estimate.mass <= estimate.most:
        mass, height = (float(f"{value:.2g}") for value in (estimate.mass, estimate.height))
        changes: dict[str, Any] = {}
        if load is not None and nominal is None:
            # The true arm carries both loads.
            rest = round(load.mass - mass, 3)
            changes = {"robot.plant.load.mass": rest} if rest > 0 else {"robot.plant.load": None}
            changes["robot.nominal.load"] = {"mass": mass, "center": [0.0, 0.0, height]}
        remedies.append(Remedy("describe the payload to the law", changes))
    if estimate.mass > HALF * estimate.most:
        for part in (0.8, 0.65, 0.5, 0.35):
            least = float(f"{part * min(estimate.mass, max(estimate.most, 0.0) / 0.8):.2g}")
            changes = {} if load is None else {"robot.plant.load.mass": least}
            remedies.append(Remedy(f"carry at most {least:g} kg", changes))
    return remedies


SUDDEN = 0.1
"""Time within which a contact changes the torque [s]."""

FITS = 0.85
"""Least share of a sudden torque change that a force at the tip must explain."""

HANGS, GRAVITY = 0.9, 9.81
"""Cosine between a force and gravity above which the force counts as a weight; gravity [m/s²]."""

CARRIED = 0.9
"""Cosine between a force and the tip's deceleration above which the force may be that of a payload's inertia."""

RARE = 4.0
"""Least ratio of a sudden torque change to the usual change."""


class ContactCause(AbstractCause):
    """The unexplained torque changes suddenly, as by `Jᵀ F` of a force F at the tip, with the tip's Jacobian J.

    Only arms with five joints or more are checked: with fewer, a force at the tip could explain most changes.
    """

    name: ClassVar[str] = "contact"

    def finding(self, record: RunRecord) -> Finding | None:
        robot = record.nominal
        span = max(round(SUDDEN / record.period), 1)
        if not isinstance(robot, Articulated) or record.joints < 5 or record.left < 4 * span:
            return None
        lacks = record.unexplained
        change = lacks[span:] - lacks[:-span]
        size = np.linalg.norm(change, axis=1)
        near = slice(max(0, record.left - 4 * span), min(len(size), record.left + span))
        at = near.start + int(np.argmax(size[near]))
        usual = float(np.median(size[: max(near.start, span)]))
        middle = at + span // 2
        q = jnp.asarray(record.q[middle])
        jacobian = np.asarray(jax.jacfwd(robot.tip)(q))
        force, *_ = np.linalg.lstsq(jacobian.T, -change[at], rcond=None)
        left = np.linalg.norm(change[at] + jacobian.T @ force) ** 2
        explained = 1.0 - float(left / max(size[at] ** 2, 1e-300))
        if explained < FITS or size[at] < RARE * usual:
            return None
        newtons = float(np.linalg.norm(force))
        before, after = _accelerations(record, robot, [at, at + span])
        slower = before - after
        deceleration = float(np.linalg.norm(slower))
        # A payload also resists the tip's acceleration, but no payload is heavier than the arm.
        if force @ slower > CARRIED * newtons * deceleration and newtons < float(np.sum(robot.masses)) * deceleration:
            return None
        x, y, z = force / max(newtons, 1e-300)
        position = ", ".join(f"{coordinate:.3f}" for coordinate in np.asarray(robot.tip(q)))
        evidence = (
            f"at t = {record.t[middle]:.3g} s the torque changed within {SUDDEN:g} s; a force of {newtons:.2g} N at "
            f"the tip, along ({x:.2f}, {y:.2f}, {z:.2f}), explains {percent(explained)} of the change: the tip at "
            f"({position}) m touched something"
        )
        return Finding(
            name=self.name,
            joint=None,
            # A force along gravity is more likely the weight of a picked-up payload.
            weight=0.5 if force @ np.asarray(robot.gravity_vector) > HANGS * newtons * GRAVITY else 0.9,
            evidence=evidence,
            numbers={"t": float(record.t[middle]), "force": newtons, "explained": explained},
            remedies=_contact_remedies(record),
        )


def _accelerations(record: RunRecord, robot: Articulated, samples: list[int]) -> np.ndarray:
    """Return the tip's accelerations at some samples [samples 3], m/s², from low-pass filtered positions."""
    q = low_pass(record.q, SLOW, record.period)
    dq = np.gradient(q, record.period, axis=0)
    ddq = np.gradient(dq, record.period, axis=0)

    def acceleration(q: jax.Array, dq: jax.Array, ddq: jax.Array) -> jax.Array:
        def velocity(q: jax.Array, dq: jax.Array) -> jax.Array:
            return jax.jvp(robot.tip, (q,), (dq,))[1]

        return jax.jvp(velocity, (q, dq), (dq, ddq))[1]

    return np.stack([np.asarray(acceleration(*map(jnp.asarray, (q[k], dq[k], ddq[k])))) for k in samples])


def _contact_remedies(record: RunRecord) -> list[Remedy]:
    words = "keep the motion clear of the obstacle, or remove it"
    known = record.scenario.description.surroundings.table is not None
    return [Remedy(words, {"surroundings.table": None} if known else {})]
