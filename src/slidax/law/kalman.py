"""Steady-state Kalman filters of each joint, from measured positions, and a filter whose bandwidth grows."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from slidax.core.errors import DefinitionError, as_array, is_traced
from slidax.core.parameter import parameter, piece
from slidax.core.types import Scalar, State, Vector

from .estimators import AbstractEstimator, Estimate, reset_position

# Enough for a filter that takes 1e8 periods to settle.
DOUBLINGS = 32

Three = Float[Array, "3 3"]


def steady_gains(density: Any, variance: Any, period: Any) -> Float[Array, "..."]:
    """Return the gains L1, L2 [1/s], L3 [1/s²] of a steady-state Kalman filter, [3] or [3 n].

    The model is `q⃛ = w` with white noise w. The measurement is one position in each period h. L1, L2 h and L3 h²
    depend on `density h⁵/variance` alone.

    - `density`: spectral density of w, one number or [n], (rad/s³)² s or (m/s³)² s, > 0.
    - `variance`: variance of the measured position, one number or [n], rad² or m², > 0.
    - `period`: h [s], > 0.

    Raises DefinitionError if an argument is out of its range.
    """
    values = [as_array(value) for value in (density, variance, period)]
    for name, value, unit in zip(("density", "variance", "period"), values, ("rad²/s⁵", "rad²", "s"), strict=True):
        if not is_traced(value) and not np.all((np.asarray(value) > 0) & np.isfinite(value)):
            raise DefinitionError(f"`{name}` of a Kalman filter must be > 0 {unit} and finite; got {value}")
    spread, noise, h = jnp.broadcast_arrays(*values)
    return _steady(spread, noise, h)


# Jitted as a whole: JAX would otherwise compile each operation separately, which takes a second.
@jax.jit
def _steady(spread: Any, noise: Any, h: Any) -> Any:
    # No arm reaches the ends of this range; they keep the matrices regular.
    ratio = jnp.clip(spread / noise * h * h * h * h * h, 1e-42, 1e24)
    gains = jax.vmap(_gains)(ratio.reshape(-1)).T.reshape(3, *ratio.shape)
    return gains / jnp.stack([jnp.ones_like(h), h, h * h])


def _gains(ratio: Scalar) -> Float[Array, "3"]:
    """Return the gains for a period of 1 and a variance of 1.

    The unit of time is about the settling time of the filter, so that the matrices are well conditioned for a slow
    filter, too. One period is then `d = ratio^(1/6)`, or 1 for a fast filter.
    """
    d = jnp.minimum(ratio ** (1.0 / 6.0), 1.0)
    unit, nil = jnp.ones_like(d), jnp.zeros_like(d)
    moved = _matrix([unit, d, 0.5 * d * d], [nil, unit, d], [nil, nil, unit])
    d2, d3 = d * d, d * d * d
    drift = _matrix([d2 * d3 / 20, d2 * d2 / 8, d3 / 6], [d2 * d2 / 8, d3 / 3, d2 / 2], [d3 / 6, d2 / 2, d])
    covariance = _steady_covariance(moved, drift * (ratio / (d2 * d3)))
    return covariance[0] / (covariance[0, 0] + 1.0) * jnp.stack([unit, d, d2])


def _steady_covariance(f: Three, q: Three) -> Three:
    """Return the steady covariance P of the prediction: `P = F (P - P hᵀ h P/(h P hᵀ + 1)) Fᵀ + Q`, `h = (1, 0, 0)`.

    Uses the doubling algorithm: each step doubles the number of samples, so that convergence is quadratic (Anderson
    1978; Chu, Fan, Lin and Wang, 2004).
    """
    measured = _matrix([1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    return jax.lax.fori_loop(0, DOUBLINGS, _twice, (f.T, measured, q))[2]


# Jitted on its own: within a caller, JAX would compile the loop again for each new caller.
def _twice(_: Any, agh: tuple[Three, Three, Three]) -> tuple[Three, Three, Three]:
    a, g, h = agh
    solved = _product(_inverse(jnp.eye(3) + _product(g, h)), jnp.concatenate([a, _product(g, a.T)], axis=1))
    onward, back = solved[:, :3], solved[:, 3:]
    return (
        _product(a, onward),
        _symmetric(g + _product(a, back)),
        _symmetric(h + _product(_product(a.T, h), onward)),
    )


def _matrix(*rows: list[Any]) -> Three:
    return jnp.stack([jnp.stack([jnp.asarray(entry, float) for entry in row]) for row in rows])


def _product(a: Three, b: Float[Array, "3 m"]) -> Float[Array, "3 m"]:
    return jnp.sum(a[:, :, None] * b[None, :, :], axis=1)


def _symmetric(a: Three) -> Three:
    return 0.5 * (a + a.T)


def _inverse(a: Three) -> Three:
    """Return the inverse by cofactors, the cross products of the rows."""
    cofactors = jnp.stack([jnp.cross(a[1], a[2]), jnp.cross(a[2], a[0]), jnp.cross(a[0], a[1])])
    return cofactors.T / jnp.sum(a[0] * cofactors[0])


TORQUE_DENSITY = 0.05
"""Default spectral density of a disturbance torque's drift, (N m/s)² s: 0.2 N m (standard deviation) in one second."""

