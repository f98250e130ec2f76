"""Trajectories: the base classes, closed-form motions, piecewise polynomials and their extremes.

Examples 4.1 and 4.2 are those of Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError, is_traced
from slidax.core.integrators import value_rate_curvature
from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.types import PerJoint, Reference, Scalar, Vector


class AbstractMotion(AbstractPart):
    """A desired motion `q_d(t)`. Subclasses define the position; velocity and acceleration are its derivatives."""

    @property
    def until(self) -> Scalar | float:
        """Time after which the motion stands still [s]; infinite for an endless motion."""
        return math.inf

    @abstractmethod
    def position(self, t: Scalar) -> Vector:
        """Return `q_d(t)`, [n], rad or m, at time t [s]."""

    def reference(self, t: Scalar) -> Reference:
        """Return `q_d`, `q̇_d`, `q̈_d` at time t [s]."""
        q, dq, ddq = value_rate_curvature(self.position, t)
        return Reference(q=q, dq=dq, ddq=ddq)


Rows = NDArray[np.float64]


class AbstractSmoothMotion(AbstractMotion):
    """A motion whose derivatives of all orders have closed forms and bounds."""

    @abstractmethod
    def derivative(self, t: Rows, order: int) -> Rows:
        """Return the `order`-th time derivative of q_d at the times `t` [s], [times n]; order 0 is q_d."""

    @abstractmethod
    def largest_derivative(self, since: Rows, order: int) -> Rows:
        """Return upper bounds of the absolute value of a derivative of q_d, [times n].

        - `since`: times [s]; a row's bound holds at its time and at all later times.
        - `order`: order of the derivative, >= 1.
        """


class ConstantPosture(AbstractSmoothMotion):
    """`q_d(t) = c`."""

    kind = "constant"
    title = "A fixed posture."

    value: Vector = parameter("c, the posture", "rad or m")

    @property
    def until(self) -> float:
        return 0.0

    def position(self, t: Scalar) -> Vector:
        return self.value + 0.0 * t * jnp.zeros_like(self.value)

    def derivative(self, t: Rows, order: int) -> Rows:
        return np.ones((len(t), 1)) * (np.asarray(self.value, float) if order == 0 else np.zeros(len(self.value)))

    def largest_derivative(self, since: Rows, order: int) -> Rows:
        return np.zeros((len(since), len(self.value)))


class Sinusoid(AbstractSmoothMotion):
    """`q_d(t) = c + a sin(ω t + φ)`, per joint, such as the reference motion of Example 4.2."""

    title = "A sinusoid per joint."

    offset: Vector = parameter("c, mean position", "rad or m")
    amplitude: PerJoint = parameter("a, amplitude", "rad or m")
    frequency: PerJoint = parameter("ω, angular frequency", "rad/s")
    phase: PerJoint = parameter("φ, phase at t = 0", "rad", default=0.0)

    def position(self, t: Scalar) -> Vector:
        return self.offset + self.amplitude * jnp.sin(self.frequency * t + self.phase)

    def derivative(self, t: Rows, order: int) -> Rows:
        offset, frequency, phase = (np.asarray(item, float) for item in (self.offset, self.frequency, self.phase))
        wave = np.sin(frequency * t[:, None] + (phase + 0.5 * np.pi * order))
        return (offset if order == 0 else 0.0 * offset) + np.asarray(self.amplitude) * frequency**order * wave

    def largest_derivative(self, since: Rows, order: int) -> Rows:
        size = np.abs(np.asarray(self.amplitude)) * np.abs(np.asarray(self.frequency)) ** order
        return np.broadcast_to(size, (len(since), len(self.offset)))


MOST_TERMS = 50
"""Largest number of terms in an `ExponentialSum`."""


class ExponentialSum(AbstractSmoothMotion):
    """`q_d(t) = c + Σ_k a_k exp(-λ_k t)`: a smooth move that comes to rest at c, as in Example 4.1."""

    title = "A sum of decaying exponentials."

    offset: Vector = parameter("c, final position", "rad or m")
    amplitudes: Float[Array, "k n"] = parameter("a_k, one row per term", "rad or m")
    rates: Float[Array, " k"] = parameter(
        "λ_k, decay rate of each term", "1/s", "> 0", "so that the motion comes to rest"
    )

    def __check_init__(self) -> None:
        if self.rates.size > MOST_TERMS:
            raise DefinitionError(f"`ExponentialSum.rates` must be at most {MOST_TERMS} rates; got {self.rates.size}")
        fits = self.amplitudes.ndim == 2 and self.amplitudes.shape == (*self.rates.shape, *self.offset.shape)
        if not fits:
            raise DefinitionError(
                "`ExponentialSum.amplitudes` must have one row per rate and one column per joint; "
                f"got shape {list(self.amplitudes.shape)}"
            )

    def position(self, t: Scalar) -> Vector:
        return self.offset + jnp.sum(self.amplitudes * jnp.exp(-self.rates * t)[:, None], axis=0)

    def derivative(self, t: Rows, order: int) -> Rows:
        rates, amplitudes = np.asarray(self.rates, float), np.asarray(self.amplitudes, float)
        terms = np.exp(-rates * t[:, None]) * (-rates) ** order @ amplitudes
        return terms + np.asarray(self.offset, float) if order == 0 else terms

    def largest_derivative(self, since: Rows, order: int) -> Rows:
        rates = np.asarray(self.rates, float)
        return np.asarray(np.exp(-rates * since[:, None]) * rates**order @ np.abs(np.asarray(self.amplitudes, float)))


NEGLIGIBLE = 1e-13
"""A polynomial's term that is smaller than this share of its largest term is due to rounding.

