"""Disturbance torques: constant, step, harmonic, friction, ripple, elastic stop, their sums and multiples.

Certificates evaluate a force at samples only. The chord is the straight line between the force's values at two samples.
A chord deviation bounds the distance of the force from the chord at all times in between.
"""

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
    """States of a motion at the beginning of each sampling period.

    - `period`: sampling period h [s].
    - `t`: beginning of each period [samples], s.
    - `q`, `dq`: positions and velocities at this time [samples n].
    """

    period: float
    t: Floats
    q: Floats
    dq: Floats

    @property
    def dq_change(self) -> Floats:
        """|Δq̇|, velocity change over each period [samples n], rad/s or m/s; the last value repeats the previous one."""
        steps = np.abs(np.diff(self.dq, axis=0, append=self.dq[-1:]))
        return np.concatenate([steps[:-1], steps[-2:-1] if len(steps) > 1 else steps])

    @property
    def travel(self) -> Floats:
        """Bound of the distance that a joint travels in each period [samples n], rad or m."""
        return (np.abs(self.dq) + self.dq_change) * self.period

    def jumps(self, first: Any, last: Any) -> NDArray[np.bool_]:
        """True for each period in which the force may jump, its ends included [samples].

        - `first`, `last`: earliest and latest time of the jump [s].
        """
        spare = 1e-6 * self.period
        return (np.asarray(last) >= self.t - spare) & (np.asarray(first) <= self.t + self.period + spare)


def largest_magnitude(lower: Any, upper: Any) -> Floats:
    """Largest absolute value in the interval from `lower` to `upper`."""
    return np.asarray(np.maximum(np.abs(np.asarray(lower, float)), np.abs(np.asarray(upper, float))))


class AbstractDisturbance(AbstractPart):
    """A generalised force `τ_d(t, q, q̇)` on the joints, eq. (10) of the paper.

    `a + b` adds two disturbances, `2.0 * a` scales one.
    """

    @abstractmethod
    def __call__(self, t: Scalar, state: State) -> Vector:
        """Return `τ_d`, [n], N m or N.

        - `t`: time [s].
        - `state`: positions and velocities.
        """

    def breakpoints(self) -> tuple[float, ...]:
        """Return the times at which the force begins, jumps or ends [s].

        Checks at samples also evaluate the force at these times, so that they miss no short pulse.
        """
        return ()

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """Bound of the force's deviation from its chord in each period [samples n], N m or N.

        The bound holds for every disturbance of this class with parameters between those of `self` and `upper`. The
        motion is taken to have a constant acceleration in each period. By default the bound is infinite; then no
        certificate covers the class.

        - `upper`: disturbance with the largest value of each parameter; `self` has the smallest.
        - `samples`: states at the samples.
        """
        return np.full(samples.q.shape, np.inf)

    def largest(self, upper: Any, joints: int) -> Floats:
        """Bound of the absolute force at any time and in any state [n], N m or N; infinite by default.

        - `upper`: disturbance with the largest value of each parameter; `self` has the smallest.
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
    """Sum of several disturbances, `terms`."""

    terms: tuple[AbstractDisturbance, ...] = piece("disturbances that are added")

    def __check_init__(self) -> None:
        if len(self.terms) > MOST_TERMS:
            raise DefinitionError(
                f"`Sum.terms` must be at most {MOST_TERMS} disturbances; got {len(self.terms)}: merge some"
            )

    def __call__(self, t: Scalar, state: State) -> Vector:
        """Return the sum of all terms, [n], N m or N; zero if there is none."""
        return sum((term(t, state) for term in self.terms), start=0.0 * state.q)

    def breakpoints(self) -> tuple[float, ...]:
        """Return the times at which a term begins, jumps or ends [s]."""
        return tuple(time for term in self.terms for time in term.breakpoints())

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """Return the sum of the terms' chord deviations [samples n], N m or N."""
        pairs = zip(self.terms, upper.terms, strict=True)
        return sum((low.chord_deviation(high, samples) for low, high in pairs), start=np.zeros(samples.q.shape))

    def largest(self, upper: Any, joints: int) -> Floats:
        """Return the sum of the terms' largest forces [n], N m or N."""
        pairs = zip(self.terms, upper.terms, strict=True)
        return sum((low.largest(high, joints) for low, high in pairs), start=np.zeros(joints))


