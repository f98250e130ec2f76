"""Computed torque with PD feedback."""

from __future__ import annotations

import equinox as eqx

from slidax._errors import as_array, known, require, require_consistent, require_per_joint
from slidax._types import Command, Memory, PerJoint, Reference, Scalar, State
from slidax.numerics import matvec
from slidax.robots import AbstractRobot

from .controller import AbstractController


class ComputedTorque(AbstractController):
    """`τ = M0 (q̈_d - Kp e - Kd ė) + C0 q̇ + G0`: with the exact model each joint is a linear oscillator of its own.

    Source: Siciliano et al., Robotics: Modelling, Planning and Control, 2009, section 8.5.2 (inverse dynamics control).

    - `nominal`: the robot as the law knows it.
    - `kp`: diagonal of Kp, one number or [n], 1/s², > 0.
    - `kd`: diagonal of Kd, one number or [n], 1/s, > 0; `2 √kp` damps critically.

    Signals: `e` [n], `de` [n].

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """

    nominal: AbstractRobot
    kp: PerJoint = eqx.field(converter=as_array, default=100.0)
    kd: PerJoint = eqx.field(converter=as_array, default=20.0)

    def __check_init__(self) -> None:
        require_consistent(self, "kp", "kd")
        require_per_joint(self, self.joints, type(self.nominal).__name__, "kp", "kd")
        require(self, "kp", known(self.kp) > 0, "must be > 0 1/s², so that the error oscillator is stable")
        require(self, "kd", known(self.kd) > 0, "must be > 0 1/s, so that the error oscillator is stable")

    @property
    def joints(self) -> int:
        """The number of joints of the nominal robot."""
        return self.nominal.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> tuple[()]:
        """Nothing to keep.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """
        return ()

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        """The torque.

        - `t`: not used.
        - `state`: measured positions and velocities.
        - `reference_now`: what the joints should do now.
        - `reference_next`: not used.
        - `memory`: empty.
        """
        e, de = state.q - reference_now.q, state.dq - reference_now.dq
        wanted = reference_now.ddq - self.kp * e - self.kd * de
        tau = matvec(self.nominal.mass(state.q), wanted) + self.nominal.bias(state.q, state.dq)
        return Command(tau=tau, memory=memory, signals={"e": e, "de": de})

    def envelope(self, t: Scalar, memory: Memory) -> None:
        """None: no bounds are promised.

        - `t`: time [s].
        - `memory`: empty.
        """
        return None
