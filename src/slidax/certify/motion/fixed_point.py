"""Error bounds along a motion as a fixed point of monotone inequalities.

All joints have the same linear loop (joint_loop.py). So a bound of the disturbance w in a norm gives a bound of every
output of the loop in that norm. The error e obeys `ë = K (s + w) + ρ` with `K = M⁻¹ M0`, the nominal inertia M0 and the
true inertia `M = M0 + E`. s is the law's feedback acceleration. w depends on the outputs. ρ is the reference's mean
acceleration in a period less its actual one, and `(1 - p) M0 <= M <= (1 + p) M0`. The smaller of two bounds is used:

- small gain: `ë = s + w - M0⁻¹ E (ë - ρ) + ρ`, with the nominal loop and `‖M0⁻¹ E x‖ <= p ‖x‖`, or by element
  `|M0⁻¹ E| |x|`;
- modes: K is self-adjoint in the metric of M0, `‖x‖² = xᵀ M0 x`, with eigenvalues κ in [1/(1+p), 1/(1-p)]. For a
  constant K the loop's response is a function of K. A joint's bound is its nominal response, plus the largest
  difference from it over κ, bounded in the metric. K's change since an earlier instant counts as a disturbance (drift).

The motion is cut into time cells; a cell's value is a bound for all its instants. Values that satisfy all inequalities
are bounds, as the inequality at a time needs only earlier outputs (docs/any-motion.md, sections 5 to 8, with proofs).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from .hand_over import HandOverCells
from .joint_loop import OUTPUTS, JointLoop
from .lagged_sums import KernelStack, Lags, LagTable, remembered
from .loop_kernels import Spread, spread_kernels
from .path import Path
from .path_norms import size_in
from .path_suprema import Suprema
from .path_tube import Tube

Floats = NDArray[np.float64]

ROUNDS = 100
"""Largest number of rounds, each an evaluation of all inequalities; an iteration that needs more has no bound."""

SETTLED = 1e-3
"""Relative change at which an iteration is extrapolated and verified."""

NEAR = 0.03
"""Relative change of the largest error below which `approach` stops."""

WIDENINGS = 4
"""Number of times that a candidate which violates an inequality is enlarged and checked again."""

TINY = 1e-300

TERMS = (
    "friction",
    "disturbance",
    "inertial band",
    "band feedback",
    "velocity prediction",
    "position prediction",
    "sampling",
    "encoder",
    "start",
    "hand-over",
)
"""Names of the shares of an error bound."""

USED = (
    "error",
    "velocity",
    "command",
    "acceleration",
    "position_miss",
    "velocity_miss",
    "model_position",
    "model_velocity",
    "command_step",
    "model_position_step",
    "model_velocity_step",
    "innovation",
    "estimate",
    "led",
    "sliding",
)
"""Outputs of the joint loop that the inequalities bound (`OUTPUTS` in joint_loop.py)."""

DIRECT_SHARE = {"position_miss": 0.5, "velocity_miss": 1.0}
"""Largest effect of an acceleration on an output in the same period, in units of the period."""


@dataclass(frozen=True, eq=False)
class Inputs:
    """Bounds of friction, disturbance, measurement error and initial state, per joint.

    - `coulomb`: Coulomb friction that is not compensated [n], N m or N.
    - `viscous`: largest viscous coefficient [n], N m s/rad; `viscous_error`: its largest difference from the law's.
    - `torque`, `torque_rate`: disturbance torque [n], N m or N, and its rate [n], N m/s or N/s; inf without a bound.
    - `resolution`: encoder resolution plus the noise's range, twice the largest error of a position [n], rad or m.
    - `start_error`, `start_speed`: |e| [n], rad or m, and |ė| [n], rad/s or m/s, at the start.
    - `settled`: True if the disturbance estimate has settled at rest before the start; False if it starts from 0.
    """

    coulomb: Floats
    viscous: Floats
    viscous_error: Floats
    torque: Floats
    torque_rate: Floats
    resolution: Floats
    start_error: Floats
    start_speed: Floats
    settled: bool = False


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds in each cell, which hold at every time in the cell.

    - `error`, `velocity`: bounds of |e| and |ė| [cells n].
    - `outputs`: bounds of the loop's outputs by name [cells n]; `norms`: of their norms in the metric of M0 [cells].
    - `shares`: function that computes `terms`.
    - `disturbance`, `disturbance_norm`: bound of w's parts without a bound of their rate [cells n], and of their norm
      [cells]. Parts with one are the inertial band along the motion and a disturbance torque of bounded rate.
    - `verified`: True if the bounds satisfy all inequalities; False if the iteration stopped before that.
    """

    error: Floats
    velocity: Floats
    outputs: Mapping[str, Floats]
    norms: Mapping[str, Floats]
    shares: Callable[[], Mapping[str, Floats]]
    disturbance: Floats
    disturbance_norm: Floats
    verified: bool = False

    @cached_property
    def terms(self) -> Mapping[str, Floats]:
        """Shares of `error` by name, as in `TERMS`, [cells n]; their sum is at least `error`."""
        return self.shares()

    def times(self, factor: float) -> Bounds:
        """Return the bounds multiplied by a factor, except `disturbance`, `disturbance_norm` and `shares`."""
        return replace(
            self,
            error=self.error * factor,
            velocity=self.velocity * factor,
            outputs={name: value * factor for name, value in self.outputs.items()},
            norms={name: value * factor for name, value in self.norms.items()},
        )

    def joined(self, other: Bounds) -> Bounds:
        """Return the larger of the two bounds, value by value; all other fields are those of `self`."""
        return replace(
            self,
            error=np.maximum(self.error, other.error),
            velocity=np.maximum(self.velocity, other.velocity),
            outputs={name: np.maximum(value, other.outputs[name]) for name, value in self.outputs.items()},
            norms={name: np.maximum(value, other.norms[name]) for name, value in self.norms.items()},
        )

    def within(self, other: Bounds) -> bool:
        """True if no value is larger than the same value of `other`."""
        return (
            bool(np.all(self.error <= other.error) and np.all(self.velocity <= other.velocity))
            and all(np.all(self.outputs[name] <= other.outputs[name]) for name in USED)
            and all(np.all(self.norms[name] <= other.norms[name]) for name in USED)
        )