FASTEST_PACE = 1.0
"""d, bandwidth times period, of the fastest default filter. With a faster filter a delayed loop tolerates only a small
error of the inertia (docs/learning.md)."""


class Kalman(AbstractEstimator):
    """`q = q_predicted + L1 r`, `q̇ = q̇_predicted + L2 r`, `ŵ⁺ = ŵ + L3 r`, with `r = q' - q_predicted`.

    q' is the measured position, ŵ the estimated disturbance, an acceleration. Measured velocities are not used. If no
    sample arrives for longer than 2/L2, the filter's memory, the next sample starts it anew (`reset_position`).
    """

    gains: Float[Array, "3 ..."] = parameter(
        "L1, L2, L3, three numbers or three per joint; `steady` and `of_arm` compute them", "1, 1/s or 1/s²", ">= 0"
    )

    inertia: Vector | None = parameter(
        "inertia for which the gains hold, if they follow the learnt inertia", "kg m² or kg", "> 0", default=None
    )
    pace: Vector | None = parameter(
        "d, the filter's bandwidth at that inertia times the period, (density h⁵/variance)^(1/6)",
        "",
        "> 0",
        default=None,
    )

    def __check_init__(self) -> None:
        shape = self.gains.shape
        if len(shape) not in (1, 2) or shape[0] != 3:
            raise DefinitionError(f"`Kalman.gains` must be three numbers or three per joint; got shape {list(shape)}")

    @classmethod
    def steady(cls, *, density: Any, variance: Any, period: Any) -> Kalman:
        """Return the steady-state filter for a disturbance acceleration that drifts as a random walk.

        - `density`: spectral density of the disturbance's rate, one number or [n], (rad/s³)² s or (m/s³)² s, > 0. The
          disturbance's drift in a time t has the standard deviation `√(density t)`.
        - `variance`: variance of a measured position, one number or [n], rad² or m², > 0; `r²/12` for a resolution r.
        - `period`: time between two samples [s], > 0.

        Raises DefinitionError if an argument is out of its range.
        """
        return cls(steady_gains(density, variance, period))

    @classmethod
    def of_arm(
        cls, mass: Any, *, variance: Any, period: Any, torque_density: Any = TORQUE_DENSITY, fastest: Any = None
    ) -> Kalman:
        """Return the steady-state filter for a disturbance torque τ_d that drifts as a random walk.

        Each joint's gains follow from its own inertia. The gains can be batched and differentiated with respect to
        every argument: construct the filter inside `vmap` or `grad`.

        - `mass`: inertia matrix of the nominal arm at a working posture [n n], kg m², kg m, kg.
        - `variance`: variance of a measured position, one number or [n], rad² or m², > 0; `r²/12` for a resolution r.
        - `period`: time between two samples [s], > 0.
        - `torque_density`: spectral density of dτ_d/dt, one number or [n], (N m/s)² s, > 0. docs/loop-rate.md shows
          its effect.
        - `fastest`: largest d, bandwidth times period; None for no limit. For a joint whose filter would be faster,
          `variance` is raised until its filter keeps the limit.

        Raises DefinitionError if an argument is out of its range.
        """
        torque_density = as_array(torque_density)
        if not is_traced(torque_density) and not np.all((np.asarray(torque_density) > 0) & np.isfinite(torque_density)):
            raise DefinitionError(
                f"`torque_density` of a Kalman filter must be > 0 (N m/s)² s and finite; got {torque_density}"
            )
        inertia, density, pace = _paces(*(as_array(value) for value in (mass, torque_density, variance, period)))
        if fastest is not None:
            variance = jnp.maximum(as_array(variance), density * as_array(period) ** 5 / as_array(fastest) ** 6)
            pace = jnp.minimum(pace, fastest)
        return cls(steady_gains(density, variance, period), inertia, pace)

    def for_inertia(self, inertia: Vector) -> Kalman:
        """Return the filter for joints of another inertia Î; `self` if it was constructed without an inertia I.

        The filter assumes a disturbance torque whose rate is white noise. The noise density of the acceleration is
        that of the torque over Î². The pace d, bandwidth times period, is proportional to the density's sixth root and
        becomes `d (I/Î)^(1/3)`. Each gain is multiplied by the ratio of the gains of `paced` for the new and the old d:
        for a slow filter L1, L2, L3 by `(I/Î)^(1/3)`, its square and its cube, and hardly for a fast one.
        """
        if self.inertia is None or self.pace is None:
            return self
        ratio = jnp.exp(jnp.log(self.inertia / inertia) * (1.0 / 3.0))
        gains = self.gains * (paced(self.pace * ratio) / paced(self.pace))
        return Kalman(gains, inertia, self.pace * ratio)

    def init(self, measured: State) -> tuple[()]:
        return ()

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: tuple[()]
    ) -> tuple[Estimate, tuple[()]]:
        """Return the prediction, corrected in proportion to the residual."""
        residual = measured.q - prior.state.q
        usual = Estimate(
            state=State(
                q=prior.state.q + self.gains[0] * residual,
                dq=prior.state.dq + self.gains[1] * residual,
            ),
            disturbance=prior.disturbance + self.gains[2] * residual,
        )
        # After a gap that is shorter than the filter's memory, the filter's state is still valid.
        forgotten = missed & (self.gains[1] * elapsed > 2.0)
        return reset_position(measured, prior, elapsed, forgotten, usual), ()


