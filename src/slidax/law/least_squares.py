"""Recursive least squares for the parameters θ of an arm, from smooth windows over the samples.

A window is a weighted sum over successive samples. It yields one equation `y = aᵀθ` for each joint. The innovation of
an equation is `y - aᵀθ`. A covariance P is stored packed: its lower triangle, row by row.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import NDArray

from slidax.core.types import Scalar, Vector

TINY = 1e-30
"""Keeps a quotient finite where the covariance is 0."""

QUARTERS = 4
"""Number of overlapping windows: each begins a quarter of its length after the one before."""


class Equations(eqx.Module):
    """One linear equation `y = aᵀθ` for each joint, from one window; θ are the parameters of the arm (`ArmParameters`).

    A window is loud for a model if a joint's innovation is far above its usual size (`model_trust.LOUD`).

    - `inertial`: derivative of each joint's torque with respect to the b parameters of payload and links [n b].
    - `drives`: derivative of each joint's torque with respect to its own k other parameters [k n].
    - `y`: torque that the nominal arm does not explain [n], N m or N.
    - `inertia`, `nominal`: derivative of M_ii with respect to payload and link factors [b], and M_ii of the nominal
      arm, for the joint i = `Estimates.turn`.
    - `weights`: weight of each equation, the usual variance of its noise over the assumed one [n]; 0 if it is not used.
    - `valid`: True for a window without lost samples.
    - `loud`: True if the window is loud for the learnt model, and for the last good model [2].
    - `fits`: True if the loss of a share of the payload explains the window.
    - `lost`: the lost share, if it explains this loud window, and a loss also explained the previous one; otherwise 0.
    - `left`: innovation that remains with the lost share [n], N m or N.
    """

    inertial: Float[Array, "n b"]
    drives: Float[Array, "k n"]
    y: Vector
    inertia: Float[Array, " b"]
    nominal: Scalar
    weights: Vector
    valid: Bool[Array, ""]
    loud: Bool[Array, "2"]
    fits: Bool[Array, ""]
    lost: Scalar
    left: Vector

    # Traced once, and a function in exported C.
    @jax.jit
    def row(self, joint: Int[Array, ""]) -> Float[Array, " p"]:
        """Return the coefficients a of one joint's equation [p]; `joint`: its index."""
        own = jnp.where(jnp.arange(self.y.size) == joint, self.drives, 0.0)
        return jnp.concatenate([self.inertial[joint], own.reshape(-1)])

    def explained(self, parameters: Float[Array, " p"]) -> Vector:
        """Return the torque `aᵀθ` of each joint for the parameters θ [n], N m or N."""
        inertial = self.inertial.shape[1]
        drives = parameters[inertial:].reshape(self.drives.shape)
        return jnp.sum(self.inertial * parameters[:inertial], axis=1) + jnp.sum(self.drives * drives, axis=0)


class Estimates(eqx.Module):
    """Estimated parameters of the arm, in the order of `ArmParameters.of`.

    - `parameters`: estimate of the parameters θ [p].
    - `covariance`: their covariance P, packed [c].
    - `used`: parameters that the law uses, smoothed and physically consistent [p].
    - `good`: parameters of the last good model, as `model_trust` defines it [p].
    - `deviation`: standard deviation of each parameter [p].
    - `inertia_deviation`: standard deviation of each M_ii over M_ii [n].
    - `turn`: index of the joint whose `inertia_deviation` is computed next.
    """

    parameters: Float[Array, " p"]
    covariance: Float[Array, " c"]
    used: Float[Array, " p"]
    good: Float[Array, " p"]
    deviation: Float[Array, " p"]
    inertia_deviation: Vector
    turn: Scalar


class Window(eqx.Module):
    """Motion and torque in the middle of a window, smoothed by its weights.

    - `q`, `dq`, `ddq`: position and its two derivatives [n].
    - `tau`: torque [n], N m or N.
    - `first`, `second`: means of `tanh(q̇/v_1)` and `tanh(q̇/v_2)`, for the speeds `FRICTION_SPEEDS` [n].
    - `more`: means of further torque shapes (`TorqueShapes`), [n] each.
    """

    q: Vector
    dq: Vector
    ddq: Vector
    tau: Vector
    first: Vector
    second: Vector
    more: list[Vector]

    @classmethod
    def of(cls, sums: Float[Array, "4 k n"]) -> Window:
        """Return the oldest of the four windows; `sums`: from `window_sums`, after this window's last sample."""
        q, dq, ddq, tau, first, second, *more = sums[-1]
        return cls(q, dq, ddq, tau, first, second, more)