class Scaled(AbstractDisturbance):
    """A disturbance times a factor; the factor 0 switches it off without a new compilation."""

    disturbance: AbstractDisturbance = piece("the scaled disturbance")
    factor: Scalar = parameter("factor on the disturbance")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """Return the scaled force, [n], N m or N."""
        return self.factor * self.disturbance(t, state)

    def breakpoints(self) -> tuple[float, ...]:
        """Return the times at which the scaled disturbance begins, jumps or ends [s]."""
        return self.disturbance.breakpoints()

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """Return the disturbance's chord deviation times the factor's largest magnitude [samples n], N m or N."""
        factor = largest_magnitude(self.factor, upper.factor)
        if not factor.any():
            return np.zeros(samples.q.shape)
        return factor * self.disturbance.chord_deviation(upper.disturbance, samples)

    def largest(self, upper: Any, joints: int) -> Floats:
        """Return the disturbance's largest force times the factor's largest magnitude [n], N m or N."""
        factor = largest_magnitude(self.factor, upper.factor)
        return factor * self.disturbance.largest(upper.disturbance, joints) if factor.any() else np.zeros(joints)


class Constant(AbstractDisturbance):
    """`τ_d = c`."""

    title = "A constant force."

    value: Vector = parameter("c, the force", "N m or N")

    def __call__(self, t: Scalar, state: State) -> Vector:
        """Return the force `c`, [n], N m or N."""
        return self.value

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """Return zero, since the force is constant."""
        return np.zeros(samples.q.shape)

    def largest(self, upper: Any, joints: int) -> Floats:
        """Return the largest |c| within the parameter bounds [n], N m or N."""
        return np.broadcast_to(largest_magnitude(self.value, upper.value), joints)


class Step(AbstractDisturbance):
    """`τ_d = c` for `start <= t < end`, else 0."""

    title = "A force with a beginning and an end, such as a payload's weight."

    value: Vector = parameter("c, the force", "N m or N")
    start: Scalar = parameter("start time", "s")
    end: Scalar = parameter("end time; infinite for a lasting force", "s", "(start, inf]", default=float("inf"))

    def __call__(self, t: Scalar, state: State) -> Vector:
        """Return the force: `c` from start to end, else 0, [n], N m or N."""
        return jnp.where((t >= self.start) & (t < self.end), self.value, 0.0)

    def breakpoints(self) -> tuple[float, ...]:
        """Return the times at which the force begins and ends [s]."""
        return tuple(time for time in (float(self.start), float(self.end)) if np.isfinite(time))

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """Return |c| for each period in which the force may jump, and zero for others [samples n], N m or N."""
        jumps = samples.jumps(self.start, upper.start) | samples.jumps(self.end, upper.end)
        return jumps[:, None] * largest_magnitude(self.value, upper.value)

    def largest(self, upper: Any, joints: int) -> Floats:
        """Return the largest |c| within the parameter bounds [n], N m or N."""
        return np.broadcast_to(largest_magnitude(self.value, upper.value), joints)


