"""Kernels of one joint's linear loop: the largest response of an output, at each lag, to an input of size 1.

The lag is the input's age in periods. A kernel's sum over all lags, times a bound of the input, bounds the output for
every input within its bound. Inside this module the unit of time is the period.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError

from .joint_loop import OUTPUTS, OWN, PENDING, JointLoop, PeriodMaps

Floats = NDArray[np.float64]

DIRECT: dict[str, tuple[float, float]] = {
    "acceleration": (1.0, 0.0),
    "velocity_miss": (0.5, 0.5),
    "position_miss": (0.125, 0.375),
}
"""Effect of w of size 1 in the same period: that of a constant w, and the largest further effect in the period."""

SMALLEST = 1e-9
"""Kernels are truncated once a state has decayed to this fraction. The rest is bounded, and counts in the last lag."""

LONGEST = 2**15
"""Largest length of a kernel [periods]; a loop that takes longer to settle is refused."""


@dataclass(frozen=True)
class LoopKernel:
    """Kernels of an output for each kind of input, in SI units: [L] for L lags, or [L outputs] for several outputs.

    - `any_form`: a disturbance acceleration w of size 1, of any form within and between periods.
    - `ramp`: a continuous w with a rate of size 1.
    - `beyond`: factor on the size of w. The product is added to the response to a ramp, for the effect of w in its own
      period.
    - `step`: a w that is 1 from some time on.
    - `pulse`: a position pulse of size 1 in each period.
    - `noise`: a measurement error of size 1 at each sample.
    - `start_error`: an initial e of size 1, which the law's Kalman filter knows; `start_speed`: an initial `v = ė` of
      size 1, which the filter does not know.
    - `start_miss`: an error of size 1 in the filter's first position.
    - `goal`: an acceleration of size 1 that the law itself adds to its command; its lag counts from when it acts.
    """

    any_form: Floats
    ramp: Floats
    beyond: Any
    step: Floats
    pulse: Floats
    noise: Floats
    start_error: Floats
    start_speed: Floats
    start_miss: Floats
    goal: Floats

    @property
    def gain(self) -> float:
        """l1 norm of the response to a disturbance w of any form."""
        return float(np.sum(self.any_form))

    def by_output(self) -> dict[str, LoopKernel]:
        """Split kernels [L outputs] into kernels [L] by the name of the output."""
        return {
            name: LoopKernel(**{kind: values[..., i] for kind, values in vars(self).items()})
            for i, name in enumerate(OUTPUTS)
        }


@dataclass(frozen=True)
class Spread:
    """Kernels of one output over all ratios κ of nominal to true inertia in a band.

    - `nominal`: for κ = 1. `departure`: largest size of the difference from the nominal response over κ.
    - `largest`: largest size of the response over κ.
    """

    nominal: LoopKernel
    departure: LoopKernel
    largest: LoopKernel


def loop_kernels(loop: JointLoop) -> dict[str, LoopKernel]:
    """Return the kernels of the nominal loop, by output (`OUTPUTS`)."""
    return {name: spread.nominal for name, spread in spread_kernels(loop, 0.0).items()}


def spread_kernels(loop: JointLoop, p: float, growth: float = 0.0) -> dict[str, Spread]:
    """Return the kernels by output, over ratios κ of nominal to true inertia from 1/(1 + p) to 1/(1 - p).

    Responses are computed for a grid of ratios. Between two neighbours, Δκ apart, a response departs from its chord by
    at most Δκ²/8 times its second derivative by κ (`_bend`). This bound is added to the last lag of kernels that are
    summed over lags, and to all lags of the others (`step`, `start_error`, `start_speed`, `start_miss`).

    - `growth`: rate of the weight `exp(growth (k + 1) h)` of lag k in `departure` and `largest` [1/s].

    Raises DefinitionError if the loop is unstable for a κ of the band.
    """
    ratios, maps = _stable_maps(loop, p, growth)
    length = _longest(loop, maps, growth)
    nominal, traces = _traces(loop, ratios, maps, growth, length)
    own = [trace.kernels() for trace in traces]
    largest = _largest(own)
    pushed = largest.by_output()["acceleration"]
    bend = _bend(float(ratios[2] - ratios[1]), p, pushed.gain) if p > 0.0 else 0.0
    between = bend * np.sum(largest.any_form, axis=0)
    apart = _largest([trace.less(traces[0]).kernels() for trace in traces], pushed, between)
    parts = [part.by_output() for part in (nominal.kernels(), apart, _largest(own, pushed, between))]
    return {name: Spread(*(part[name] for part in parts)) for name in OUTPUTS}


def bare_kernels(
    loop: JointLoop, p: float, growth: float, length: int, *, rest: bool = False
) -> dict[str, dict[str, LoopKernel]]:
    """Return the kernels of `spread_kernels` at the computed ratios alone, by field of `Spread` and by output.

    So they lack the bound for ratios between two computed ones.

    - `length`: periods after which the kernels are truncated.
    - `rest`: True for the bound of the truncated part alone, in the last lag; False for the kernels without it.
    """
    ratios, maps = _stable_maps(loop, p, growth)
    nominal, traces = _traces(loop, ratios, maps, growth, length)

    def part(trace: _Trace) -> _Trace:
        if rest:
            return replace(trace, response=np.zeros_like(trace.response), own=np.zeros_like(trace.own))
        return replace(trace, rest=np.zeros_like(trace.rest))

    apart = [part(trace.less(traces[0])) for trace in traces]
    whole = [part(trace) for trace in traces]
    return {
        "nominal": part(nominal).kernels().by_output(),
        "departure": _largest([trace.kernels() for trace in apart]).by_output(),
        "largest": _largest([trace.kernels() for trace in whole]).by_output(),
    }


def kernel_length(loop: JointLoop, p: float, growth: float) -> int:
    """Return the number of periods after which `spread_kernels` truncates its kernels.

    Raises DefinitionError as `spread_kernels` does.
    """
    return _longest(loop, _stable_maps(loop, p, growth)[1], growth)


def inertia_ratios(p: float) -> Floats:
    """Return the ratios κ at which responses are computed: 1 first, then a grid over the band in increasing order."""
    if p == 0.0:
        return np.array([1.0])
    count = 2 + int((1 / (1 - p) - 1 / (1 + p)) / FARTHEST)
    return np.concatenate([[1.0], np.linspace(1 / (1 + p), 1 / (1 - p), count)])


def _stable_maps(loop: JointLoop, p: float, growth: float) -> tuple[Floats, list[PeriodMaps]]:
    ratios = inertia_ratios(p)
    all_maps = [loop.maps_for(ratio) for ratio in ratios]
    for ratio, maps in zip(ratios, all_maps, strict=True):
        if not np.max(np.abs(np.linalg.eigvals(maps.step * np.exp(growth * loop.period)))) < 1.0 - 1e-6:
            raise DefinitionError(
                f"the loop of a joint is unstable where the true inertia is 1/{ratio:.3g} of the nominal one; identify "
                "the arm better, or choose a longer horizon"
            )
    return ratios, all_maps


def _longest(loop: JointLoop, all_maps: list[PeriodMaps], growth: float) -> int:
    return max(_length(maps.step * np.exp(growth * loop.period)) for maps in all_maps)


def _traces(
    loop: JointLoop, ratios: Floats, all_maps: list[PeriodMaps], growth: float, length: int
) -> tuple[_Trace, list[_Trace]]:
    """Return the nominal responses without a weight, and the weighted responses for each ratio."""
    traces = [_Trace.of(loop, maps, ratio, length, growth) for maps, ratio in zip(all_maps, ratios, strict=True)]
    return _Trace.of(loop, all_maps[0], 1.0, length, 0.0), traces


FARTHEST = 0.006
"""Largest distance between two inertia ratios κ at which the responses of a band are computed."""


def _bend(step: float, p: float, gain: float) -> float:
    """Return a factor that bounds a response's departure from its chord between two computed ratios.

    The departure is at most this factor, times the gain of the output to w, times the response of `a = κ (s + w)`. With
    `s + w = T w`, `y'' = 2 (T - 1) H a/κ³` for a response y to any input, where H maps w to the same output. Away from
    a computed ratio by Δκ/2 at most, T, H and a are at most 1/(1 - reach) times as large (docs/any-motion.md).

    - `step`: Δκ between neighbours. `gain`: gain of a to w, from its largest size over κ at each lag.

    Raises DefinitionError if the ratios are too far apart.
    """
    size = (1.0 + p) * gain
    reach = 0.5 * step * (1.0 + p) * (size + 1.0)
    if not reach < 1.0:
        raise DefinitionError(
            f"the loop of a joint is nearly unstable for inertias within {100 * p:.3g} % of the nominal one; identify "
            "the arm better, or choose a longer horizon"
        )
    return 0.25 * step**2 * (size / (1.0 - reach) + 1.0) * (1.0 + p) ** 3 / (1.0 - reach) ** 2


@dataclass(frozen=True)
class _Trace:
    """Responses of all outputs, with the period as the unit of time.

    - `response`: [L outputs 7], to noise, position pulse, velocity pulse, initial e, initial v, goal, and position
      pulse by w; `rest`: bound of the truncated responses [outputs 7].
    - `own`: effects in the same period [outputs 4]: of noise, of a constant w, the further effect of w (`DIRECT`), and
      of a goal that is decided in the period.
    - `delay`: periods until a goal acts.
    - `ratio`: κ. `weight`: weight of each lag [L + 1].
    """

    period: float
    delay: int
    response: Floats
    rest: Floats
    own: Floats
    ratio: float
    weight: Floats

    @classmethod
    def of(cls, loop: JointLoop, maps: PeriodMaps, ratio: float, length: int, growth: float) -> _Trace:
        size = maps.step.shape[0]
        state = np.concatenate([maps.enters, _starts(size), maps.goal[:, None]], axis=1)
        states = _powers(maps.step, state, length)
        response = maps.outputs @ states
        rest = _rest(maps, length, maps.step @ states[-1], growth * loop.period)
        own = np.zeros((len(OUTPUTS), 4))
        for i, name in enumerate(OUTPUTS):
            own[i] = maps.direct[i], *DIRECT.get(name, (0.0, 0.0)), maps.goal_direct[i]
            if name == "acceleration":
                own[i, 1] = ratio
            if name.endswith("_step"):
                response[:, i] = np.diff(response[:, i], axis=0, prepend=0.0)
                response[0, i, [0, 5]] -= own[i, [0, 3]]
                rest[i] *= 2.0
        # The joint's acceleration is κ (s + w), so that responses to w have the factor κ.
        response[:, :, 2] *= ratio
        w_pulse = response[:, :, 1:2] * ratio
        response = np.concatenate([response, w_pulse], axis=2)
        rest = np.concatenate([rest, rest[:, 1:2] * ratio], axis=1)
        # An input at lag k may be up to k + 1 periods old.
        weight = np.exp(growth * loop.period * (1.0 + np.arange(length + 1)))
        return cls(loop.period, loop.delay, response, rest, own, ratio, weight)

    def less(self, other: _Trace) -> _Trace:
        """Return the difference of two responses; their rests add up."""
        response, rest, own = self.response - other.response, self.rest + other.rest, self.own - other.own
        return replace(self, response=response, rest=rest, own=own)

    def kernels(self) -> LoopKernel:
        """Return the kernels of all outputs [L outputs]."""
        h, rest, weight = self.period, self.rest.T, self.weight[:, None]
        direct, constant, beyond, goal_direct = self.own.T
        noise, pulse, velocity, start_error, start_speed, goal, late = np.moveaxis(self.response, 2, 0)
        # The effect of w is linear in its time in the period: `velocity + late` at the start, `velocity` at the end.
        # The maximum over κ of its size is convex in time.
        ends = np.stack([np.abs(velocity), np.abs(velocity + late)])
        reached = constant + np.concatenate([np.zeros((1, len(constant))), np.cumsum(0.5 * late + velocity, axis=0)])
        between = 0.5 * (np.abs(reached[:-1]) + np.abs(reached[1:])) + np.abs(late) / 12.0
        stepped = np.maximum(np.abs(reached), np.abs(np.concatenate([reached[1:], reached[-1:]])))
        stepped[:-1] += np.abs(late) / 8.0
        unit = h ** -np.array(list(OUTPUTS.values()), float)
        w_rest = rest[6] + rest[2]

        def joined(own: Floats, later: Floats, rest: Floats) -> Floats:
            value = np.concatenate([np.abs(own)[None], np.abs(later)]) * weight
            value[-1] += rest
            return np.asarray(value)

        def begun(later: Floats, rest: Floats) -> Floats:
            return np.concatenate([np.abs(later) * weight[:-1], rest[None]])

        areas = _area(velocity, velocity + late) if self.ratio == 1.0 else 0.5 * np.sum(ends, axis=0)
        return LoopKernel(
            any_form=joined(np.abs(constant) + np.abs(beyond), areas, w_rest) * (unit * h**2),
            ramp=joined(constant + np.abs(beyond), between, w_rest * len(late)) * (unit * h**3),
            beyond=np.abs(beyond) * unit * h**2,
            step=stepped * weight * (unit * h**2) + w_rest * (unit * h**2),
            # The filter does not know a pulse by the arm, but it knows a pulse by the reference.
            pulse=joined(0.0 * direct, np.maximum(np.abs(pulse), np.abs(start_error)), rest[1] + rest[3]) * unit,
            noise=joined(direct, noise, rest[0]) * unit,
            start_error=begun(start_error, rest[3]) * unit,
            start_speed=begun(start_speed, rest[4]) * (unit * h),
            # The response to an error that the filter knows, less that to an error that it does not know.
            start_miss=begun(start_error - pulse, rest[3] + rest[1]) * unit,
            goal=self._acting(goal_direct, goal, rest[5]) * (unit * h**2),
        )

    def _acting(self, own: Floats, later: Floats, rest: Floats) -> Floats:
        """Return the sizes of the response to a goal, with lag 0 where the goal begins to act."""
        value = np.concatenate([np.abs(own)[None], np.abs(later)])
        value = np.concatenate([value[self.delay :], np.zeros((self.delay, len(own)))]) * self.weight[:, None]
        value[-1] += rest
        return value


def _largest(kernels: list[LoopKernel], pushed: LoopKernel | None = None, between: Any = 0.0) -> LoopKernel:
    """Return the largest of several kernels [L outputs] at each lag, plus the share between two ratios.

    That share is `between` [outputs] times the sum, or the maximum, of `pushed`, the kernel of the acceleration.
    """

    def most(name: str) -> Floats:
        value = np.max([getattr(kernel, name) for kernel in kernels], axis=0)
        value[-1] += 0.0 if pushed is None else between * float(np.sum(getattr(pushed, name)))
        return np.asarray(value)

    def most_at_once(name: str) -> Floats:
        value = np.max([getattr(kernel, name) for kernel in kernels], axis=0)
        return np.asarray(value + (0.0 if pushed is None else between * float(np.max(getattr(pushed, name)))))

    return LoopKernel(
        any_form=most("any_form"),
        ramp=most("ramp"),
        beyond=np.max([kernel.beyond for kernel in kernels], axis=0),
        step=most_at_once("step"),
        pulse=most("pulse"),
        noise=most("noise"),
        start_error=most_at_once("start_error"),
        start_speed=most_at_once("start_speed"),
        start_miss=most_at_once("start_miss"),
        goal=most("goal"),
    )


def _starts(size: int) -> Floats:
    """Return two initial states as columns: an e that the filter knows, and a v that it does not know."""
    starts = np.zeros((size, 2))
    starts[[0, 2], 0] = 1.0
    starts[OWN::PENDING, 0] = 1.0
    starts[1, 1] = 1.0
    return starts


def _length(step: Floats) -> int:
    """Return a number of periods after which powers of the step are at most `SMALLEST`."""
    power, length = step, 1
    while np.max(np.abs(power)) > SMALLEST:
        power, length = power @ power, 2 * length
        if length > LONGEST:
            raise DefinitionError(
                f"the loop of a joint takes more than {LONGEST} periods to settle; choose a shorter horizon "
                "or a faster filter"
            )
    return max(length, 16)


def _powers(step: Floats, first: Floats, count: int) -> Floats:
    """Return `step^k first` for k < count."""
    values = first[None]
    while len(values) < count:
        values, step = np.concatenate([values, step @ values]), step @ step
    return values[:count]


def _rest(maps: PeriodMaps, length: int, state: Floats, growth: float) -> Floats:
    """Return bounds of the sums of all responses after the truncation [outputs inputs].

    `Σ_{k >= L} |C A^k B| <= (Σ_{k < L} |C A^k|) (I - |A^L|)⁻¹ |A^L B|`.

    - `length`: L. `state`: `A^L B` without the weight of `growth`.
    """
    step = maps.step * np.exp(growth)
    total = np.sum(np.abs(_powers(step.T, maps.outputs.T, length)), axis=0).T
    power = np.linalg.matrix_power(step, length)
    after = np.abs(state) * np.exp(growth * length)
    return np.asarray(total @ np.linalg.solve(np.eye(len(step)) - np.abs(power), after))


def _area(a: Floats, b: Floats) -> Floats:
    """Return `∫₀¹ |a + (b - a) x| dx`, the area under the size of a line from a to b."""
    both = np.abs(a) + np.abs(b)
    safe = np.where(both > 0.0, both, 1.0)
    return np.where(a * b >= 0.0, 0.5 * both, 0.5 * (a * a + b * b) / safe)