KINDS = 6
"""Number of sums in a window: q with three kernels, torque, and two shapes of friction. Further shapes follow them."""


NOISE = 0.02
"""N m or N: least standard deviation of a window's torque."""


def window_noise(inertia_matrix: Any, deviation: Any, samples: int, period: float) -> NDArray[np.float64]:
    """Return the standard deviation of a window's torque [n], N m or N: from the encoders' noise, at least `NOISE`.

    By the second derivative of the window's weights, white position noise causes an acceleration noise with the
    standard deviation `σ (2π/T)² (4/3) √(h/T)`.

    - `inertia_matrix`: M of the nominal arm at a working posture [n n].
    - `deviation`: σ, standard deviation of a measured position, one number or [n], rad or m.
    - `samples`: m, samples between two windows; `T = 4 m h` is a window's length.
    - `period`: h [s].
    """
    duration = QUARTERS * samples * period
    acceleration = np.asarray(deviation, float) * (2.0 * np.pi / duration) ** 2 * 4.0 / 3.0 * np.sqrt(period / duration)
    return np.maximum(NOISE, np.diagonal(np.asarray(inertia_matrix, float)) * acceleration)


def next_windows(sums: Float[Array, "4 k n"]) -> Float[Array, "4 k n"]:
    """Return the sums without the oldest window, and with a new one of zeros in front."""
    return jnp.concatenate([jnp.zeros_like(sums[:1]), sums[:-1]])


def window_sums(
    sums: Float[Array, "4 k n"],
    slot: Scalar,
    samples: int,
    period: Scalar,
    q: Vector,
    tau: Vector,
    *shapes: Vector,
) -> Float[Array, "4 k n"]:
    """Return the k weighted sums of the four overlapping windows after a sample, the youngest window first.

    A window has N = 4 `samples` periods and the weights `w(s) ∝ cos⁴(π s/T)`, T = N h, at the time s from its middle.
    Sums of q with w, -w' and w'' are position, velocity and acceleration in its middle, without a lag. For the torque
    w is taken half a period earlier, since a torque is held over the period before its sample.

    - `sums`: the sums before this sample.
    - `slot`: number of this sample in its quarter of a window, 0 .. `samples` - 1.
    - `samples`, `period`: number of samples in a quarter of a window, and h [s].
    - `q`: measured positions at this sample [n], rad or m.
    - `tau`: mean torque in the period before this sample [n].
    - `shapes`: torques for coefficients of 1 (`friction_shapes`, `TorqueShapes.of`) at this sample, [n] each.
    """
    size = QUARTERS * samples
    rate, scale = _scales(samples)
    phase = (2.0 * np.pi / size) * (slot + 0.5)
    cosine, sine = _quarters(phase)
    cosine_before, _ = _quarters(phase - np.pi / size)
    falling = 1.0 - cosine
    w = falling * falling / (1.5 * size)
    slope = rate / period * (falling * sine)
    curve = scale / (period * period) * (sine * sine + falling * cosine)
    held = (1.0 - cosine_before) ** 2 / (1.5 * size)
    weights = jnp.stack([w, slope, curve, held, *[w] * len(shapes)], axis=1)
    signals = jnp.stack([q, q, q, tau, *shapes])
    return sums + weights[:, :, None] * signals[None]


def _quarters(phase: Scalar) -> tuple[Float[Array, "4"], Float[Array, "4"]]:
    """Cosine and sine of a phase and of those that are one, two and three quarters further."""
    c, s = jnp.cos(phase), jnp.sin(phase)
    return jnp.stack([c, -s, -c, s]), jnp.stack([s, c, -s, -c])


