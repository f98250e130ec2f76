"""Running statistics of all samples, so that metrics are exact even if few samples are logged.

The argument `running` of several methods is False after the end of a run; then the statistics stay as they are.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from slidax.arms.arm import AbstractRobot
from slidax.arms.articulated import Articulated
from slidax.arms.coupled import Coupled
from slidax.arms.paper_arms import Scara, TwoLink
from slidax.core.powers import vector_norm
from slidax.core.types import Envelope, Scalar, Vector
from slidax.law.error_transformations import PrescribedPerformance, Sides


class ErrorTally(eqx.Module):
    """Statistics of an error's size over all samples, as scalars in the error's unit.

    - `error`: maximum over the run.
    - `steady`: maximum in the last quarter of the run.
    - `square`: sum of squares, in the unit squared.
    """

    error: Scalar
    steady: Scalar
    square: Scalar

    @staticmethod
    def begin() -> ErrorTally:
        """Return the tally before the first sample."""
        zero = jnp.zeros(())
        return ErrorTally(error=zero, steady=zero, square=zero)

    def add(self, size: Scalar, running: Bool[Array, ""], steady: Bool[Array, ""]) -> ErrorTally:
        """Return the tally with one more sample.

        - `size`: size of the error at this sample, ≥ 0.
        - `steady`: True for a sample in the last quarter of the run.
        """
        return ErrorTally(
            error=jnp.where(running, jnp.maximum(self.error, size), self.error),
            steady=jnp.where(steady, jnp.maximum(self.steady, size), self.steady),
            square=jnp.where(running, self.square + size * size, self.square),
        )


class ToolTally(eqx.Module):
    """Statistics of the tool's error relative to its reference.

    - `position`: distance of the tip from its reference, m.
    - `rotation`: rotation angle from the reference, rad; None for a robot whose tip has no orientation.
    """

    position: ErrorTally
    rotation: ErrorTally | None

    @staticmethod
    def begin(robot: AbstractRobot) -> ToolTally:
        """Return the tally before the first sample."""
        rotates = isinstance(robot, Articulated | Coupled | Scara | TwoLink)
        return ToolTally(position=ErrorTally.begin(), rotation=ErrorTally.begin() if rotates else None)

    def add(
        self, robot: AbstractRobot, q: Vector, wanted: Vector, running: Bool[Array, ""], steady: Bool[Array, ""]
    ) -> ToolTally:
        """Return the tally with one more sample.

        - `q`, `wanted`: actual and reference positions of the joints [n], rad or m.
        - `steady`: True in the last quarter of the run.
        """
        distance = vector_norm(robot.tip(q) - robot.tip(wanted))
        rotation = self.rotation
        if rotation is not None:
            assert isinstance(robot, Articulated | Coupled | Scara | TwoLink)
            angle = rotation_angle(robot.tip_frame(q)[0], robot.tip_frame(wanted)[0])
            rotation = rotation.add(angle, running, steady)
        return ToolTally(position=self.position.add(distance, running, steady), rotation=rotation)


def rotation_angle(axes: Float[Array, "3 3"], others: Float[Array, "3 3"]) -> Scalar:
    """Return the rotation angle between two frames, in [0, π], rad; accurate for small angles too.

    - `axes`, `others`: axes of both frames as columns.
    """
    x, y, z = (jnp.cross(others[:, k], axes[:, k]) for k in range(3))
    # Half the sum of x, y, z is the axis times the sine; the trace is 1 + 2 cos.
    return jnp.arctan2(vector_norm(0.5 * (x + y + z)), 0.5 * (jnp.sum(axes * others) - 1.0))


class ToleranceTally(eqx.Module):
    """Margin of the error e to a tolerance band `b ρ(t) < e < b̄ ρ(t)` with radius ρ, eq. (12) of the paper.

    - `sides`: the factors b and b̄ [n], which follow from the true initial error by eq. (13) of the paper.
    - `outside`: number of samples with a joint at or outside its bounds, [].
    - `margin`: smallest distance to the nearer bound over the run, divided by the band's width [n]; < 0 if outside.
    """

    sides: Sides
    outside: Int[Array, ""]
    margin: Vector

    @staticmethod
    def begin(tolerance: PrescribedPerformance, e: Vector) -> ToleranceTally:
        """Return the tally before the first sample.

        - `tolerance`: the tolerance band.
        - `e`: true error at t = 0 [n], rad or m.
        """
        sides = tolerance.init(jnp.zeros(()), e)
        return ToleranceTally(sides=sides, outside=jnp.zeros((), int), margin=jnp.full(e.shape, jnp.inf))

    def add(self, tolerance: PrescribedPerformance, t: Scalar, e: Vector, running: Bool[Array, ""]) -> ToleranceTally:
        """Return the tally with one more sample, whose error is e [n], rad or m, at time t [s]."""
        bounds = tolerance.envelope(t, self.sides)
        known = running & jnp.all(jnp.isfinite(e))
        inside = jnp.all((bounds.lower < e) & (e < bounds.upper))
        nearer = jnp.minimum(e - bounds.lower, bounds.upper - e) / (bounds.upper - bounds.lower)
        return ToleranceTally(
            sides=self.sides,
            outside=self.outside + (known & ~inside).astype(int),
            margin=jnp.where(known, jnp.minimum(self.margin, nearer), self.margin),
        )


class MonitorTally(eqx.Module):
    """Statistics of the margin that the law's monitor reports.

    The monitor checks the guarantee's assumptions at run time. A negative margin means that one is violated.

    - `margin`: minimum over the run, []; inf before the first sample.
    - `warned`: number of the first sample with a negative margin, []; -1 without one.
    """

    margin: Scalar
    warned: Int[Array, ""]

    @staticmethod
    def begin() -> MonitorTally:
        """Return the tally before the first sample."""
        return MonitorTally(margin=jnp.full((), jnp.inf), warned=jnp.full((), -1))

    def add(self, k: Int[Array, ""], margin: Scalar, running: Bool[Array, ""]) -> MonitorTally:
        """Return the tally with the monitor's margin at sample k."""
        first = running & (margin < 0.0) & (self.warned < 0)
        return MonitorTally(
            margin=jnp.where(running, jnp.minimum(self.margin, margin), self.margin),
            warned=jnp.where(first, k, self.warned),
        )


