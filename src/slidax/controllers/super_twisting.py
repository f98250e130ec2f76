"""The super-twisting law: a continuous torque that still rejects what does not change too fast."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from slidax._errors import as_array, known, require, require_consistent, require_joints, require_per_joint
from slidax._types import Command, Envelope, Memory, PerJoint, Reference, Scalar, State, Vector
from slidax.numerics import matvec, once, sig
from slidax.robots import AbstractRobot
from slidax.surfaces import AbstractSurface
from slidax.transformations import AbstractTransformation

from .controller import AbstractController


class Integral(eqx.Module):
    """The memory of `SuperTwisting`.

    - `start`: what the transformation keeps from the initial error.
    - `v`: the integral of the sign [n], rad/s² or m/s².
    """

    start: Memory
    v: Vector


class SuperTwisting(AbstractController):
    """`τ = M0 (q̈_d - Ȧe - Aė - slope(ε1) ε2 - k1 sig^½(s) + v) + C0 q̇ + G0`, `v̇ = -k2 sgn(s)`, `v(0) = 0`.

    With the surface `s = ė + A e + pull(ε1)` of (40); on the linear one and without an envelope `s = ė + Λ e`. With the
    exact model `ṡ = -k1 sig^½(s) + v + d`, where d is the disturbance as an acceleration, and s reaches zero in finite
    time if `|ḋ| <= L`, for `k1 = 1.5 √L`, `k2 = 1.1 L`.

    Source: Levant, Sliding order and sliding accuracy in sliding mode control, 1993, with the gains of his 1998 paper
    on differentiation; stability by the quadratic function of Moreno and Osorio, 2012.

    - `nominal`: the robot as the law knows it.
    - `transformation`: e to ε1; `Unconstrained` or `PrescribedPerformance`.
    - `surface`: the pull on ε1.
    - `k1`: one number or [n], rad^½/s^(3/2) or m^½/s^(3/2), > 0.
    - `k2`: one number or [n], rad/s³ or m/s³, > 0.

    Signals: `s` [n], `eps1` [n], `eps2` [n], `v` [n].

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """

    nominal: AbstractRobot
    transformation: AbstractTransformation
    surface: AbstractSurface
    k1: PerJoint = eqx.field(converter=as_array)
    k2: PerJoint = eqx.field(converter=as_array)

    def __check_init__(self) -> None:
        for part in (self.transformation, self.surface):
            require_joints(part, self.joints, type(self.nominal).__name__)
        require_consistent(self, "k1", "k2")
        require_per_joint(self, self.joints, type(self.nominal).__name__, "k1", "k2")
        require(self, "k1", known(self.k1) > 0, "must be > 0 (Moreno and Osorio, 2012)")
        require(self, "k2", known(self.k2) > 0, "must be > 0 (Moreno and Osorio, 2012)")

    @property
    def joints(self) -> int:
        """The number of joints of the nominal robot."""
        return self.nominal.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> Integral:
        """What the transformation keeps from the initial error, and `v = 0`.

        - `t`: time at the start [s].
        - `state`: measured positions and velocities.
        - `reference`: what the joints should do then.
        """
        e = state.q - reference.q
        return Integral(start=self.transformation.init(t, e), v=jnp.zeros_like(e))

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: Integral
    ) -> Command:
        """The torque, and the rate of v.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`: what the joints should do now.
        - `reference_next`: not used.
        - `memory`: with the v of now.
        """
        q, dq = state.q, state.dq
        e, de = q - reference_now.q, dq - reference_now.dq
        error = once(self.transformation(t, e, de, memory.start))
        pull, slope = self.surface.pull_and_slope(error.eps1)
        s = de + error.alpha * e + pull
        equivalent = reference_now.ddq - error.alpha_rate * e - error.alpha * de - slope * error.eps2
        wanted = equivalent - self.k1 * sig(s, jnp.asarray(0.5)) + memory.v
        still = jax.tree.map(jnp.zeros_like, memory.start)
        return Command(
            tau=matvec(self.nominal.mass(q), wanted) + self.nominal.bias(q, dq),
            memory=memory,
            signals={"s": s, "eps1": error.eps1, "eps2": error.eps2, "v": memory.v},
            rate=Integral(start=still, v=-self.k2 * jnp.sign(s)),
        )

    def envelope(self, t: Scalar, memory: Integral) -> Envelope | None:
        """The transformation's envelope.

        - `t`: time [s].
        - `memory`: what `init` returned.
        """
        return self.transformation.envelope(t, memory.start)
