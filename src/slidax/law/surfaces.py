"""Sliding surfaces `s = ė + A e + φ(ε1)`.

The paper is Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w; numbers such as [24] are its references. Powers
keep the sign: `sig^a(x) = |x|^a sgn(x)`, and `Sig^a` for each entry of a vector.

Export a new surface in `law/__init__.py`, and list it in `tests/law/members.py`.
"""

from __future__ import annotations

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp

from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.powers import (
    linear_core_power_and_slope,
    power,
    sig_and_slope,
    smooth_power_and_slope,
    two_term_power_and_slope,
)
from slidax.core.tracing import barrier
from slidax.core.types import Memory, PerJoint, Reference, Scalar, State, Vector

from .error_transformations import AbstractTransformation, TransformedError


class AbstractSurface(AbstractPart):
    """The term φ(ε1) of a sliding surface `s = B⁻¹ ε2 + φ(ε1)`, the paper's eq. (40).

    ε1 is the transformed error, ε2 its rate, and B = ∂ε1/∂e a diagonal matrix (`TransformedError`).
    """

    @abstractmethod
    def phi_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """Return φ(ε1) [n], rad/s or m/s, odd and increasing, and its derivative [n], >= 0.

        One method computes both, since they share their powers.

        - `eps`: transformed error ε1 [n].
        """

    @abstractmethod
    def reach(self, phi: Vector) -> Vector:
        """Return a transformed error at which φ is at least `phi`, [n]: an upper bound for root searches.

        - `phi`: >= 0, [n], rad/s or m/s.
        """


class SlidingVariable(eqx.Module):
    """`s = ė + A e + φ(ε1)`, the paper's eq. (40), and the acceleration that keeps s constant. All [n].

    - `s`: sliding variable, rad/s or m/s.
    - `error`: the transformed error ε1, with its rate ε2 and A.
    - `feedforward`: `q̈_d - Ȧ e - A ė`, the acceleration of the reference and the envelope, rad/s² or m/s².
    - `phi_rate`: `φ'(ε1) ε2`, the rate of φ, rad/s² or m/s².
    """

    s: Vector
    error: TransformedError
    feedforward: Vector
    phi_rate: Vector

    @property
    def equivalent(self) -> Vector:
        """The acceleration that keeps s constant, [n], rad/s² or m/s²."""
        return self.feedforward - self.phi_rate

    @property
    def signals(self) -> dict[str, Vector]:
        """Logged quantities: `s`, `eps1`, `eps2`."""
        return {"s": self.s, "eps1": self.error.eps1, "eps2": self.error.eps2}


def sliding_variable(
    transformation: AbstractTransformation,
    surface: AbstractSurface,
    t: Scalar,
    state: State,
    reference: Reference,
    memory: Memory,
) -> SlidingVariable:
    """Return the sliding variable of a surface over a transformed error.

    - `transformation`: error transformation from e to ε1.
    - `surface`: φ(ε1).
    - `t`: time [s].
    - `state`, `reference`: measured state and desired motion at this time.
    - `memory`: memory of the transformation.
    """
    e, de = state.q - reference.q, state.dq - reference.dq
    error = barrier(transformation(t, e, de, memory))
    phi, slope = surface.phi_and_slope(error.eps1)
    return SlidingVariable(
        s=de + error.alpha * e + phi,
        error=error,
        feedforward=reference.ddq - error.alpha_rate * e - error.alpha * de,
        phi_rate=slope * error.eps2,
    )


class Linear(AbstractSurface):
    """`φ = Λ e` with `ε1 = e`: on the surface `ė + Λ e = 0` the error decays as `exp(-Λ t)`.

    Source: Slotine and Li, Applied Nonlinear Control, 1991, chapter 7.
    """

    title = "The classical linear surface."

    rate: PerJoint = parameter(
        "diagonal of Λ, how fast the error decays on the surface",
        "1/s",
        "> 0",
        "so that the error decays (Slotine and Li, 1991)",
    )

    def phi_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """Return `Λ e` and its derivative `Λ`, both [n]."""
        return self.rate * eps, self.rate * jnp.ones_like(eps)

    def reach(self, phi: Vector) -> Vector:
        """`φ/Λ`, [n]."""
        return phi / self.rate


