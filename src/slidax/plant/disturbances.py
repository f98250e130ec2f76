"""Disturbance torques: constant, step, harmonic, friction, elastic stop, their sums and multiples."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, TypeAlias

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import PerJoint, Scalar, State, Vector

Floats: TypeAlias = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Samples:
    """States at samples a period apart; over each period a joint's velocity goes from one value to the next.

    - `period`: h [s].
    - `t`: beginning of each period [N], s.
    - `q`, `dq`: positions and velocities at that time [N n].
    """

    period: float
    t: Floats
    q: Floats
    dq: Floats

    @property
    def turn(self) -> Floats:
        """|Δq̇| over each period [N n], rad/s or m/s; after the last sample as before it."""
        steps = np.abs(np.diff(self.dq, axis=0, append=self.dq[-1:]))
        return np.concatenate([steps[:-1], steps[-2:-1] if len(steps) > 1 else steps])

    @property
    def way(self) -> Floats:
        """Largest distance that a joint moves in each period [N n], rad or m."""
        return (np.abs(self.dq) + self.turn) * self.period

    def jumps(self, first: Any, last: Any) -> NDArray[np.bool_]:
        """True for each period in which, or at whose end, a jump between two times may fall [N].

        - `first`, `last`: the earliest and the latest time of the jump [s].
        """
        spare = 1e-6 * self.period
        return (np.asarray(last) >= self.t - spare) & (np.asarray(first) <= self.t + self.period + spare)


def largest_size(lower: Any, upper: Any) -> Floats:
    """The largest size of any number between two.

    - `lower`, `upper`: the ends.
    """
    return np.asarray(np.maximum(np.abs(np.asarray(lower, float)), np.abs(np.asarray(upper, float))))


class AbstractDisturbance(AbstractPart):
    """A generalised force `τ_d(t, q, q̇)` on the joints, eq. (10). `a + b` adds two, `2.0 * a` scales one."""

    @abstractmethod
    def __call__(self, t: Scalar, state: State) -> Vector:
        """`τ_d`, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """

    def breakpoints(self) -> tuple[float, ...]:
        """Times at which the force sets in, jumps or ends [s]; each short pulse contains one of them."""
        return ()

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """Bound of the force's distance from the straight line between its values at two samples [N n], N m or N.

        The bound holds for every disturbance of this class with parameters between those of `self` and `upper`. A class
        without its own bound has an infinite one, and no certificate covers it.

        - `upper`: has the largest value of each parameter, as `self` has the smallest.
        - `samples`: a period apart.
        """
        return np.full(samples.q.shape, np.inf)

    def largest(self, upper: Any, joints: int) -> Floats:
        """Bound of the force at any time and in any state [n], N m or N; infinite for a class without one.

        - `upper`: has the largest value of each parameter, as `self` has the smallest.
        - `joints`: n.
        """
        return np.full(joints, np.inf)

    def __add__(self, other: AbstractDisturbance) -> Sum:
        return Sum((self, other))

    def __mul__(self, factor: Any) -> Scaled:
        return Scaled(self, factor)

    __rmul__ = __mul__


MOST_TERMS = 50
"""Largest number of terms in a sum: each term is compiled separately."""


class Sum(AbstractDisturbance):
    """Several disturbances at once."""

    terms: tuple[AbstractDisturbance, ...] = piece("what adds up")

    def __check_init__(self) -> None:
        if len(self.terms) > MOST_TERMS:
            raise DefinitionError(f"`Sum.terms` must be at most {MOST_TERMS}; got {len(self.terms)}")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The sum of all terms, [n], N m or N; zero if there is none."""
        return sum((term(t, state) for term in self.terms), start=0.0 * state.q)

    def breakpoints(self) -> tuple[float, ...]:
        """Breakpoints of all terms [s]."""
        return tuple(time for term in self.terms for time in term.breakpoints())

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """The sum of the terms' bounds."""
        pairs = zip(self.terms, upper.terms, strict=True)
        return sum((low.off_chord(high, samples) for low, high in pairs), start=np.zeros(samples.q.shape))

    def largest(self, upper: Any, joints: int) -> Floats:
        """The sum of the terms' bounds."""
        pairs = zip(self.terms, upper.terms, strict=True)
        return sum((low.largest(high, joints) for low, high in pairs), start=np.zeros(joints))


class Scaled(AbstractDisturbance):
    """A disturbance times a factor; 0 switches it off, without a new compilation."""

    disturbance: AbstractDisturbance = piece("what is scaled")
    factor: Scalar = parameter("what it is multiplied by")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The scaled force, [n], N m or N."""
        return self.factor * self.disturbance(t, state)

    def breakpoints(self) -> tuple[float, ...]:
        """Breakpoints of the scaled disturbance [s]."""
        return self.disturbance.breakpoints()

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """The factor's largest size times the bound of the scaled disturbance."""
        factor = largest_size(self.factor, upper.factor)
        if not factor.any():
            return np.zeros(samples.q.shape)
        return factor * self.disturbance.off_chord(upper.disturbance, samples)

    def largest(self, upper: Any, joints: int) -> Floats:
        """The factor's largest size times the bound of the scaled disturbance."""
        factor = largest_size(self.factor, upper.factor)
        return factor * self.disturbance.largest(upper.disturbance, joints) if factor.any() else np.zeros(joints)


