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
    """First samples of the statistics.

    - `steady`: first sample of the last quarter of the run.
    - `late`: first sample after 2 s, as in eq. (80).
    - `bands`: error bands for the settling time, [k], rad or m.
    """

    steady: Int[Array, ""]
    late: Int[Array, ""]
    bands: Float[Array, " k"]


class Tally(eqx.Module):
    """Statistics of all samples, each [n] unless stated otherwise.

    - `samples`, `violations`: number of samples, and of those with a joint at or outside its bounds, [].
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
    - `tolerance`: margin to the tolerance band; None without one.
    - `promise`: margin from the law's monitor; None without one.
    - `tool`: error of the tool; None without a tool path.
    - `rejected`: number of measurements that the law's gate rejected, []; None without a gate.
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
        """Return the tally before the first sample, for so many joints and settling bands."""
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
        """Add sample k with error e [n], rad or m, and torque tau [n], N m or N."""
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
            # The step into the window's first sample belongs to the time before it.
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

    def with_tolerance(self, tolerance: PrescribedPerformance, t: Scalar, e: Vector, running: Bool[Array, ""]) -> Tally:
        """Add a sample to the margin of the tolerance band, also where the law is undefined."""
        if self.tolerance is None:
            return self
        return eqx.tree_at(lambda tally: tally.tolerance, self, self.tolerance.add(tolerance, t, e, running))

    def with_margin(self, k: Int[Array, ""], signals: dict[str, Array], running: Bool[Array, ""]) -> Tally:
        """Add the monitor's margin at sample k."""
        if self.promise is None:
            return self
        return eqx.tree_at(lambda tally: tally.promise, self, self.promise.add(k, signals["margin"], running))

    def with_rejection(self, signals: dict[str, Array], running: Bool[Array, ""]) -> Tally:
        """Add a decision of the law's gate."""
        if self.rejected is None:
            return self
        rejected = running & (signals["rejected"] > 0.0)
        return eqx.tree_at(lambda tally: tally.rejected, self, self.rejected + rejected.astype(int))

    def with_violation(self, outside: Bool[Array, ""]) -> Tally:
        """Add a violation if the sample is at or outside its bounds."""
        return eqx.tree_at(lambda tally: tally.violations, self, self.violations + outside.astype(int))
