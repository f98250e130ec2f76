"""Estimators: from measurements to the state and the disturbance ŵ, an acceleration that the model does not explain.

In the formulas a prime marks a measured value, `_predicted` the nominal model's prediction with the last ŵ, and ⁺ the
value after this sample. h is the time since the last measurement.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.core.errors import as_array
from slidax.core.parameter import parameter
from slidax.core.part import AbstractPart
from slidax.core.types import Memory, PerJoint, Scalar, State, Vector


class Estimate(eqx.Module):
    """Estimated state and disturbance at one sample.

    - `state`: estimated positions and velocities.
    - `disturbance`: ŵ, the estimated acceleration that the nominal model does not explain [n], rad/s² or m/s².
    """

    state: State
    disturbance: Vector


class AbstractEstimator(AbstractPart):
    """Correct the nominal model's prediction with a measurement.

    Call the estimator for each measurement that arrives; skip lost ones.
    """

    reads_velocity: ClassVar[bool] = False
    """True if measured velocities are used after the first sample."""

    @abstractmethod
    def init(self, measured: State) -> Memory:
        """Return the memory after the first measurement: any pytree of arrays, also an empty one.

        The first estimate is this measurement, with `disturbance = 0`.
        """

    @abstractmethod
    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: Memory
    ) -> tuple[Estimate, Memory]:
        """Return the estimate at the time of a measurement, and the memory after it, a tree like `memory`.

        - `measured`: measured positions and velocities.
        - `prior`: the last estimate, moved by the nominal model and its disturbance to the time of this measurement.
        - `elapsed`: time since the last measurement [s], > 0.
        - `missed`: True after lost samples or a restart of the law. The disturbance estimate then stays as it was: over
          a long time other errors add up to it.
        - `memory`: from `init`, or from the call at the last measurement.
        """

    def for_inertia(self, inertia: Vector) -> AbstractEstimator:
        """Return the estimator for joints of another inertia; `self` if the estimator does not depend on inertia.

        - `inertia`: inertia of each joint from `AbstractAdaptation.filter_inertia` [n], kg m² or kg.
        """
        return self

    def with_share(self, share: Scalar) -> AbstractEstimator:
        """Return the estimator for a weight of the learnt arm model; `self` if it does not depend on the weight.

        - `share`: weight of the learnt arm model in the model that the law uses, 0 to 1.
        """
        return self


def reset_position(
    measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, "..."], usual: Estimate
) -> Estimate:
    """Return an estimate that starts anew from the measured position if samples were missed; else `usual`.

    The new estimate has the measured position q', the velocity `q̇ + 2 (q' - q)/T`, and the predicted disturbance. The
    velocity is exact if the acceleration error was constant since the last measurement.

    - `measured`: measured positions q'; velocities are not used.
    - `prior`: prediction of q and q̇ at this measurement, and the last disturbance.
    - `elapsed`: T, time since the last measurement [s], > 0.
    - `missed`: True if samples were missed.
    - `usual`: the estimate without missed samples.
    """
    dq = prior.state.dq + 2.0 * (measured.q - prior.state.q) / elapsed
    return Estimate(
        state=State(
            q=jnp.where(missed, measured.q, usual.state.q),
            dq=jnp.where(missed, dq, usual.state.dq),
        ),
        disturbance=jnp.where(missed, prior.disturbance, usual.disturbance),
    )


WITH_TREND, WITHOUT_TREND = 1.0 / 6.0, 0.3
"""Largest default gains g for a delay of up to one period, and for longer ones. With the default horizon the linear
loop is then stable for believed inertias of 1/3 to 3/2 of the true one."""


class Measured(AbstractEstimator):
    """`q = q'`, `q̇ = q̇'`, and the disturbance from the velocity's prediction error by an α-β filter.

    With `r = (q̇' - q̇_predicted)/h`: `w⁺ = w + h d + g (r + ŵ - w - h d)`, `d⁺ = d + b (r + ŵ - w - h d)/h`,
    `ŵ⁺ = w⁺ + ahead h d⁺`. q' and q̇' are measured. w is the unexplained acceleration in the middle of the last period,
    d its rate, and g and b are the gains `gain` and `trend`. ŵ is extrapolated by `ahead` periods to the time when the
    next torque acts. A disturbance that grows steadily is thus compensated without a lag. For sensors that measure
    velocity accurately.
    """

    title = "Measured positions and velocities, and an α-β filter of the disturbance."

    reads_velocity: ClassVar[bool] = True

    gain: PerJoint = parameter(
        "g, gain of the disturbance; with trend 0 as well, 0 keeps it constant", "", "[0, 1]", default=WITHOUT_TREND
    )
    trend: PerJoint = parameter(
        "b, gain of the disturbance's rate; 0 for a first-order filter; `critical` computes b for critical damping",
        "",
        "[0, 4 - 2 * gain]",
        "so that the filter itself is stable (Jury)",
        default=0.0,
    )
    ahead: Scalar = parameter(
        "prediction time, from the middle of the last measured period to the middle of that in which the torque acts",
        "periods",
        ">= 0",
        default=0.0,
    )

    @classmethod
    def critical(cls, gain: Any, ahead: Any) -> Measured:
        """Return the critically damped filter, `b = 2 - g - 2 √(1 - g)`: both of its poles are `√(1 - g)`.

        - `gain`: g, one number or [n], in [0, 1].
        - `ahead`: prediction time in periods.

        Raises DefinitionError if an argument is out of its range.
        """
        gain = as_array(gain)
        return cls(gain, 2.0 - gain - 2.0 * jnp.sqrt(jnp.maximum(1.0 - gain, 0.0)), ahead)

    @classmethod
    def tolerant(cls, delay: float, most: Any = 1.0) -> Measured:
        """Return the default filter, for a joint whose inertia or drive torque may be far from nominal.

        Up to one period of delay the filter is `critical` with g = 1/6. For longer delays it has g = 0.3 and no
        extrapolation, since extrapolation over a longer delay makes the loop less tolerant to errors of the inertia.
        docs/learning.md lists the tolerated ratios of inertia.

        - `delay`: time from a measurement until its torque acts [periods].
        - `most`: upper limit of g.
        """
        if delay > 1.0:
            return cls(jnp.minimum(WITHOUT_TREND, most))
        return cls.critical(jnp.minimum(WITH_TREND, most), delay + 1.0)

    def init(self, measured: State) -> Vector:
        """Return the disturbance's rate d, zero at the start [n]."""
        return jnp.zeros_like(measured.q)

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: Vector
    ) -> tuple[Estimate, Vector]:
        """Return the measured state with the disturbance estimate, and the new rate d."""
        unexplained = (measured.dq - prior.state.dq) / elapsed
        grown = (1.0 - self.ahead) * elapsed * memory
        # w + h d, what the filter expected of this period, is `ŵ + (1 - ahead) h d`.
        surprise = unexplained - grown
        rate = memory + self.trend * surprise / elapsed
        disturbance = prior.disturbance + grown + self.gain * surprise + self.ahead * elapsed * rate
        return (
            Estimate(state=measured, disturbance=jnp.where(missed, prior.disturbance, disturbance)),
            jnp.where(missed, memory, rate),
        )