class Harmonic(AbstractDisturbance):
    """`τ_d = a sin(ω t + φ)`, per joint. Both examples of the paper are sums of these and a constant."""

    title = "A sinusoidal force."

    amplitude: Vector = parameter("a, amplitude", "N m or N")
    frequency: PerJoint = parameter("ω, angular frequency", "rad/s")
    phase: PerJoint = parameter("φ, phase at t = 0", "rad", default=0.0)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`a sin(ω t + φ)`, [n], N m or N."""
        return self.amplitude * jnp.sin(self.frequency * t + self.phase)

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """`|a| min(ω² h²/8, 2)`: from the force's second derivative or peak-to-peak value, [samples n], N m or N."""
        angle = largest_magnitude(self.frequency, upper.frequency) * samples.period
        bound: Floats = largest_magnitude(self.amplitude, upper.amplitude) * np.minimum(angle**2 / 8.0, 2.0)
        return np.broadcast_to(bound, samples.q.shape)

    def largest(self, upper: Any, joints: int) -> Floats:
        """Return the largest amplitude |a| within the parameter bounds [n], N m or N."""
        return np.broadcast_to(largest_magnitude(self.amplitude, upper.amplitude), joints)


TANH_CURVATURE = 4.0 / (3.0 * 3.0**0.5)
"""The largest second derivative of tanh."""

BELL_SLOPE = float(np.sqrt(2.0) * np.exp(-0.5))
"""The largest derivative of exp(-x²)."""


class Friction(AbstractDisturbance):
    """`τ_d = -(f_c tanh(q̇/v_s) + f_v q̇)`: Coulomb friction, smoothed near rest, and viscous friction."""

    title = "Coulomb and viscous friction in the joints."

    coulomb: PerJoint = parameter("f_c, Coulomb friction", "N m or N", ">= 0", "or it would drive the joint")
    viscous: PerJoint = parameter(
        "f_v, viscous friction", "N m s/rad or N s/m", ">= 0", "or it would drive the joint", default=0.0
    )
    smoothing: PerJoint = parameter("v_s, width of the smoothed sign change", "rad/s or m/s", "> 0", default=0.01)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """Return the friction force, [n], N m or N."""
        return -(self.coulomb * jnp.tanh(state.dq / self.smoothing) + self.viscous * state.dq)

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """`f_c min(0.77 x²/8, x, 2)`, `x = |Δq̇|/v_s`: from curvature, slope or range of tanh, [samples n], N m or N.

        `max |tanh''| = 4/(3 √3)`. Viscous friction is linear in the velocity and adds nothing.
        """
        x = samples.dq_change / np.asarray(self.smoothing)
        return largest_magnitude(self.coulomb, upper.coulomb) * np.minimum(
            np.minimum(TANH_CURVATURE * x * x / 8.0, x), 2.0
        )

    def largest(self, upper: Any, joints: int) -> Floats:
        """Return the largest f_c [n], N m or N; infinite with viscous friction, which grows with the velocity."""
        viscous = largest_magnitude(self.viscous, upper.viscous)
        return np.broadcast_to(np.where(viscous > 0.0, np.inf, largest_magnitude(self.coulomb, upper.coulomb)), joints)


class Stribeck(AbstractDisturbance):
    """`τ_d = -f_s exp(-(q̇/v_st)²) tanh(q̇/v_s)`: excess of static over Coulomb friction in a slow joint.

    The Coulomb friction itself is in the arm's `coulomb`, or in a `Friction`.

    Source: Armstrong-Hélouvry, Dupont and Canudas de Wit, A survey of models, analysis tools and compensation methods
    for the control of machines with friction, Automatica 1994.
    """

    title = "Static friction in excess of Coulomb friction (Stribeck effect)."

    excess: PerJoint = parameter("f_s, static less Coulomb friction", "N m or N", ">= 0", "or it would drive the joint")
    velocity: PerJoint = parameter("v_st, Stribeck velocity", "rad/s or m/s", "> 0", default=0.05)
    smoothing: PerJoint = parameter("v_s, width of the smoothed sign change", "rad/s or m/s", "> 0", default=0.01)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """Return the friction force, [n], N m or N."""
        return -self.excess * jnp.exp(-((state.dq / self.velocity) ** 2)) * jnp.tanh(state.dq / self.smoothing)

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """`f_s min(c |Δq̇|²/8, |Δq̇| (1/v_s + 0.86/v_st), 2)`: from the curvature, slope or range of the force.

        Its shape is [samples n], its unit N m or N. `c = 0.77/v_s² + 1.72/(v_s v_st) + 2/v_st²`, since
        `|d/dx exp(-x²)| <= 0.858` and `|d²/dx² exp(-x²)| <= 2`.
        """
        x, y = (samples.dq_change / np.asarray(width) for width in (self.smoothing, self.velocity))
        curved = TANH_CURVATURE * x * x + 2.0 * BELL_SLOPE * x * y + 2.0 * y * y
        size = np.minimum(np.minimum(curved / 8.0, x + BELL_SLOPE * y), 2.0)
        return largest_magnitude(self.excess, upper.excess) * size

    def largest(self, upper: Any, joints: int) -> Floats:
        """Return the largest f_s within the parameter bounds [n], N m or N."""
        return np.broadcast_to(largest_magnitude(self.excess, upper.excess), joints)