The search for extremes sets the coefficient of such a term to 0.
"""


class Extremes(NamedTuple):
    """Least and largest value of a quantity for each joint [n], and the times at which they occur [n], s."""

    least: NDArray[np.float64]
    largest: NDArray[np.float64]
    when_least: NDArray[np.float64]
    when_largest: NDArray[np.float64]

    @property
    def size(self) -> NDArray[np.float64]:
        """Largest absolute value of each joint [n]."""
        return np.maximum(-self.least, self.largest)


def derivative_coefficients(coefficients: NDArray[np.float64], order: int) -> NDArray[np.float64]:
    """Return the coefficients of the `order`-th derivative of polynomials, highest power first.

    - `coefficients`: highest power first, [powers pieces n]; at least one power remains.
    """
    for _ in range(order):
        degree = len(coefficients) - 1
        if degree == 0:
            return np.zeros_like(coefficients)
        coefficients = coefficients[:-1] * np.arange(degree, 0, -1)[:, None, None]
    return coefficients


def extremes(times: NDArray[np.float64], coefficients: NDArray[np.float64], order: int) -> Extremes:
    """Return the extremes of a piecewise polynomial's derivative between the first and the last knot.

    - `times`: knots [k], s.
    - `coefficients`: highest power first, [powers k-1 n].
    - `order`: order of the derivative; 0 for the polynomials themselves.
    """
    from scipy.interpolate import PPoly

    derivative = derivative_coefficients(coefficients, order)
    widths = np.diff(times)[:, None]
    ends = derivative[0]
    for power in derivative[1:]:
        ends = ends * widths + power
    slope = derivative_coefficients(derivative, 1)
    degrees = np.arange(len(slope) - 1, -1, -1)[:, None, None]
    share = np.abs(slope) * widths**degrees
    slope = np.where(share <= NEGLIGIBLE * share.max(axis=0), 0.0, slope)
    rows = []
    for joint in range(derivative.shape[2]):
        stationary = PPoly(slope[:, :, joint], times).roots(discontinuity=False, extrapolate=False)
        # SciPy returns NaN for a constant piece, whose ends are extremes.
        stationary = stationary[np.isfinite(stationary)]
        when = np.concatenate([times[:-1], times[1:], stationary])
        inside = PPoly(derivative[:, :, joint], times)(stationary)
        value = np.concatenate([derivative[-1, :, joint], ends[:, joint], inside])
        low, high = int(np.argmin(value)), int(np.argmax(value))
        rows.append((value[low], value[high], when[low], when[high]))
    return Extremes(*np.array(rows).T)


class AbstractPiecewisePolynomial(AbstractMotion):
    """One polynomial in time per joint between two knots, and rest before the first knot and after the last.

    If the acceleration jumps at a knot, the reference has the value after the jump. At the last knot this is the
    standstill. Subclasses ensure that position and velocity do not jump.
    """

    times: Float[Array, " knots"] = parameter("knots, increasing", "s")
    coefficients: Float[Array, "powers pieces n"] = parameter(
        "coefficients of each piece in powers of `t - times[i]`, highest first"
    )

    def __check_init__(self) -> None:
        name = type(self).__name__
        knots, shape = np.shape(self.times), np.shape(self.coefficients)
        if len(knots) != 1 or len(shape) != 3 or knots[0] != shape[1] + 1:
            raise DefinitionError(
                f"`{name}.coefficients` must be [powers pieces joints], with a piece from each knot to the next; "
                f"got shape {list(shape)} for {list(knots)} knots"
            )
        if not is_traced(self.times) and not np.all(np.diff(self.times) > 0):
            raise DefinitionError(f"`{name}.times` must increase")

    @property
    def until(self) -> Scalar:
        """The last knot [s]."""
        return self.times[-1]

    def position(self, t: Scalar) -> Vector:
        first, last = self.times[0], self.times[-1]
        # Not `clip`: at the first and last knot its derivative is 0.5, neither the motion's 1 nor the standstill's 0.
        t = jnp.where(t < first, first, jnp.where(t < last, t, last))
        pieces = self.coefficients.shape[1]
        piece = jnp.clip(jnp.searchsorted(self.times, t, side="right") - 1, 0, pieces - 1)
        coefficients = self.coefficients[:, piece]
        x = t - self.times[piece]
        value = coefficients[0]
        for coefficient in coefficients[1:]:
            value = value * x + coefficient
        return value

    def extremes(self, order: int) -> Extremes:
        """Return the exact extremes of a derivative of the position.

        - `order`: 0 for the position, 1 for the velocity, 2 for the acceleration, 3 for the jerk.
        """
        return extremes(np.asarray(self.times), np.asarray(self.coefficients), order)


class ToolMotion(AbstractPiecewisePolynomial):
    """A joint motion from `slidax.motions.follow`; for this type a simulation also records the tool's error."""
