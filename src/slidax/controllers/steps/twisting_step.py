"""Implicit step of the super-twisting law."""

from __future__ import annotations

import jax.numpy as jnp

from slidax.parts import PerJoint, Vector, parameter

from .plan import Plan
from .step import Moment
from .surface_step import AbstractSurfaceStep, Reached


class TwistingStep(AbstractSurfaceStep):
    """`s⁺ = s + H (v⁺ - k1 sig^½(s⁺))`, `v⁺ = v - H k2 sgn(s⁺)` with the set-valued sign: s⁺ = 0 holds without chatter.

    For `|s + H v| <= H² k2` it is `s⁺ = 0`; else the root of s⁺ solves a quadratic equation. In one period v moves by
    `-h k2 sat((s + H v)/(H² k2))`, and stops while the limits withhold torque.
    Source: Brogliato, Polyakov and Efimov, The implicit discretization of the supertwisting sliding-mode control
    algorithm, IEEE Transactions on Automatic Control 65, 2020.

    Signals: `s`, `s_next` (s⁺), `eps1`, `v` [n]; with a recovery `reseated` [n], 1 where its envelope is in force.
    """

    k1: PerJoint = parameter("gain of the square root of s", "rad^½/s^(3/2) or m^½/s^(3/2)", "> 0")
    k2: PerJoint = parameter("gain of the integral of its sign", "rad/s³ or m/s³", "> 0")

    def reach_init(self) -> Vector:
        return jnp.zeros(self.nominal.joints)

    def reach(self, moment: Moment, plan: Plan, memory: Vector) -> Reached:
        horizon = moment.horizon
        assert horizon is not None
        target = plan.s + horizon * memory
        edge = horizon * horizon * self.k2
        beyond = jnp.maximum(jnp.abs(target) - edge, 0.0)
        damped = horizon * self.k1
        root = 2.0 * beyond / (damped + jnp.sqrt(damped * damped + 4.0 * beyond))
        share = jnp.clip(target / edge, -1.0, 1.0)
        return Reached(
            s_next=jnp.sign(target) * root * root,
            memory=memory - moment.period * self.k2 * share,
            cover=None,
            signals={"v": memory},
        )
