"""The velocity from differences of positions, filtered around the model's prediction."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.parts import PerJoint, Scalar, State, parameter

from .estimator import AbstractEstimator, Estimate


class FilteredDifference(AbstractEstimator):
    """`q = q'`, `q̇ = q̇_predicted + a d`, `push⁺ = push + g a² d/h`, with `a = 1 - e^{-c h}`.

    The model's velocity error is `d = (q' - q'₋)/h - (q̇_predicted + q̇₋)/2`. A complementary filter: slow changes of
    the velocity come from the measured positions, and fast changes from the model. The filter therefore lags only
    behind unmodelled motion. Measured velocities are not used.

    For `c h << 1` the errors decay as `λ² + c λ + g c²`: a damping of `1/(2 √g)`, critical for g = 1/4; they decay
    for all `c h` and `0 < g <= 1`.
    """

    title = "The velocity from differences of positions, filtered around the model's prediction."

    cutoff: PerJoint = parameter("c, of the filter on the velocity", "rad/s", "> 0")
    gain: PerJoint = parameter(
        "g, of the push; 0 leaves it as it is", "", "[0, 1]", default=0.25, source="critical damping"
    )

    def init(self, measured: State) -> State:
        """The last measured position and the last estimated velocity."""
        return measured

    def __call__(
        self, measured: State, prior: Estimate, elapsed: Scalar, missed: Bool[Array, ""], memory: State
    ) -> tuple[Estimate, State]:
        """The measured positions, the filtered velocities, and the push."""
        share = -jnp.expm1(-self.cutoff * elapsed)
        correction = share * ((measured.q - memory.q) / elapsed - 0.5 * (prior.state.dq + memory.dq))
        usual = Estimate(
            state=State(q=measured.q, dq=prior.state.dq + correction),
            push=prior.push + self.gain * share * correction / elapsed,
        )
        # Over a gap the mean velocity is as good as ever, the push is not.
        estimate = Estimate(state=usual.state, push=jnp.where(missed, prior.push, usual.push))
        return estimate, estimate.state