class FilteredDifference(AbstractEstimator):
    """`q = q'`, `q̇ = q̇_predicted + a d`, `ŵ⁺ = ŵ + g a² d/h`, with `a = 1 - e^{-c h}`.

    The model's velocity error is `d = (q' - q'₋)/h - (q̇_predicted + q̇₋)/2`, with the measured position q', and the
    last sample's measured position q'₋ and estimated velocity q̇₋. The filter is a complementary one: slow changes of
    the velocity come from the measured positions, fast changes from the model. It therefore lags only behind
    unmodelled motion. Measured velocities are not used.

    For `c h << 1` the error dynamics have the characteristic polynomial `λ² + c λ + g c²`. Its damping ratio is
    `1/(2 √g)`, critical for g = 1/4. The errors decay for all `c h` and `0 < g <= 1`.
    """

    title = "The velocity from differences of positions, filtered around the model's prediction."

    cutoff: PerJoint = parameter("c, cutoff of the velocity filter", "rad/s", "> 0")
    gain: PerJoint = parameter(
        "g, gain of the disturbance; 0 keeps it constant", "", "[0, 1]", default=0.25, source="critical damping"
    )

    def init(self, measured: State) -> State:
        """Return the memory: the last measured position and estimated velocity, at the start the measured state."""
        return measured

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: State
    ) -> tuple[Estimate, State]:
        """Return measured positions, filtered velocities and the disturbance, and the memory for the next sample."""
        share = -jnp.expm1(-self.cutoff * elapsed)
        correction = share * ((measured.q - memory.q) / elapsed - 0.5 * (prior.state.dq + memory.dq))
        usual = Estimate(
            state=State(q=measured.q, dq=prior.state.dq + correction),
            disturbance=prior.disturbance + self.gain * share * correction / elapsed,
        )
        # A gap does not affect the mean velocity; the disturbance over it is not known.
        estimate = Estimate(state=usual.state, disturbance=jnp.where(missed, prior.disturbance, usual.disturbance))
        return estimate, estimate.state