class LinearCoreFixedTime(AbstractSurface):
    """`φ = K1 Ŝ^p(ε1) + K2 Sig^q(ε1)` with the paper's `ŝ^p` (78): `sig^p(x)` for `|x| >= δ`, else `δ^(p-1) x`.

    The surface of the schemes that the paper cites as [23] and [33], as the paper describes them at (78), (79). It is
    continuous, but its slope jumps at δ, so that the torque jumps, too. `sig^p(x) = |x|^p sgn(x)`.
    """

    title = "An earlier fixed-time terminal surface, with a kink at the edge of its linear core."

    k1: PerJoint = parameter(
        "diagonal of K1", "rad/s or m/s", "> 0", "so that K1 is diagonal positive definite (eq. 40)"
    )
    k2: PerJoint = parameter(
        "diagonal of K2", "rad/s or m/s", "> 0", "so that K2 is diagonal positive definite (eq. 40)"
    )
    p: PerJoint = parameter("exponent near zero", "", "(0, 1)", "(eq. 78)")
    q: PerJoint = parameter("exponent far from zero", "", "> 1", "(eq. 34)")
    delta: PerJoint = parameter("δ, half-width of the straight core", "", "(0, 1]", "(eq. 78)")

    def phi_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """Return φ and its derivative `K1 F̂^p(ε1) + K2 H^q(ε1)`, both [n].

        F̂^p and H^q are the derivatives of Ŝ^p and Sig^q. At |ε1| = δ, F̂^p has its value for |ε1| > δ.
        """
        near, near_slope = linear_core_power_and_slope(eps, self.p, self.delta)
        far, far_slope = sig_and_slope(eps, self.q)
        return self.k1 * near + self.k2 * far, self.k1 * near_slope + self.k2 * far_slope

    def reach(self, phi: Vector) -> Vector:
        """`(φ/K2)^(1/q)`, [n], where the term `K2 Sig^q` alone is `phi`."""
        return power(phi / self.k2, 1.0 / self.q)


class SingularityFree(AbstractSurface):
    """`φ = C1 S_α(e) + C2 Sig^β(e)`: `S_α(x) = sig^α(x)` for `|x| >= δ`, else `l1 x + l2 sig^r(x)`.

    `l1 = (r-α)/(r-1) δ^(α-1)` and `l2 = (α-1)/(r-1) δ^(α-r)` make it continuously differentiable at δ.
    The surface of the scheme that the paper cites as [24]. Reconstructed from the parameters in the paper's Table 2,
    with medium confidence. `sig^α(x) = |x|^α sgn(x)`, and e is the transformed error of a law without an envelope.
    """

    title = "The surface of the singularity-free fixed-time scheme."

    c1: PerJoint = parameter("diagonal of C1", "rad/s or m/s", "> 0", "so that C1 is diagonal positive definite ([24])")
    c2: PerJoint = parameter("diagonal of C2", "rad/s or m/s", "> 0", "so that C2 is diagonal positive definite ([24])")
    alpha: PerJoint = parameter("α, exponent near zero", "", "(0, 1)", "([24])")
    beta: PerJoint = parameter("β, exponent far from zero", "", "> 1", "([24])")
    r: PerJoint = parameter("exponent in the core", "", "> 1", "so that the slope is finite at zero ([24])")
    delta: PerJoint = parameter("δ, half-width of the core", "rad or m", "> 0", "([24])")

    def phi_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """Return φ and its derivative `C1 S_α'(e) + C2 β |e|^(β-1)`, both [n]."""
        near, near_slope = two_term_power_and_slope(eps, self.alpha, self.r, self.delta)
        far, far_slope = sig_and_slope(eps, self.beta)
        return self.c1 * near + self.c2 * far, self.c1 * near_slope + self.c2 * far_slope

    def reach(self, phi: Vector) -> Vector:
        """`(φ/C2)^(1/β)`, [n], where the term `C2 Sig^β` alone is `phi`."""
        return power(phi / self.c2, 1.0 / self.beta)


class SmoothFixedTime(AbstractSurface):
    """`φ = K1 S^p(ε1) + K2 S^q(ε1)`, the paper's eqs. (29)-(40).

    For each joint `S^q = |ε1|^q sgn(ε1)`. S^p is `|ε1|^p sgn(ε1)` for `|ε1| >= δ`, and a smooth cubic for `|ε1| < δ`.
    """

    title = "The paper's smooth fixed-time terminal surface."

    k1: PerJoint = parameter(
        "diagonal of K1", "rad/s or m/s", "> 0", "so that K1 is diagonal positive definite (eq. 40)"
    )
    k2: PerJoint = parameter(
        "diagonal of K2", "rad/s or m/s", "> 0", "so that K2 is diagonal positive definite (eq. 40)"
    )
    p: PerJoint = parameter("exponent near zero", "", "(0, 1)", "(eq. 29)")
    q: PerJoint = parameter("exponent far from zero", "", "> 1", "(eq. 34)")
    delta: PerJoint = parameter("δ, half-width of the smooth core", "", "(0, 1]", "(eq. 29)")

    def phi_and_slope(self, eps: Vector) -> tuple[Vector, Vector]:
        """Return φ and its derivative `K1 F^p(ε1) + K2 H^q(ε1)`, both [n], the paper's eqs. (33)-(39).

        F^p and H^q are the derivatives of S^p and S^q.
        """
        near, near_slope = smooth_power_and_slope(eps, self.p, self.delta)
        far, far_slope = sig_and_slope(eps, self.q)
        return self.k1 * near + self.k2 * far, self.k1 * near_slope + self.k2 * far_slope

    def reach(self, phi: Vector) -> Vector:
        """`(φ/K2)^(1/q)`, [n], where the term `K2 S^q` alone is `phi`."""
        return power(phi / self.k2, 1.0 / self.q)
