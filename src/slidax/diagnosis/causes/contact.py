"""Cause: contact of the tip."""

from __future__ import annotations

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from slidax.robots import Articulated

from ..cause import AbstractCause, Finding, Remedy
from ..filtered import low_passed
from ..record import SLOW, Record

SUDDEN = 0.1
"""Within which time a contact shows [s]."""

FITS = 0.85
"""The share of a sudden torque that one force at the tip must explain."""

HANGS, GRAVITY = 0.9, 9.81
"""The cosine between a force and gravity's direction from which on it is a weight."""

CARRIED = 0.9
"""The cosine between a force and the tip's deceleration from which on it may be the inertia of what the arm carries."""

RARE = 4.0
"""Times the usual change in that time that it must be."""


class Contact(AbstractCause):
    """The torque missing from the model changes suddenly, like that of a force at the tip, `Jᵀ F`."""

    name: ClassVar[str] = "contact"

    def finding(self, record: Record) -> Finding | None:
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
        # A load resists the tip's acceleration as well, but none is heavier than the arm itself.
        if force @ slower > CARRIED * newtons * deceleration and newtons < float(np.sum(robot.masses)) * deceleration:
            return None
        x, y, z = force / max(newtons, 1e-300)
        place = ", ".join(f"{coordinate:.3f}" for coordinate in np.asarray(robot.tip(q)))
        evidence = (
            f"at t = {record.t[middle]:.3g} s the torque changed within {SUDDEN:g} s as a force of "
            f"{newtons:.2g} N on the "
            f"tip does, along ({x:.2f}, {y:.2f}, {z:.2f}), which explains {explained:.0%} of it: the tip at "
            f"({place}) m met "
            "something"
        )
        return Finding(
            name=self.name,
            joint=None,
            # A force along gravity is more likely a payload that the arm picked up.
            weight=0.5 if force @ np.asarray(robot.gravity_vector) > HANGS * newtons * GRAVITY else 0.9,
            evidence=evidence,
            numbers={"t": float(record.t[middle]), "force": newtons, "explained": explained},
            remedies=_contact_remedies(record),
        )


def _accelerations(record: Record, robot: Articulated, samples: list[int]) -> np.ndarray:
    """Of the tip at some samples, below the loop's band [N 3], m/s²."""
    q = low_passed(record.q, SLOW, record.period)
    dq = np.gradient(q, record.period, axis=0)
    ddq = np.gradient(dq, record.period, axis=0)

    def acceleration(q: jax.Array, dq: jax.Array, ddq: jax.Array) -> jax.Array:
        def velocity(q: jax.Array, dq: jax.Array) -> jax.Array:
            return jax.jvp(robot.tip, (q,), (dq,))[1]

        return jax.jvp(velocity, (q, dq), (dq, ddq))[1]

    return np.stack([np.asarray(acceleration(*map(jnp.asarray, (q[k], dq[k], ddq[k])))) for k in samples])


def _contact_remedies(record: Record) -> list[Remedy]:
    words = "keep the motion clear of it, or take it out of the way"
    known = record.scenario.description.surroundings.table is not None
    return [Remedy(words, {"surroundings.table": None} if known else {})]
