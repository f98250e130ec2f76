"""Base class of the estimators, and the estimate."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.parts import AbstractPart, Memory, Scalar, State, Vector


class Estimate(eqx.Module):
    """Estimated state and unmodelled acceleration at one sample.

    - `state`: estimated positions and velocities.
    - `push`: estimated acceleration that the nominal model does not explain [n], rad/s² or m/s².
    """

    state: State
    push: Vector


class AbstractEstimator(AbstractPart):
    """Corrects the nominal model's prediction with a measurement.

    Call the estimator at each measurement that arrives, and not at a lost one.
    """

    reads_velocity: ClassVar[bool] = False
    """True if measured velocities are used after the first sample."""

    @abstractmethod
    def init(self, measured: State) -> Memory:
        """Estimator state after the first measurement: any pytree of arrays, also an empty one.

        The first estimate is that measurement, with `push = 0`.

        - `measured`: the first measurement.
        """

    @abstractmethod
    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: Memory
    ) -> tuple[Estimate, Memory]:
        """The estimate at the time of a measurement, and the memory after it, a tree like `memory`.

        - `measured`: measured positions and velocities.
        - `prior`: the last estimate, moved by the nominal model and with its push to the time of this measurement.
        - `elapsed`: time since the last measurement [s], > 0.
        - `missed`: True if that is more than one period. The push then stays as it was, because other errors add up to
          it over a long time.
        - `memory`: what `init` returned, or the call at the last measurement.
        """

    def for_inertia(self, inertia: Vector) -> AbstractEstimator:
        """Return the estimator for joints of another inertia; `self` if the estimator does not depend on inertia.

        - `inertia`: the diagonal of M̂ [n], kg m² or kg.
        """
        return self


def reseated(
    measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, "..."], usual: Estimate
) -> Estimate:
    """After missed samples, the measured position, `q̇ + 2 (q' - q)/T`, and the previous push; else `usual`.

    The velocity is exact if the acceleration error was constant since the last measurement.

    - `measured`: measured positions; velocities are not used.
    - `prior`: q and q̇, the prediction.
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
        push=jnp.where(missed, prior.push, usual.push),
    )
