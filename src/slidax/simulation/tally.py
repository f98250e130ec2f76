"""Running statistics of all samples, so that metrics are exact whatever is logged."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from slidax._types import Envelope, Scalar, Vector
from slidax.transformations import PrescribedPerformance

from .promise import Promise
from .tool import Tool
from .tube import Watched


class Windows(eqx.Module):
    """From which sample a statistic counts.

    - `steady`: first sample of the last quarter of the run.
    - `late`: first sample after 2 s, as in eq. (80).
    - `bands`: error bands for the settling time, [k], rad or m.
    """

    steady: Int[Array, ""]
    late: Int[Array, ""]
    bands: Float[Array, " k"]


class Tally(eqx.Module):
    """Statistics of all samples, each [n] unless stated otherwise.

    - `samples`: how many samples were counted, [].
    - `violations`: how many of the samples had a joint at or outside its bounds, [].
    - `last_above`: number of the last sample with |e| above each band, -1 if none, [k n].
    - `early_error`, `late_error`: sums of |e| up to 2 s, and after.
    - `error_square`: sum of e².
    - `first_error`, `last_error`: |e| of the first and of the last sample.
    - `steady_error`: max |e| over the last quarter.
    - `first_torque`, `last_torque`: τ of the first and of the last sample.
    - `peak_torque`: max |τ|.
    - `max_step`, `steady_step`: max |τ(k+1) - τ(k)| over the run, and over its last quarter.
    - `steady_square`: sum of (τ(k+1) - τ(k))² over its last quarter.
    - `torque_square`: sum of τ².
    - `torque_travel`: sum of |τ(k+1) - τ(k)|.
    - `margin`: min over time of the distance to the nearer bound, divided by the envelope's width; inf without one.
    - `tolerance`: what was seen of the tolerance band that judges the run; None without one.
    - `promise`: what the law's monitor said; None without one.
    - `tool`: how far the tool was off; None where none is led.
    - `rejected`: how many measurements the law's gate rejected, []; None without a gate.
    """

    samples: Int[Array, ""]
    violations: Int[Array, ""]
    last_above: Int[Array, "k n"]
    early_error: Vector
    late_error: Vector
    error_square: Vector
    first_error: Vector
    last_error: Vector
    steady_error: Vector
    first_torque: Vector
    last_torque: Vector
    peak_torque: Vector
    max_step: Vector
    steady_step: Vector
    steady_square: Vector
    torque_square: Vector
    torque_travel: Vector
    margin: Vector
    tolerance: Watched | None = None
    promise: Promise | None = None
    tool: Tool | None = None
    rejected: Int[Array, ""] | None = None

    @staticmethod
    def empty(
        joints: int,
        bands: int,
        tolerance: Watched | None = None,
        promise: Promise | None = None,
        tool: Tool | None = None,
        gated: bool = False,
    ) -> Tally:
        """The tally before the first sample.

        - `joints`: number of joints.
        - `bands`: number of settling bands.
        - `tolerance`: the tolerance band that judges it, if there is one.
        - `promise`: of a law with a monitor.
        - `tool`: of a motion that leads one.
        - `gated`: True for a law with a gate for measurements.
        """
        zero = jnp.zeros(joints)
        count = jnp.zeros((), int)
        return Tally(
            samples=count,
            violations=count,
            last_above=jnp.full((bands, joints), -1),
            early_error=zero,
            late_error=zero,
            error_square=zero,
            first_error=zero,
            last_error=zero,
            steady_error=zero,
            first_torque=zero,
            last_torque=zero,
            peak_torque=zero,
            max_step=zero,
            steady_step=zero,
            steady_square=zero,
            torque_square=zero,
            torque_travel=zero,
            margin=jnp.full(joints, jnp.inf),
            tolerance=tolerance,
            promise=promise,
            tool=tool,
            rejected=count if gated else None,
        )

    def add(self, k: Int[Array, ""], e: Vector, tau: Vector, envelope: Envelope | None, windows: Windows) -> Tally:
        """The tally with one more sample.

        - `k`: number of the sample.
        - `e`: error [n], rad or m.
        - `tau`: torque [n], N m or N.
        - `envelope`: the bounds, or None.
        - `windows`: from when each statistic counts.
        """
        size = jnp.abs(e)
        effort = jnp.abs(tau)
        steady, late = k >= windows.steady, k >= windows.late
        step = jnp.where(k > 0, jnp.abs(tau - self.last_torque), 0.0)
        margin = self.margin
        if envelope is not None:
            nearer = jnp.minimum(e - envelope.lower, envelope.upper - e)
            margin = jnp.minimum(margin, nearer / (envelope.upper - envelope.lower))
        return Tally(
            samples=self.samples + 1,
            violations=self.violations,
            last_above=jnp.where(size > windows.bands[:, None], k, self.last_above),
            early_error=self.early_error + jnp.where(late, 0.0, size),
            late_error=self.late_error + jnp.where(late, size, 0.0),
            error_square=self.error_square + size * size,
            first_error=jnp.where(k > 0, self.first_error, size),
            last_error=size,
            steady_error=jnp.where(steady, jnp.maximum(self.steady_error, size), self.steady_error),
            first_torque=jnp.where(k > 0, self.first_torque, tau),
            last_torque=tau,
            peak_torque=jnp.maximum(self.peak_torque, effort),
            max_step=jnp.maximum(self.max_step, step),
            # The step that leads into the window's first sample belongs to the time before it.
            steady_step=jnp.where(k > windows.steady, jnp.maximum(self.steady_step, step), self.steady_step),
            steady_square=self.steady_square + jnp.where(k > windows.steady, step * step, 0.0),
            torque_square=self.torque_square + effort * effort,
            torque_travel=self.torque_travel + step,
            margin=margin,
            tolerance=self.tolerance,
            promise=self.promise,
            tool=self.tool,
            rejected=self.rejected,
        )

    def watching(self, tolerance: PrescribedPerformance, t: Scalar, e: Vector, running: Bool[Array, ""]) -> Tally:
        """The tally with one more sample of the tolerance band that judges the run; also where the law has no answer.

        - `tolerance`, `t`, `e`, `running`: as in `Watched.add`.
        """
        if self.tolerance is None:
            return self
        return eqx.tree_at(lambda tally: tally.tolerance, self, self.tolerance.add(tolerance, t, e, running))

    def warned(self, k: Int[Array, ""], signals: dict[str, Array], running: Bool[Array, ""]) -> Tally:
        """The tally with one more answer of the law's monitor.

        - `k`, `running`: as in `Promise.add`.
        - `signals`: of the law.
        """
        if self.promise is None:
            return self
        said = self.promise.add(k, signals["margin"], running)
        return eqx.tree_at(lambda tally: tally.promise, self, said)

    def with_rejection(self, signals: dict[str, Array], running: Bool[Array, ""]) -> Tally:
        """The tally with one more decision of the law's gate.

        - `signals`: of the law.
        - `running`: True until the run is over.
        """
        if self.rejected is None:
            return self
        rejected = running & (signals["rejected"] > 0.0)
        return eqx.tree_at(lambda tally: tally.rejected, self, self.rejected + rejected.astype(int))

    def with_violation(self, outside: Bool[Array, ""]) -> Tally:
        """The tally with one more violation where `outside` is true.

        - `outside`: whether the sample lies at or outside its bounds.
        """
        return eqx.tree_at(lambda tally: tally.violations, self, self.violations + outside.astype(int))