class Constant(AbstractDisturbance):
    """`τ_d = c`."""

    title = "A constant force."

    value: Vector = parameter("c, the force", "N m or N")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`c`, [n], N m or N."""
        return self.value

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """Zero for a constant force."""
        return np.zeros(samples.q.shape)

    def largest(self, upper: Any, joints: int) -> Floats:
        """|c|."""
        return np.broadcast_to(largest_size(self.value, upper.value), joints)


class Step(AbstractDisturbance):
    """`τ_d = c` for `start <= t < end`, else 0."""

    title = "A force with a beginning and an end, such as a payload's weight."

    value: Vector = parameter("c, the force", "N m or N")
    start: Scalar = parameter("when it sets in", "s")
    end: Scalar = parameter("when it ends; infinite if it stays", "s", "(start, inf]", default=float("inf"))

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`c` while it lasts, [n], N m or N."""
        return jnp.where((t >= self.start) & (t < self.end), self.value, 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Beginning and end of the force [s]."""
        return tuple(time for time in (float(self.start), float(self.end)) if np.isfinite(time))

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """|c| in each period with a possible jump inside or at its end; else zero."""
        jumps = samples.jumps(self.start, upper.start) | samples.jumps(self.end, upper.end)
        return jumps[:, None] * largest_size(self.value, upper.value)

    def largest(self, upper: Any, joints: int) -> Floats:
        """|c|."""
        return np.broadcast_to(largest_size(self.value, upper.value), joints)


class Harmonic(AbstractDisturbance):
    """`τ_d = a sin(ω t + φ)`, per joint. Both examples of the paper are sums of these and a constant."""

    title = "A sinusoidal force."

    amplitude: Vector = parameter("a, amplitude", "N m or N")
    frequency: PerJoint = parameter("ω, angular frequency", "rad/s")
    phase: PerJoint = parameter("φ, phase at t = 0", "rad", default=0.0)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`a sin(ω t + φ)`, [n], N m or N."""
        return self.amplitude * jnp.sin(self.frequency * t + self.phase)

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """`|a| min(ω² h²/8, 2)`: `h²/8` times its largest second derivative, and never more than from peak to peak."""
        angle = largest_size(self.frequency, upper.frequency) * samples.period
        bound: Floats = largest_size(self.amplitude, upper.amplitude) * np.minimum(angle**2 / 8.0, 2.0)
        return np.broadcast_to(bound, samples.q.shape)

    def largest(self, upper: Any, joints: int) -> Floats:
        """|a|."""
        return np.broadcast_to(largest_size(self.amplitude, upper.amplitude), joints)


BEND = 4.0 / (3.0 * 3.0**0.5)
"""The largest second derivative of tanh."""


class Friction(AbstractDisturbance):
    """`τ_d = -(f_c tanh(q̇/v_s) + f_v q̇)`: Coulomb friction, smoothed near rest, and viscous friction."""

    title = "Coulomb and viscous friction in the joints."

    coulomb: PerJoint = parameter("f_c, Coulomb friction", "N m or N", ">= 0", "or it would drive the joint")
    viscous: PerJoint = parameter(
        "f_v, viscous friction", "N m s/rad or N s/m", ">= 0", "or it would drive the joint", default=0.0
    )
    smoothing: PerJoint = parameter(
        "v_s, the velocity within which the sign turns", "rad/s or m/s", "> 0", default=0.01
    )

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The friction force, [n], N m or N."""
        return -(self.coulomb * jnp.tanh(state.dq / self.smoothing) + self.viscous * state.dq)

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """`f_c min(.77 x²/8, x, 2)`, `x = |Δq̇|/v_s`: by the curvature, slope or range of tanh.

        `max |tanh''| = 4/(3 √3)`. Viscous friction is as straight as the velocity.
        """
        x = samples.turn / np.asarray(self.smoothing)
        return largest_size(self.coulomb, upper.coulomb) * np.minimum(np.minimum(BEND * x * x / 8.0, x), 2.0)

    def largest(self, upper: Any, joints: int) -> Floats:
        """f_c; infinite with viscous friction, which grows with the velocity."""
        viscous = largest_size(self.viscous, upper.viscous)
        return np.broadcast_to(np.where(viscous > 0.0, np.inf, largest_size(self.coulomb, upper.coulomb)), joints)


class ElasticStop(AbstractDisturbance):
    """`τ_d = -k z max(0, 1 + c q̇)`, `z = max(0, q - a)`: pushes back, never pulls, and takes energy from an impact.

    Source: Hunt and Crossley, Coefficient of restitution interpreted as damping in vibroimpact, 1975, with exponent 1.
    """

    title = "A stiff surface on one side of a joint, such as a table below a vertical axis."

    stiffness: PerJoint = parameter("k; 0 for a joint that meets nothing", "N m/rad or N/m", ">= 0")
    position: PerJoint = parameter("a, from which on the joint is in contact", "rad or m")
    damping: PerJoint = parameter("c, damping over stiffness", "s/rad or s/m", ">= 0", default=0.0)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """The force, [n], N m or N."""
        deep = jnp.maximum(0.0, state.q - self.position)
        return -self.stiffness * deep * jnp.maximum(0.0, 1.0 + self.damping * state.dq)

    def off_chord(self, upper: Any, samples: Samples) -> Floats:
        """Largest change of the force in a period in which the joint may touch the surface; else zero."""
        deepest = np.maximum(0.0, samples.q + samples.way - np.asarray(self.position))
        fastest = np.abs(samples.dq) + samples.turn
        damping, stiffness = largest_size(self.damping, upper.damping), largest_size(self.stiffness, upper.stiffness)
        moved = np.minimum(samples.way, deepest) * (1.0 + damping * fastest)
        return stiffness * (moved + deepest * damping * samples.turn)
