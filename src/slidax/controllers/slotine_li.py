"""The classical sliding mode law for robot arms."""

from __future__ import annotations

import equinox as eqx
import jax

from slidax._errors import as_array, known, require, require_consistent, require_joints, require_per_joint
from slidax._types import Command, Envelope, Memory, PerJoint, Reference, Scalar, State, Vector
from slidax.numerics import matvec, once, saturation
from slidax.robots import AbstractRobot
from slidax.surfaces import AbstractSurface
from slidax.transformations import AbstractTransformation

from .controller import AbstractController


class SlotineLi(AbstractController):
    """`τ = M0 q̈_r + C0 q̇_r + G0 - K_D s - K sat(s/φ)` with the reference velocity `q̇_r = q̇ - s`.

    On the linear surface `s = ė + Λ e` it is the textbook's law, `q̇_r = q̇_d - Λ e`, `q̈_r = q̈_d - Λ ė`. On any other,
    with any transformation, `s = ė + A e + pull(ε1)` as in (40) and `q̈_r = q̈_d - Ȧ e - A ė - slope(ε1) ε2`. C0 is in
    Christoffel form, for which `Ṁ0 - 2 C0` is skew-symmetric.

    Source: Slotine and Li, Applied Nonlinear Control, 1991, chapters 7 (boundary layer) and 9 (robots).

    - `nominal`: the robot as the law knows it.
    - `transformation`: e to ε1; `Unconstrained` for the textbook's law, `PrescribedPerformance` for an envelope.
    - `surface`: the pull on ε1; `Linear` for the textbook's law.
    - `damping`: diagonal of K_D, one number or [n], N m s/rad or N s/m, >= 0.
    - `gain`: K, size of the robust torque per joint, one number or [n], N m or N, >= 0.
    - `layer`: φ, half-width of the boundary layer per joint, one number or [n], rad/s or m/s, >= 0; 0 gives the sign.

    Signals: `s` [n], `eps1` [n], `eps2` [n].

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """

    nominal: AbstractRobot
    transformation: AbstractTransformation
    surface: AbstractSurface
    damping: PerJoint = eqx.field(converter=as_array)
    gain: PerJoint = eqx.field(converter=as_array)
    layer: PerJoint = eqx.field(converter=as_array)

    def __check_init__(self) -> None:
        for part in (self.transformation, self.surface):
            require_joints(part, self.joints, type(self.nominal).__name__)
        require_consistent(self, "damping", "gain", "layer")
        require_per_joint(self, self.joints, type(self.nominal).__name__, "damping", "gain", "layer")
        require(self, "damping", known(self.damping) >= 0, "must be >= 0 (K_D; Slotine and Li, 1991)")
        require(self, "gain", known(self.gain) >= 0, "must be >= 0 (K; Slotine and Li, 1991)")
        require(self, "layer", known(self.layer) >= 0, "must be >= 0 (the boundary layer φ; 0 gives the sign)")

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
        """The torque.

        - `t`: time [s].
        - `state`: measured positions and velocities.
        - `reference_now`: what the joints should do now.
        - `reference_next`: not used.
        - `memory`: what `init` returned.
        """
        q, dq = state.q, state.dq
        e, de = q - reference_now.q, dq - reference_now.dq
        error = once(self.transformation(t, e, de, memory))
        pull, slope = self.surface.pull_and_slope(error.eps1)
        s = de + error.alpha * e + pull
        ddq_r = reference_now.ddq - error.alpha_rate * e - error.alpha * de - slope * error.eps2

        def bias(dq: Vector) -> Vector:
            return self.nominal.bias(q, dq)

        # C q̇ is quadratic in q̇, so half its derivative along s is C s with the C of Christoffel: no matrix is needed.
        whole, along_s = jax.jvp(bias, (dq,), (s,))
        model = matvec(self.nominal.mass(q), ddq_r) + whole - 0.5 * along_s
        tau = model - self.damping * s - self.gain * saturation(s, self.layer)
        return Command(tau=tau, memory=memory, signals={"s": s, "eps1": error.eps1, "eps2": error.eps2})

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        """The transformation's envelope.

        - `t`: time [s].
        - `memory`: what `init` returned.
        """
        return self.transformation.envelope(t, memory)