@lru_cache(maxsize=64)
def spreads_of(loop: JointLoop, p: float, growth: float) -> dict[str, Spread]:
    """Return the loop's kernels by output from `spread_kernels`; cached, since several motions use them."""
    return spread_kernels(loop, p, growth)


@lru_cache(maxsize=64)
def stacks_of(loop: JointLoop, p: float, growth: float) -> dict[str, KernelStack]:
    """Return the kernels of the outputs `USED`, by field of `Spread`, and `weighted` for κ = 1 and `growth`; cached."""
    spreads, grown = spreads_of(loop, p, growth), spreads_of(loop, 0.0, growth)
    kernels = {
        "nominal": [spreads[name].nominal for name in USED],
        "weighted": [grown[name].largest for name in USED],
        "departure": [spreads[name].departure for name in USED],
        "largest": [spreads[name].largest for name in USED],
    }
    return {name: KernelStack.of(each) for name, each in kernels.items()}


@lru_cache(maxsize=256)
def tables_of(loop: JointLoop, p: float, growth: float, cell: int, count: int) -> dict[str, LagTable]:
    """Return the kernels of `stacks_of` over `count` cells, each with `cell` periods; cached."""
    return {name: stack.over(cell, count) for name, stack in stacks_of(loop, p, growth).items()}


