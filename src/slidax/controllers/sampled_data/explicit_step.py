"""Explicit step, for laws without an implicit form: the law at the predicted state."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx

from slidax._types import Envelope, Reference
from slidax.numerics import solve_symmetric
from slidax.parts import DefinitionError, Memory, Scalar, State, piece
from slidax.robots import AbstractRobot

from ..controller import AbstractController
from ..steps import AbstractStep, Decision, Moment


class ExplicitStep(AbstractStep):
    """`τ = law(t, q, q̇)`, with q and q̇ as predicted and the reference's mean acceleration over the period.

    A memory with a rate is integrated over the period, and stops while the limits withhold torque. Only the torque
    limits bound the compensated disturbance, since such a law has no robust torque u.

    Signals: those of the law.
    """

    law: AbstractController = piece("the law as it is printed")
    plans: ClassVar[bool] = False

    def __check_init__(self) -> None:
        if not isinstance(getattr(self.law, "nominal", None), AbstractRobot):
            raise DefinitionError(
                f"`{type(self.law).__name__}` has no `nominal` robot, by which its sampled-data form predicts the arm"
            )

    @property
    def robot(self) -> AbstractRobot:
        return self.law.nominal  # type: ignore[attr-defined]

    def init(self, t: Scalar, state: State, reference: Reference, period: Scalar, horizon: Scalar | None) -> Memory:
        return self.law.init(t, state, reference)

    def __call__(self, moment: Moment, memory: Memory) -> Decision:
        h, now = moment.period, moment.reference
        ahead = Reference(q=now.q + h * (now.dq + 0.5 * h * now.ddq), dq=now.dq + h * now.ddq, ddq=now.ddq)
        law = eqx.tree_at(lambda law: law.nominal, self.law, moment.robot)
        command = law(moment.t, moment.state, now, ahead, memory)
        return Decision(
            tau=command.tau,
            acceleration=solve_symmetric(moment.mass, command.tau - moment.bias),
            memory=command.memory_after(h),
            signals=command.signals,
            limited=None if command.rate is None else command.memory,
        )

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.law.envelope(t, memory)
