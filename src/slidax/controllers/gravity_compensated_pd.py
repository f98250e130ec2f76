"""PD feedback with gravity compensation."""

from __future__ import annotations

import equinox as eqx

from slidax._errors import as_array, known, require, require_consistent, require_per_joint
from slidax._types import Command, Memory, PerJoint, Reference, Scalar, State
from slidax.robots import AbstractRobot

from .controller import AbstractController


class GravityCompensatedPD(AbstractController):
    """`τ = -Kp e - Kd ė + G0(q)`: brings an arm to rest at a posture; on a motion it lags behind.

    Source: Takegaki and Arimoto, 1981; Siciliano et al., Robotics: Modelling, Planning and Control, 2009, sec. 8.5.1.

    - `nominal`: the robot as the law knows it; of it only the gravity is used.
    - `kp`: diagonal of Kp, one number or [n], N m/rad or N/m, > 0.
    - `kd`: diagonal of Kd, one number or [n], N m s/rad or N s/m, > 0.

    Signals: `e` [n], `de` [n].

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """

    nominal: AbstractRobot
    kp: PerJoint = eqx.field(converter=as_array, default=400.0)
    kd: PerJoint = eqx.field(converter=as_array, default=100.0)

    def __check_init__(self) -> None:
        require_consistent(self, "kp", "kd")
        require_per_joint(self, self.joints, type(self.nominal).__name__, "kp", "kd")
        require(
            self, "kp", known(self.kp) > 0, "must be > 0, so that the posture is stable (Takegaki and Arimoto, 1981)"
        )
        require(
            self, "kd", known(self.kd) > 0, "must be > 0, so that the posture is stable (Takegaki and Arimoto, 1981)"
        )

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
        tau = self.nominal.gravity(state.q) - self.kp * e - self.kd * de
        return Command(tau=tau, memory=memory, signals={"e": e, "de": de})

    def envelope(self, t: Scalar, memory: Memory) -> None:
        """None: no bounds are promised.

        - `t`: time [s].
        - `memory`: empty.
        """
        return None