class Problem:
    """The inequalities along a motion (`path`), for deviations from it of up to `tube`."""

    def __init__(
        self,
        loop: JointLoop,
        path: Path,
        inputs: Inputs,
        at: Suprema,
        tube: Tube,
        hand_over: HandOverCells | None = None,
    ) -> None:
        """Compute all shares that do not depend on the outputs; `at` has the suprema over the cells and the tube."""
        self.loop, self.path, self.inputs, self.at, self.tube = loop, path, inputs, at, tube
        self.hand_over = hand_over
        self.p = path.region.p
        cells, h = path.cells, loop.period
        # Rounded up, so that motions share their kernels.
        self.growth = growth = float(np.ceil(4.0 * np.max(at.growth)) / 4.0)
        spreads = spreads_of(loop, self.p, growth)
        count = max(1, int(np.ceil(remembered(spreads["error"].nominal) / cells.per_cell)))
        self.cut = cut = (cells.per_cell, count)
        tables = tables_of(loop, self.p, growth, *cut)
        self.nominal, self.weighted = tables["nominal"], tables["weighted"]
        self.departure, self.largest = tables["departure"], tables["largest"]
        # Bound of the change of K⁻¹ = I + M0⁻¹ E over a lag. An input at lag k is up to k + 1 periods old.
        self.stacks = stacks_of(loop, self.p, growth)
        kernel = self.stacks["largest"].summed[:, 0]
        ages = h * (1.0 + np.arange(len(kernel)))
        weight = np.exp(2.0 * growth * ages)
        change = np.minimum(float(np.max(at.slide)) * ages * weight, self.p * (1.0 + weight))
        self.drift = Lags.of(kernel * change[:, None], *cut)
        self.h = h
        # The bound by element needs |M0⁻¹ E| to be a contraction, here in the largest entry relative to `conversion`.
        scale = at.conversion[:, :, None] / at.conversion[:, None]
        self.by_element = np.max(np.sum(at.band_relative / scale, axis=2), axis=1) < 1.0
        self.fixed_joints, self.fixed_norms, self.acting = self._acting()
        self.unplanned = 0.5 * h * cells.jerk + cells.jump
        self.small_gain, self.modes = self._constant()
        self.fixed = [[_total(values, k) for k in range(2)] for values in (self.small_gain, self.modes)]

    def _acting(self) -> tuple[dict[str, Floats], dict[str, Floats], Floats]:
        """Return the shares of w without the outputs: per joint [cells n], by norm [cells]; and ‖ρ‖ [cells]."""
        at, inputs, cells = self.at, self.inputs, self.path.cells
        friction = inputs.coulomb + inputs.viscous_error * cells.speed
        friction = friction + inputs.viscous * (0.5 * self.h * cells.acceleration)
        joints, norms = {}, {}
        acting = {"friction": friction}
        if not np.all(np.isfinite(inputs.torque_rate)):
            acting["disturbance"] = inputs.torque
        for name, torque in acting.items():
            values = np.broadcast_to(torque, cells.speed.shape)
            joints[name] = np.einsum("nij,nj->ni", at.inverse, values)
            norms[name] = np.sqrt(np.einsum("ni,ni->n", joints[name], values))
        norms["sampling"] = at.held + at.reference
        joints["sampling"] = at.conversion * norms["sampling"][:, None]
        norms["inertial band"] = at.band_tube
        joints["inertial band"] = at.conversion * at.band_tube[:, None]
        mean = 0.5 * self.h * cells.jerk + cells.jump
        return joints, norms, size_in(mean, at.inertia)

    def _constant(self) -> tuple[dict[str, tuple[Floats, Floats]], dict[str, tuple[Floats, Floats]]]:
        """Return the shares of the outputs that do not depend on them, by name, for the small gain and for the modes.

        Each share is a pair: per joint [cells n outputs], and in the metric of M0 [cells 1 outputs].
        """
        at, inputs, cells = self.at, self.inputs, self.path.cells
        shape = cells.speed.shape
        conversion = at.conversion[..., None]
        noise = np.broadcast_to(0.5 * inputs.resolution, shape)
        pulse = cells.pulse + self.h**3 / 12.0 / (1.0 - self.p) * at.conversion * at.odd[:, None]
        begun, begun_norm = np.zeros(shape), np.zeros((shape[0], 1))
        if not inputs.settled:
            begun[0], begun_norm[0] = at.band_joints[0], at.band[0]
        jump = self.p * size_in(cells.jump, at.inertia)
        begun, begun_norm = begun + at.conversion * jump[:, None], begun_norm + jump[:, None]
        # The filter's first position is the first measurement.
        starts = np.zeros((3, *shape))
        starts[0, 0], starts[1, 0] = inputs.start_error, inputs.start_speed
        if not inputs.settled:
            starts[2, 0] = 0.5 * inputs.resolution

        torque, torque_rate = (np.broadcast_to(value, shape) for value in (inputs.torque, inputs.torque_rate))
        limited = bool(np.all(np.isfinite(inputs.torque_rate)))
        pushed, pushed_rate = (
            np.einsum("nij,nj->ni", at.inverse, value) if limited else np.zeros(shape)
            for value in (torque, torque_rate)
        )
        pushed_norm, rate_norm = (
            np.sqrt(np.einsum("ni,ni->n", accelerated, value)) if limited else np.zeros(shape[0])
            for accelerated, value in ((pushed, torque), (pushed_rate, torque_rate))
        )
        turned = 2.0 * at.growth * pushed_norm
        first = np.zeros((shape[0], 1))
        first[0] = 0.0 if inputs.settled else 1.0
        self.pushed, self.pushed_norm = pushed, pushed_norm

        def slow_share(table: LagTable, slow: Floats, rate: Floats, step: Floats) -> Floats:
            """Response to a w of bounded size and rate: the smaller of the bounds by size and by rate."""
            moving = table.ramp.past(rate) + slow[..., None] * table.beyond + table.step.since(step)
            return np.minimum(table.any_form.past(slow), moving)

        def shares(table: LagTable, joints: bool) -> dict[str, Floats]:
            """Shares by name [cells k outputs]: k = n for joints, 1 for the metric."""
            size = (lambda x: x) if joints else (lambda x: size_in(x, at.inertia)[:, None])
            slow = at.band_joints if joints else at.band[:, None]
            rate = (at.conversion if joints else np.ones((shape[0], 1))) * at.band_rate[:, None]
            step = begun if joints else begun_norm
            push = pushed if joints else pushed_norm[:, None]
            push_rate = pushed_rate + at.conversion * turned[:, None] if joints else (rate_norm + turned)[:, None]
            return {
                "inertial band": slow_share(table, slow, rate, step),
                "disturbance": slow_share(table, push, push_rate, push * first),
                "encoder": table.noise.past(size(noise)),
                "sampling": table.pulse.past(size(pulse)),
                "start": table.start_error.since(size(starts[0]))
                + table.start_speed.since(size(starts[1]))
                + table.start_miss.since(size(starts[2])),
            }

        nominal, weighted = shares(self.nominal, True), shares(self.weighted, False)
        apart, largest = shares(self.departure, False), shares(self.largest, False)
        small_gain = {name: (nominal[name], weighted[name]) for name in nominal}
        modes = {name: (nominal[name] + conversion * apart[name], largest[name]) for name in nominal}
        return small_gain, modes

    def round(self, last: Bounds | None) -> Bounds:
        """Evaluate all inequalities once: return the bounds that follow from `last`; None stands for bounds of 0."""
        at, inputs, cells = self.at, self.inputs, self.path.cells
        conversion = at.conversion
        joints, norms = dict(self.fixed_joints), dict(self.fixed_norms)
        nothing = np.zeros_like(cells.speed)
        if last is None:
            parts = dict.fromkeys(USED, (nothing, nothing[:, 0]))
            velocity = nothing
        else:
            parts = {name: (last.outputs[name], last.norms[name]) for name in USED}
            velocity = last.velocity
        damping = inputs.viscous * velocity
        damped = np.einsum("nij,nj->ni", at.inverse, damping)
        joints["friction"] = joints["friction"] + damped
        norms["friction"] = norms["friction"] + np.sqrt(np.einsum("ni,ni->n", damped, damping))
        miss, miss_norm = parts["velocity_miss"]
        joints["velocity prediction"] = np.minimum(
            at.coriolis_rows * miss_norm[:, None], np.einsum("nij,nj->ni", at.coriolis_entries, miss)
        )
        norms["velocity prediction"] = at.coriolis * miss_norm
        miss, miss_norm = parts["position_miss"]
        further = np.sum(at.per_command * miss, axis=1) * parts["command"][1]
        joints["position prediction"] = conversion * further[:, None] + np.minimum(
            conversion * (at.stiffness * miss_norm)[:, None], np.einsum("nij,nj->ni", at.stiffness_entries, miss)
        )
        norms["position prediction"] = at.stiffness * miss_norm + further
        acceleration = parts["acceleration"][1]
        total, total_norm = sum(joints.values(), nothing), sum(norms.values(), nothing[:, 0])
        band = self.p * (acceleration + self.acting)
        fed = self.fed_back(parts["acceleration"][0], band)
        by_gain, by_modes = np.split(
            self.nominal.any_form.past(np.concatenate([total + fed, total], axis=1)), 2, axis=1
        )
        apart, mode_norms = self._apart(total_norm, acceleration)
        gain_joints = by_gain + self.fixed[0][0]
        gain_norms = self.weighted.any_form.past((total_norm + band)[:, None]) + self.fixed[0][1]
        mode_joints = by_modes + apart + self.fixed[1][0]
        mode_norms = mode_norms + self.fixed[1][1]
        goal = None
        if self.hand_over is not None:
            own = self.hand_over.goal(parts["led"][0])
            size = size_in(own, at.inertia)[:, None]
            goal = self.nominal.goal.past(own)
            more = conversion[..., None] * self.departure.goal.past(size)
            gain_joints, gain_norms = gain_joints + goal, gain_norms + self.weighted.goal.past(size)
            mode_joints, mode_norms = mode_joints + goal + more, mode_norms + self.largest.goal.past(size)
        least, least_norms = np.minimum(gain_joints, mode_joints), np.minimum(gain_norms, mode_norms)[:, 0]
        least_norms = np.minimum(least_norms, np.sqrt(np.sum(least * (at.inertia @ least), axis=1)))
        outputs = {name: least[..., i] for i, name in enumerate(USED)}
        sizes = {name: least_norms[:, i] for i, name in enumerate(USED)}
        # w has a part that is odd about the middle of a period: add its size, or the size of its integrals.
        odd = at.conversion * at.odd[:, None]
        for name, share in {
            "acceleration": 0.5 * self.h,
            "velocity_miss": self.h**2 / 8.0,
            "position_miss": self.h**3 / 8.0,
        }.items():
            outputs[name] = outputs[name] + share * odd
            sizes[name] = sizes[name] + share * at.odd
        # Between two samples e departs from its chord by at most h²/8 |ë|, and v from its chord by at most h/2 |w|.
        mean = 0.5 * self.h * cells.jerk + cells.jump
        within = self.h**2 / 8.0 * (outputs["acceleration"] + mean)
        error = _or_next(outputs["error"]) + within
        velocity = _or_next(outputs["velocity"]) + self.h * (
            0.5 * (total + at.band_joints + self.pushed + fed + self.h * odd) + mean
        )
        by_gain_is_less = bool(gain_joints[..., 0].sum() <= mode_joints[..., 0].sum())
        if goal is not None:
            goal = goal[..., 0] if by_gain_is_less else (goal + more)[..., 0]
        shares = partial(self._terms, joints, fed if by_gain_is_less else apart[..., 0], within, by_gain_is_less, goal)
        return Bounds(error, velocity, outputs, sizes, shares, total, total_norm)

    def fed_back(self, acceleration: Floats, band: Floats) -> Floats:
        """Return a bound of |M0⁻¹ E ë| per joint [cells n]: the smaller of those in the metric and by element.

        - `acceleration`: bound of |ë - ρ| per joint [cells n]; ρ and E as in the module's docstring.
        - `band`: bound of ‖M0⁻¹ E ë‖ [cells].
        """
        in_metric = self.at.conversion * band[:, None]
        each = np.einsum("nij,nj->ni", self.at.band_relative, acceleration + self.unplanned)
        return np.where(self.by_element[:, None], np.minimum(in_metric, each), in_metric)

    def _apart(self, total_norm: Floats, acceleration: Floats) -> tuple[Floats, Floats]:
        """Return bounds by the modes of K, without the shares of `_constant`.

        The first bounds the outputs' departure from the nominal loop [cells n outputs], the second their norms
        [cells 1 outputs].
        """
        # The inertial band counts E q̈_d in place of E (q̈_d + ρ): E ρ is a further w of at most p ‖ρ‖.
        total = (total_norm + self.p * self.acting)[:, None]
        drift = self.drift.past(acceleration[:, None])
        # Effect of K on velocity and position within the same period.
        direct = (
            self.p
            * acceleration[:, None, None]
            * np.array([DIRECT_SHARE.get(name, 0.0) * self.h ** (2 - OUTPUTS[name]) for name in USED])
        )
        apart = self.at.conversion[..., None] * (self.departure.any_form.past(total) + drift + direct)
        return apart, self.largest.any_form.past(total) + drift + direct

    def _terms(
        self, joints: Mapping[str, Floats], band: Floats, within: Floats, by_gain: bool, goal: Floats | None
    ) -> dict[str, Floats]:
        """Return the shares of the error by name [cells n].

        - `joints`: shares of w by name [cells n].
        - `band`: with `by_gain`, the disturbance by the band's feedback; else the share of the error by the modes.
        - `within`: largest departure of the error from its chord between two samples [cells n].
        - `by_gain`: True for the bounds by the small gain, False for those by the modes.
        - `goal`: the goal's share of the error [cells n]; None for a linear law.
        """
        kernel = self.nominal.any_form.output(USED.index("error"))
        shares = {name: kernel.past(value)[..., 0] for name, value in joints.items()}
        shares["band feedback"] = kernel.past(band)[..., 0] if by_gain else band
        for name, (share, _) in (self.small_gain if by_gain else self.modes).items():
            shares[name] = shares.get(name, 0.0) + share[..., USED.index("error")]
        if goal is not None:
            shares["hand-over"] = goal
        terms = {name: _or_next(shares[name]) for name in TERMS if name in shares}
        terms["sampling"] = terms["sampling"] + within
        return terms

    def approach(self, cap: float) -> Bounds | None:
        """Iterate from 0 until the error bound changes by less than `NEAR`, and return the unverified bounds.

        None if the error bound exceeds `cap` (rad or m), or still grows after `ROUNDS`.
        """
        bounds = self.round(None)
        for _ in range(ROUNDS):
            following = self.round(bounds)
            size, before = float(following.error.max()), float(bounds.error.max())
            if not size < cap:
                return None
            bounds = following
            if size < before * (1.0 + NEAR):
                return bounds
        return None

    def solve(self, start: Bounds | None, cap: float) -> Bounds:
        """Iterate to bounds that satisfy the inequalities; if none are below `cap` (rad or m), return unverified ones.

        - `start`: bounds to start from; None for 0.
        """
        bounds = self.round(start)
        last_change, last_step = 0.0, np.inf
        for k in range(ROUNDS):
            following = self.round(bounds)
            size = float(following.error.max())
            step = size - float(bounds.error.max())
            # Without a goal the inequalities are convex: once their steps grow, they grow for ever.
            if not size < cap or (k > 1 and step > last_step and step > SETTLED * size):
                return following if np.isfinite(size) else bounds
            last_step = step
            changes = [np.max(following.norms[name] / np.maximum(bounds.norms[name], TINY)) for name in USED]
            change = max(float(np.max(changes)) - 1.0, 0.0)
            bounds = following
            if change < SETTLED:
                # Extrapolate by a geometric series with the ratio of the last two changes, with a margin.
                ratio = min(change / last_change, 0.98) if last_change > 0.0 else 0.5
                grown = bounds.times(1.0 + 1e-6 + 1.5 * change / (1.0 - ratio))
                for _ in range(WIDENINGS):
                    following = self.round(grown)
                    if following.within(grown):
                        return replace(following, verified=True)
                    # Some bounds grow by more than the factor, such as those that a goal dominates.
                    grown = grown.joined(following.times(1.0 + 1e-6))
            last_change = change
        return bounds


def _total(shares: Mapping[str, tuple[Floats, Floats]], which: int) -> Floats:
    return np.asarray(sum((values[which] for values in shares.values()), np.zeros(())))


def _or_next(values: Floats) -> Floats:
    """Return the larger of a cell's value and the next cell's: a cell's last period ends where the next cell begins."""
    return np.maximum(values, np.concatenate([values[1:], values[-1:]]))


def memory(loop: JointLoop) -> float:
    """Return the time after which a disturbance hardly affects the nominal loop's error [s] (`remembered`)."""
    return remembered(spreads_of(loop, 0.0, 0.0)["error"].nominal) * loop.period
