"""Implicit step of laws with a reaching law and a bound: the paper's, and Slotine and Li's."""

from __future__ import annotations

import equinox as eqx
import jax

from slidax.numerics import matvec
from slidax.parts import Memory, piece, require_joints
from slidax.reaching import AbstractBound, AbstractReaching

from .plan import Plan
from .step import Moment
from .surface_step import AbstractSurfaceStep, Reached


class SlidingStep(AbstractSurfaceStep):
    """`A (s⁺ - s) = -K0 Sig^r(s⁺) - u N(s⁺)`, `A = M0/H`, with (41)-(45): the reaching step, for any reaching law.

    The compensated disturbance is at most u.

    Signals: `s`, `s_next` (s⁺), `eps1` [n], `u`; with a recovery `reseated` [n], 1 where its envelope is in force.
    """

    reaching: AbstractReaching = piece("as in the printed law: how s is driven to zero")
    bound: AbstractBound = piece("as in the printed law: u")
    slopes: bool = piece(
        "whether u counts the slope part of τ1, as (45) prints it, or τ0 and K0's part alone", default=True, static=True
    )

    def __check_init__(self) -> None:
        n = self.nominal.joints
        for part in (self.reaching, self.bound):
            require_joints(part, n, type(self.nominal).__name__)
        # Raises here, and not during a run, if the reaching law has no implicit step.
        shapes = (jax.ShapeDtypeStruct(shape, float) for shape in ((n, n), (n,), ()))
        eqx.filter_eval_shape(self.reaching.implicit, *shapes)

    def reach_init(self) -> Memory:
        return ()

    def reach(self, moment: Moment, plan: Plan, memory: Memory) -> Reached:
        assert moment.horizon is not None
        feedforward = moment.reference.ddq
        # τ0 + τ1 with the slopes that an implicit step sees.
        if self.slopes:
            feedforward = feedforward + plan.holding_acceleration()
        tau_01 = matvec(moment.mass, feedforward) + moment.bias - self.reaching.continuous_term(plan.s)
        u = self.bound(moment.state, tau_01)
        s_next = self.reaching.implicit(moment.mass / moment.horizon, plan.s, u)
        return Reached(s_next=s_next, memory=(), cover=u, signals={"u": u})