@cache
def _scales(samples: int) -> tuple[float, float]:
    """Factors of the kernels of velocity and acceleration, so that `s` and `s²/2` have the derivatives 1 (h = 1)."""
    size = QUARTERS * samples
    s = np.arange(size) + 0.5 - 0.5 * size
    phase = 2.0 * np.pi * (np.arange(size) + 0.5) / size
    falling = 1.0 - np.cos(phase)
    slope, curve = falling * np.sin(phase), np.sin(phase) ** 2 + falling * np.cos(phase)
    return 1.0 / float(np.sum(slope * s)), 2.0 / float(np.sum(curve * s * s))


def diagonal_covariance(variances: Float[Array, " p"]) -> Float[Array, " c"]:
    """Return the packed covariance of independent parameters with these variances, [c]."""
    rows, columns, _ = places(variances.size)
    return jnp.where(rows == columns, variances[rows], 0.0)


def standard_deviations(covariance: Float[Array, " c"], size: int) -> Float[Array, " p"]:
    """Return the standard deviation of each of `size` parameters from their packed covariance."""
    return jnp.sqrt(jnp.maximum(covariance[np.diagonal(places(size)[2])], 0.0))


@cache
def places(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return row and column of each packed entry [c], and the packed index of each entry of the matrix [p p]."""
    rows, columns = np.tril_indices(size)
    place = np.empty((size, size), int)
    place[rows, columns] = place[columns, rows] = np.arange(rows.size)
    return rows, columns, place


# Traced once, and a function in exported C.
@jax.jit
def measured_once(
    parameters: Float[Array, " p"], covariance: Float[Array, " c"], row: Float[Array, " p"], y: Scalar, variance: Scalar
) -> tuple[Float[Array, " p"], Float[Array, " c"]]:
    """Return the estimate θ⁺ and its packed covariance P⁺ after one scalar measurement `y = aᵀθ + noise`.

    `S = aᵀP a + r²`, `θ⁺ = θ + P a (y - aᵀθ)/S`, `P⁺ = P - P a aᵀP/S`.

    - `parameters`, `covariance`: estimate θ, and its packed covariance P, before the measurement.
    - `row`: coefficients a.
    - `variance`: variance r² of the noise.
    """
    rows, columns, _ = places(parameters.size)
    image = _image(covariance, row)
    spread = jnp.sum(row * image) + variance
    gain = image / spread
    missed = y - jnp.sum(row * parameters)
    return parameters + gain * missed, covariance - gain[rows] * image[columns]


def moved_along(
    parameters: Float[Array, " p"], covariance: Float[Array, " c"], row: Float[Array, " p"], missing: Scalar
) -> Float[Array, " p"]:
    """Return the most likely parameters whose `aᵀθ` is larger by `missing`: `θ⁺ = θ + P a missing/(aᵀP a)`.

    The step satisfies a constraint with the least contradiction to the measurements. Clipping a parameter would not.

    - `parameters`, `covariance`: estimate θ, and its packed covariance P.
    - `row`: coefficients a.
    """
    image = _image(covariance, row)
    return parameters + image * (missing / jnp.maximum(jnp.sum(row * image), TINY))


def quadratic_form(covariance: Float[Array, " c"], row: Float[Array, " p"]) -> Scalar:
    """Return `aᵀP a`, the variance of `aᵀθ`; `covariance`: P, packed; `row`: coefficients a."""
    return jnp.sum(row * _image(covariance, row))


# Traced once, and a function in exported C.
@jax.jit
def _image(covariance: Float[Array, " c"], row: Float[Array, " p"]) -> Float[Array, " p"]:
    """P a."""
    return jnp.sum(covariance[places(row.size)[2]] * row[None, :], axis=1)


def with_drift(
    covariance: Float[Array, " c"], drift: Float[Array, " p"], largest: Float[Array, " p"]
) -> Float[Array, " c"]:
    """Return the packed covariance [c] with larger variances.

    - `drift`: increase of each variance [p].
    - `largest`: largest variances [p]; rows and columns are scaled to keep them.
    """
    size = drift.size
    rows, columns, place = places(size)
    at = np.diagonal(place)
    grown = covariance.at[at].add(drift)
    keep = jnp.minimum(1.0, jnp.sqrt(largest / grown[at]))
    return grown * keep[rows] * keep[columns]