class Ripple(AbstractDisturbance):
    """`τ_d = a sin(N q + φ)`: a torque that repeats with the joint's position.

    Cogging of a motor with p poles and gear ratio i has `N = p i` and multiples of it; a harmonic drive has `N = 2 i`.
    """

    title = "Torque ripple over the joint's position: cogging, or the ripple of a harmonic drive."

    amplitude: PerJoint = parameter("a, amplitude", "N m or N")
    periods: PerJoint = parameter("N, periods per turn of a revolute joint; per 2π m of a prismatic one", "", "> 0")
    phase: PerJoint = parameter("φ, phase at position 0", "rad", default=0.0)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """`a sin(N q + φ)`, [n], N m or N."""
        return self.amplitude * jnp.sin(self.periods * state.q + self.phase)

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """`|a| min((x² + N |Δq̇| h)/8, x, 2)`, `x = N (|q̇| + |Δq̇|) h`: from curvature, slope or range of the force."""
        periods = largest_magnitude(self.periods, upper.periods)
        x = periods * samples.travel
        curved = x * x + periods * samples.dq_change * samples.period
        size = np.minimum(np.minimum(curved / 8.0, x), 2.0)
        return largest_magnitude(self.amplitude, upper.amplitude) * size

    def largest(self, upper: Any, joints: int) -> Floats:
        """Return the largest amplitude |a| within the parameter bounds [n], N m or N."""
        return np.broadcast_to(largest_magnitude(self.amplitude, upper.amplitude), joints)


class ElasticStop(AbstractDisturbance):
    """`τ_d = -k z max(0, 1 + c q̇)`, `z = max(0, q - a)`: a contact force that never pulls and dissipates energy.

    Source: Hunt and Crossley, Coefficient of restitution interpreted as damping in vibroimpact, 1975, with exponent 1.
    """

    title = "A stiff surface on one side of a joint, such as a table below a vertical axis."

    stiffness: PerJoint = parameter("k, stiffness of the stop; 0 for a joint without one", "N m/rad or N/m", ">= 0")
    position: PerJoint = parameter("a, position of first contact", "rad or m")
    damping: PerJoint = parameter("c, damping over stiffness", "s/rad or s/m", ">= 0", default=0.0)

    def __call__(self, t: Scalar, state: State) -> Vector:
        """Return the contact force, [n], N m or N."""
        deep = jnp.maximum(0.0, state.q - self.position)
        return -self.stiffness * deep * jnp.maximum(0.0, 1.0 + self.damping * state.dq)

    def chord_deviation(self, upper: Any, samples: Samples) -> Floats:
        """Bound of the force's change in each period with possible contact, else zero [samples n], N m or N."""
        deepest = np.maximum(0.0, samples.q + samples.travel - np.asarray(self.position))
        fastest = np.abs(samples.dq) + samples.dq_change
        damping, stiffness = (
            largest_magnitude(self.damping, upper.damping),
            largest_magnitude(self.stiffness, upper.stiffness),
        )
        moved = np.minimum(samples.travel, deepest) * (1.0 + damping * fastest)
        return stiffness * (moved + deepest * damping * samples.dq_change)