SURPRISE = 4.0
"""Smallest innovation, over the standard deviation of a measured position, that makes the bandwidth grow."""

ALERT_TIME = 0.015
"""s: time constant with which the bandwidth falls again."""

BUDGET, REST = 0.02, 0.3
"""s: time for which a bandwidth may be doubled, and the time constant with which past growth is forgotten."""

FASTEST_GROWN = 0.3
"""Largest d, bandwidth times period, to which a bandwidth may grow."""


class TrackingMemory(eqx.Module):
    """Memory of `StrongTracking`, with the factor p of the bandwidth.

    - `growth`: p - 1, before it is reduced by the model's weight and by fading [n].
    - `trail`: decaying sum of the earlier innovations, over σ [n].
    - `spent`: integral of p - 1 over time, which decays in 0.3 s [n], s.
    """

    growth: Vector
    trail: Vector
    spent: Vector


class StrongTracking(AbstractEstimator):
    """A Kalman filter whose bandwidth grows while its innovations are larger than noise explains.

    With the sample time h, a filter of the bandwidth d/h gets the bandwidth p d/h, where p d is at most 0.3. For each
    joint, with the last value p₋ and T = 15 ms,

        p = max(min(x - 3, growth), 1 + (p₋ - 1) e^{-h/T}).

    So p grows once x exceeds 4 and falls back with the time constant T. x is the magnitude of the innovation
    `(q' - q_predicted)/σ`, or of the decaying sum of earlier innovations if that is smaller; it is 0 if their signs
    differ. A single wrong measurement has no effect: the innovations after it have the other sign. A sudden disturbance
    is estimated in about half the time. The noise of the undisturbed loop is unchanged.

    A faster filter tolerates less overestimation of the inertia. p - 1 is therefore multiplied by `share`, the weight
    of a learnt arm model in the law's model. p - 1 fades to 0 once the bandwidth has been doubled for 20 to 40 ms, so
    that an oscillation cannot keep the bandwidth high.

    Source: Zhou and Frank, Strong tracking filtering of nonlinear time-varying stochastic systems, 1996; here the
    bandwidth grows, since the gains are fixed.
    """

    title = "A Kalman filter that becomes faster while its innovations are large."

    filter: Kalman = piece("the filter without growth, from `Kalman.of_arm`")
    deviation: Vector = parameter("σ, standard deviation of a measured position", "rad or m", "> 0")
    growth: Scalar = parameter("largest factor of the bandwidth", "", ">= 1", default=2.0)
    share: Scalar = parameter("share of the growth that is allowed", "", "[0, 1]", default=1.0)

    def __check_init__(self) -> None:
        if self.filter.pace is None:
            raise DefinitionError(
                "`StrongTracking.filter` needs a pace, since its bandwidth grows: construct it by `Kalman.of_arm`"
            )

    def for_inertia(self, inertia: Vector) -> StrongTracking:
        return replace(self, filter=self.filter.for_inertia(inertia))

    def with_share(self, share: Scalar) -> StrongTracking:
        return replace(self, share=share)

    def init(self, measured: State) -> TrackingMemory:
        zero = jnp.zeros_like(measured.q)
        return TrackingMemory(growth=zero, trail=zero, spent=zero)

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: TrackingMemory
    ) -> tuple[Estimate, TrackingMemory]:
        pace = self.filter.pace
        assert pace is not None
        innovation = (measured.q - prior.state.q) / self.deviation
        fade = jnp.exp(-elapsed / ALERT_TIME)
        trail = fade * memory.trail
        both = jnp.minimum(jnp.abs(innovation), jnp.sign(innovation) * trail)
        wanted = jnp.clip(both - SURPRISE, 0.0, self.growth - 1.0)
        beyond = jnp.maximum(wanted, memory.growth * fade)
        room = self.share * jnp.clip(2.0 - memory.spent / BUDGET, 0.0, 1.0)
        spent = memory.spent * jnp.exp(-elapsed / REST) + elapsed * beyond
        grown = jnp.maximum(jnp.minimum((1.0 + room * beyond) * pace, FASTEST_GROWN), pace)
        gains = jax.lax.cond(
            jnp.any(grown > pace),
            lambda: self.filter.gains * (paced(grown) / paced(pace)),
            lambda: self.filter.gains,
        )
        estimate, _ = Kalman(gains)(measured, prior, elapsed, missed, ())
        return estimate, TrackingMemory(beyond, trail + innovation, spent)