# Levant (2003) with (1.1, 1.5, 2) in the recursive form: λ0 = 2, λ1 = 1.5 √2, λ2 = 1.1 in the one below.
GAINS = (2.0, 2.12, 1.1)
NEWTON_STEPS = 5


class RobustDifferentiator(AbstractEstimator):
    """`σ̇0 = σ1 - λ0 L^⅓ sig^⅔(σ0)`, `σ̇1 = σ2 - λ1 L^⅔ sig^⅓(σ0)`, `σ̇2 ∈ dw/dt - λ2 L Sgn(σ0)`, implicit in time.

    σ0, σ1, σ2 are true minus estimated position, velocity and disturbance, and w is the true disturbance. The errors
    reach zero in finite time if `|dw/dt| <= L`. `λ0 = 2`, `λ1 = 2.12`, `λ2 = 1.1`, and `sig^a(x) = |x|^a sgn(x)`.
    Measured velocities are not used.

    With the measured position q', an implicit Euler step has `r = q' - q_predicted`, `R = |r|/(L h³)` and the unknown
    y, which gives the remaining position error `σ0 = L h³ y³ sgn(r)`. y solves `y³ + λ0 y² + λ1 y + λ2 s = R`, where
    `s = min(R/λ2, 1)` is selected from the set-valued sign. Then `q = q' - σ0`, `ŵ⁺ = ŵ + L h λ2 s sgn(r)`, and
    `q̇ = q̇_predicted + L h² (λ1 y + 3/2 λ2 s) sgn(r)`. While `R <= λ2`, y is 0, and the estimation error vanishes
    within three samples without chattering. The Euler step has the factor 1 in place of 3/2, and its velocity lags by
    half a period. The added 1/2 removes this lag (Seeber): a motion with a constant disturbance is estimated exactly.

    Source: Levant, Higher-order sliding modes, differentiation and output-feedback control, 2003; implicit in time:
    Acary, Brogliato, Orlov, 2012, and Mojallizadeh, Brogliato, Acary, 2021; without bias: Seeber, Proper implicit
    discretization of arbitrary-order robust exact differentiators, 2024.
    """

    title = "Levant's second-order differentiator, implicit in time, around the model's prediction."

    lipschitz: PerJoint = parameter("L, largest rate of the disturbance", "rad/s³ or m/s³", "> 0", "(L, Levant, 2003)")

    def init(self, measured: State) -> tuple[()]:
        return ()

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: tuple[()]
    ) -> tuple[Estimate, tuple[()]]:
        """Return the estimate; its position is the measured one unless no disturbance explains the residual."""
        residual = measured.q - prior.state.q
        sign = jnp.sign(residual)
        # The bounds are out of reach of any arm; they keep the quotient finite for all numbers.
        scale = jnp.maximum(self.lipschitz * elapsed * elapsed * elapsed, 1e-290)
        ratio = jnp.minimum(jnp.abs(residual), 1e290 * scale) / scale
        _, l1, l2 = GAINS
        y = _root(jnp.maximum(ratio - l2, 0.0))
        selection = jnp.minimum(ratio, l2)
        signed = sign * scale
        usual = Estimate(
            state=State(
                q=measured.q - signed * y * y * y,
                dq=prior.state.dq + signed * (l1 * y + 1.5 * selection) / elapsed,
            ),
            disturbance=prior.disturbance + signed * selection / elapsed / elapsed,
        )
        # A step over a gap has an exact state; the disturbance is not updated from it.
        return Estimate(state=usual.state, disturbance=jnp.where(missed, prior.disturbance, usual.disturbance)), ()


def _root(rest: Vector) -> Vector:
    """Return the y >= 0 with `y³ + λ0 y² + λ1 y = rest`, for `rest >= 0`.

    The left side is increasing and convex, so Newton's steps from above never pass the root. Each of the three terms
    alone would give a larger y; the least of these is at most 1.75 times the root.
    """
    l0, l1, _ = GAINS
    outside = rest > 0
    safe = jnp.where(outside, rest, 1.0)
    y = jnp.minimum(jnp.minimum(jnp.cbrt(safe), jnp.sqrt(safe / l0)), safe / l1)
    for _ in range(NEWTON_STEPS):
        # This form computes the next y itself, not a correction of the last one: no digits cancel.
        y = (y * y * (2.0 * y + l0) + safe) / (y * (3.0 * y + 2.0 * l0) + l1)
    return jnp.where(outside, y, 0.0)
