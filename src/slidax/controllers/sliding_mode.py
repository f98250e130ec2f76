"""The control law of the paper, equations (40) to (45) and (51), in one place."""

from __future__ import annotations

from slidax._errors import require_joints
from slidax._types import Command, Envelope, Memory, Reference, Scalar, State
from slidax.numerics import matvec, once
from slidax.reaching import AbstractBound, AbstractReaching
from slidax.robots import AbstractRobot
from slidax.surfaces import AbstractSurface
from slidax.transformations import AbstractTransformation

from .controller import AbstractController


class SlidingMode(AbstractController):
    """`τ = τ0 + τ1 + τ2`, eq. (41), with `e = q - q_d` and the surface `s = B⁻¹ε2 + pull(ε1)`, eq. (40).

    `τ0 = M0 (q̈_d - Ȧ e - A ė) + C0 q̇ + G0`, eq. (42);
    `τ1 = -K0 Sig^r(s) - M0 slope(ε1) ε2`, eq. (43);
    `τ2 = -u s/(‖s‖ + s0)`, eqs. (44), (51), with u of (45).

    - `nominal`: the robot as the law knows it, M0, C0, G0.
    - `transformation`: e to ε1, with A and B.
    - `surface`: the pull on ε1.
    - `reaching`: K0, r and s0.
    - `bound`: u.

    Signals: `s` [n], `eps1` [n], `eps2` [n], `u`.

    Raises DefinitionError if a parameter's shape does not fit the joints of the nominal robot.
    """

    nominal: AbstractRobot
    transformation: AbstractTransformation
    surface: AbstractSurface
    reaching: AbstractReaching
    bound: AbstractBound

    def __check_init__(self) -> None:
        for part in (self.transformation, self.surface, self.reaching, self.bound):
            require_joints(part, self.joints, type(self.nominal).__name__)

    @property
    def joints(self) -> int:
        """The number of joints of the nominal robot."""
        return self.nominal.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Memory:
        """What the transformation keeps from the initial error.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """
        return self.transformation.init(t, state.q - reference.q)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Memory
    ) -> Command:
        """The torque, eqs. (40)-(45), (51).

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`: what the joints should do now.
        - `reference_next`: not used by the printed law.
        - `memory`: what `init` returned.
        """
        q, dq = state.q, state.dq
        e, de = q - reference_now.q, dq - reference_now.dq
        error = once(self.transformation(t, e, de, memory))
        pull, slope = self.surface.pull_and_slope(error.eps1)
        s = de + error.alpha * e + pull

        m0 = self.nominal.mass(q)
        feedforward = reference_now.ddq - error.alpha_rate * e - error.alpha * de
        tau0 = matvec(m0, feedforward) + self.nominal.bias(q, dq)
        tau1 = -self.reaching.power(s) - matvec(m0, slope * error.eps2)
        u = self.bound(state, tau0 + tau1)
        tau2 = -u * self.reaching.direction(s)
        return Command(
            tau=tau0 + tau1 + tau2,
            memory=memory,
            signals={"s": s, "eps1": error.eps1, "eps2": error.eps2, "u": u},
        )

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """The transformation's envelope.

        - `t`: time [s].
        - `memory`: what `init` returned.
        """
        return self.transformation.envelope(t, memory)