def paced(pace: Vector) -> Float[Array, "3 n"]:
    """Return the gains `L1, L2 h, L3 h²` of a filter with the bandwidth d/h, [3 n].

    Its errors have the poles `e^{-d}` and `e^{-d (1 ± i √3)/2}`, those of a slow steady filter (Butterworth's). Its
    characteristic polynomial is
    `z³ + (L1 + L2 h + L3 h²/2 - 3) z² + (3 - 2 L1 - L2 h + L3 h²/2) z + L1 - 1`.

    - `pace`: d, bandwidth times period [n].
    """
    real, half = jnp.exp(-pace), jnp.exp(-0.5 * pace)
    turn = (0.5 * math.sqrt(3.0)) * pace
    pair = 2.0 * half * jnp.cos(turn)
    first = 1.0 - real * real
    # (1 - z1)(1 - z2)(1 - z3), without a difference of numbers that are nearly equal.
    away = jnp.square(jnp.expm1(-0.5 * pace)) + 4.0 * half * jnp.square(jnp.sin(0.5 * turn))
    third = -jnp.expm1(-pace) * away
    return jnp.stack([first, 3.0 - first - 0.5 * third - real - pair, third])


# Jitted as a whole: JAX would otherwise compile each operation separately.
@jax.jit
def _paces(mass: Any, torque_density: Any, variance: Any, period: Any) -> tuple[Any, Any, Any]:
    """Return the diagonal of the inertia, the density of the disturbance's acceleration, and d, [n] each."""
    inertia = jnp.diagonal(mass)
    density = torque_density / (inertia * inertia)
    return inertia, density, jnp.clip(density / variance * period**5, 1e-18, 1e18) ** (1.0 / 6.0)
