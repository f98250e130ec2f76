"""The nonsingular fast terminal scheme that the paper cites as [7]."""

from __future__ import annotations

import equinox as eqx

from slidax._errors import as_array, known, require, require_consistent, require_per_joint, require_shape
from slidax._types import Command, Memory, PerJoint, Reference, Scalar, State
from slidax.numerics import inverse_norm, matvec, sig, sig_and_slope, unit_vector
from slidax.reaching import StateBound
from slidax.robots import AbstractRobot

from .controller import AbstractController


class NonsingularFastTerminal(AbstractController):
    """Nonsingular fast terminal sliding mode control (NFTSMC), [7].

    `s = e + sig^Γ1(e) + sig^Γ2(ė)`; `η = ‖M0⁻¹‖ (b0 + b1‖q‖ + b2‖q̇‖²)`;
    `τ = C0 q̇ + G0 + M0 (q̈_d - Γ2⁻¹ (I + Γ1 |e|^(Γ1-1)) sig^(2-Γ2)(ė) - M2 s - (η + M1) s/(‖s‖ + s0))`.
    Nonsingular since 1 < Γ2 < 2. The matrix norm is the spectral one.

    The paper prints its parameters, not its law; this one is that of public code with the same names and values. That
    it is [7] has confidence medium to high. Defaults are those of Table 2. It lists no boundary layer, hence the unit
    vector; the printed accuracy is about that of a run with `layer=3e-4`.

    - `nominal`: the robot as the law knows it.
    - `bound`: b0, b1, b2.
    - `gamma1`: diagonal of Γ1, one number or [n], > Γ2.
    - `gamma2`: diagonal of Γ2, one number or [n], in (1, 2).
    - `reach`: M1, one number, rad/s² or m/s², > 0.
    - `gain`: diagonal of M2, one number or [n], 1/s², > 0.
    - `layer`: s0, one number, rad or m, >= 0; 0 gives the unit vector.

    Signals: `s` [n], `u`, the size `η + M1` of the robust acceleration.

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """

    nominal: AbstractRobot
    bound: StateBound
    gamma1: PerJoint = eqx.field(converter=as_array, default=2.0)
    gamma2: PerJoint = eqx.field(converter=as_array, default=5.0 / 3.0)
    reach: Scalar = eqx.field(converter=as_array, default=2.0)
    gain: PerJoint = eqx.field(converter=as_array, default=2.0)
    layer: Scalar = eqx.field(converter=as_array, default=0.0)

    def __check_init__(self) -> None:
        require_consistent(self, "gamma1", "gamma2", "gain")
        require_per_joint(self, self.joints, type(self.nominal).__name__, "gamma1", "gamma2", "gain")
        require_shape(self, (), "reach", "layer")
        require(
            self,
            "gamma2",
            (known(self.gamma2) > 1) & (known(self.gamma2) < 2),
            "must be in (1, 2), so that τ is finite ([7])",
        )
        require(self, "gamma1", known(self.gamma1) > known(self.gamma2), "must be > `gamma2` ([7])")
        require(self, "reach", known(self.reach) > 0, "must be > 0 (M1, [7])")
        require(self, "gain", known(self.gain) > 0, "must be > 0 (M2, [7])")
        require(self, "layer", known(self.layer) >= 0, "must be >= 0 (s0; 0 gives the unit vector)")

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
        q, dq = state.q, state.dq
        e, de = q - reference_now.q, dq - reference_now.dq
        far, slope = sig_and_slope(e, self.gamma1)
        s = e + far + sig(de, self.gamma2)
        m0 = self.nominal.mass(q)
        u = inverse_norm(m0) * self.bound(state, state.q) + self.reach
        wanted = (
            reference_now.ddq
            - (1.0 + slope) * sig(de, 2.0 - self.gamma2) / self.gamma2
            - self.gain * s
            - u * unit_vector(s, self.layer)
        )
        tau = matvec(m0, wanted) + self.nominal.bias(q, dq)
        return Command(tau=tau, memory=memory, signals={"s": s, "u": u})

    def envelope(self, t: Scalar, memory: Memory) -> None:
        """None: no bounds are promised.

        - `t`: time [s].
        - `memory`: empty.
        """
        return None