class Windows(eqx.Module):
    """Time windows of the statistics, by their first samples, and the settling bands.

    - `steady`: first sample of the last quarter of the run.
    - `late`: first sample after 2 s, as in eq. (80) of the paper.
    - `bands`: error bands for the settling time, [k], rad or m.
    """

    steady: Int[Array, ""]
    late: Int[Array, ""]
    bands: Float[Array, " k"]


class Tally(eqx.Module):
    """Statistics of all samples, one value per joint [n] unless stated otherwise.

    e is the tracking error, rad or m, and τ the torque, N m or N.

    - `samples`: number of samples without a fault, [].
    - `violations`: number of samples with a joint at or outside the envelope's bounds, [].
    - `last_above`: number of the last sample with |e| above each band, -1 if none, [k n].
    - `early_error`, `late_error`: sums of |e| up to 2 s, and after 2 s.
    - `error_square`: sum of e².
    - `first_error`, `last_error`: |e| of the first and of the last sample.
    - `steady_error`: max |e| over the last quarter.
    - `first_torque`, `last_torque`: τ of the first and of the last sample.
    - `peak_torque`: max |τ|.
    - `max_step`, `steady_step`: max |τ(k+1) - τ(k)| over the run, and over its last quarter.
    - `steady_square`: sum of (τ(k+1) - τ(k))² over the run's last quarter.
    - `torque_square`: sum of τ².
    - `torque_travel`: sum of |τ(k+1) - τ(k)|.
    - `margin`: smallest distance to the nearer bound of the envelope over the run, divided by the envelope's width;
      inf without an envelope.
    - `tolerance`: margin to the tolerance band; None without one.
    - `promise`: statistics of the margin from the law's monitor; None without a monitor.
    - `tool`: error of the tool; None without a tool path.
    - `rejected`: number of implausible measurements that the law's gate rejected, []; None without a gate.
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
    tolerance: ToleranceTally | None = None
    promise: MonitorTally | None = None
    tool: ToolTally | None = None
    rejected: Int[Array, ""] | None = None

    @staticmethod
    def empty(
        joints: int,
        bands: int,
        tolerance: ToleranceTally | None = None,
        promise: MonitorTally | None = None,
        tool: ToolTally | None = None,
        gated: bool = False,
    ) -> Tally:
        """Return the tally before the first sample.

        - `joints`, `bands`: numbers of joints and of settling bands.
        - `tolerance`, `promise`, `tool`: fields of the tally.
        - `gated`: True if the law has a gate, which can reject measurements.
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
        """Return the tally with sample k, with error e [n], rad or m, and torque tau [n], N m or N."""
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
            # The torque step to the first sample of the window belongs to the time before it.
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
        """Return the tally with one more sample in `tolerance`, whose error is e [n], rad or m, at time t [s]."""
        if self.tolerance is None:
            return self
        return eqx.tree_at(lambda tally: tally.tolerance, self, self.tolerance.add(tolerance, t, e, running))

    def with_margin(self, k: Int[Array, ""], signals: dict[str, Array], running: Bool[Array, ""]) -> Tally:
        """Return the tally with the monitor's margin at sample k, from the law's `signals`."""
        if self.promise is None:
            return self
        return eqx.tree_at(lambda tally: tally.promise, self, self.promise.add(k, signals["margin"], running))

    def with_rejection(self, signals: dict[str, Array], running: Bool[Array, ""]) -> Tally:
        """Return the tally with `rejected` one higher if the law's gate rejected this sample, as in `signals`."""
        if self.rejected is None:
            return self
        rejected = running & (signals["rejected"] > 0.0)
        return eqx.tree_at(lambda tally: tally.rejected, self, self.rejected + rejected.astype(int))

    def with_violation(self, outside: Bool[Array, ""]) -> Tally:
        """Return the tally with one more violation if this sample is at or outside the envelope's bounds."""
        return eqx.tree_at(lambda tally: tally.violations, self, self.violations + outside.astype(int))
