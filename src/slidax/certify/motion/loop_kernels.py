"""Worst-case kernels of one joint's linear loop: the largest response to inputs of which only the size is known.

Inside this module the unit of time is the period.
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
"""Direct effect of w in the same period: share of a constant w, and the further share by the time in the period."""

SMALLEST = 1e-9
"""Truncation: kernels end once a state has decayed to this part of its size; the rest is bounded, not dropped."""

LONGEST = 2**15
"""Periods; a loop that takes longer to settle is refused."""


@dataclass(frozen=True)
class LoopKernel:
    """Bounds of one output per lag in periods, in SI units; each [L], or [L outputs] for several outputs.

    - `any_form`: for an acceleration w of size 1, of any form within and between periods.
    - `ramp`: for a continuous w whose rate has the size 1; with it goes `beyond` times the size of w itself.
    - `step`: for a w that is 1 from some time on.
    - `pulse`: for a position pulse of size 1 in each period.
    - `noise`: for a measurement error of size 1 at each sample.
    - `start_error`, `start_speed`: for an initial e, which the filter knows, or v, which it does not, of size 1.
    - `start_miss`: for an error of the filter's first position of size 1.
    - `goal`: for an acceleration of size 1 that the law itself adds to its command, by the lag from when it acts.
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
        """l1 norm of the response to a w of any form."""
        return float(np.sum(self.any_form))

    def by_output(self) -> dict[str, LoopKernel]:
        """Return the kernel of each output, from those of all."""
        return {
            name: LoopKernel(**{kind: values[..., i] for kind, values in vars(self).items()})
            for i, name in enumerate(OUTPUTS)
        }


@dataclass(frozen=True)
class Spread:
    """Kernels of one output over all inertia ratios κ of a band.

    - `nominal`: for κ = 1. `departure`: largest departure from it over κ. `largest`: largest response over κ.
    """

    nominal: LoopKernel
    departure: LoopKernel
    largest: LoopKernel


def loop_kernels(loop: JointLoop) -> dict[str, LoopKernel]:
    """Return the kernels of all outputs of the nominal loop."""
    return {name: spread.nominal for name, spread in spread_kernels(loop, 0.0).items()}


def spread_kernels(loop: JointLoop, p: float, growth: float = 0.0) -> dict[str, Spread]:
    """Return the kernels of all outputs over κ from 1/(1 + p) to 1/(1 - p).

    Between two of the ratios that are computed, a response departs from its chord by at most Δκ²/8 times its second
    derivative by κ (`_bend`). In kernels that are summed this share is added to the last lag.

    - `growth`: rate of a weight `exp(growth k h)` of lag k in `departure` and `largest` [1/s].

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
    """Return the parts of `spread_kernels` for `nominal`, `departure` and `largest`, for each output.

    - `length`: periods after which the kernels end.
    - `rest`: True for what follows their end, in their last value; False for the kernels without it. Neither has the
      share between two ratios.
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
    """Return the number of periods after which `spread_kernels` end.

    Raises DefinitionError as `spread_kernels` does.
    """
    return _longest(loop, _stable_maps(loop, p, growth)[1], growth)


def inertia_ratios(p: float) -> Floats:
    """Return 1, and the ratios κ of a band at which responses are computed."""
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
    """The nominal response without a weight, and those for all ratios."""
    traces = [_Trace.of(loop, maps, ratio, length, growth) for maps, ratio in zip(all_maps, ratios, strict=True)]
    return _Trace.of(loop, all_maps[0], 1.0, length, 0.0), traces


FARTHEST = 0.006
"""Largest distance between two inertia ratios κ at which the responses of a band are computed."""


def _bend(step: float, p: float, gain: float) -> float:
    """Departure of a response from its chord, per gain of its output to w and size of the response of `a = κ (s + w)`.

    With `s + w = T w`, `y'' = 2 (T - 1) H a/κ³` for a response y to any input and H of the same output to w. Away from
    a computed ratio by Δκ/2 at most, T, H and a are at most 1/(1 - reach) times as large (docs/any-motion.md).

    - `step`: Δκ between neighbours. `gain`: of a to w, the largest over κ at each lag.

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
    """Responses of all outputs in periods as the unit of time.

    - `response`: [L outputs 7] to noise, position pulse, velocity pulse, the two starts, the goal, and a position pulse
      by w; `rest`: [outputs 7].
    - `own`: effect in the same period of noise, of a constant w, further by the time in it, and of a goal that is
      decided in it [outputs 4].
    - `delay`: periods until a goal acts.
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
        # A w acts by κ.
        response[:, :, 2] *= ratio
        w_pulse = response[:, :, 1:2] * ratio
        response = np.concatenate([response, w_pulse], axis=2)
        rest = np.concatenate([rest, rest[:, 1:2] * ratio], axis=1)
        # An input of k periods ago may be up to k + 1 periods old.
        weight = np.exp(growth * loop.period * (1.0 + np.arange(length + 1)))
        return cls(loop.period, loop.delay, response, rest, own, ratio, weight)

    def less(self, other: _Trace) -> _Trace:
        """The difference of two responses."""
        response, rest, own = self.response - other.response, self.rest + other.rest, self.own - other.own
        return replace(self, response=response, rest=rest, own=own)

    def kernels(self) -> LoopKernel:
        """The kernels of all outputs [L outputs]."""
        h, rest, weight = self.period, self.rest.T, self.weight[:, None]
        direct, constant, beyond, goal_direct = self.own.T
        noise, pulse, velocity, start_error, start_speed, goal, late = np.moveaxis(self.response, 2, 0)
        # A w at the start of its period acts by `late + velocity`, at its end by `velocity`; a maximum over κ of the
        # size of such a line is convex in time.
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
            # The filter does not know of a pulse by the arm, but knows the reference's own.
            pulse=joined(0.0 * direct, np.maximum(np.abs(pulse), np.abs(start_error)), rest[1] + rest[3]) * unit,
            noise=joined(direct, noise, rest[0]) * unit,
            start_error=begun(start_error, rest[3]) * unit,
            start_speed=begun(start_speed, rest[4]) * (unit * h),
            # A known error less one that the filter does not know.
            start_miss=begun(start_error - pulse, rest[3] + rest[1]) * unit,
            goal=self._acting(goal_direct, goal, rest[5]) * (unit * h**2),
        )

    def _acting(self, own: Floats, later: Floats, rest: Floats) -> Floats:
        """Sizes of the response to a goal, from when it acts; before that it has no effect."""
        value = np.concatenate([np.abs(own)[None], np.abs(later)])
        value = np.concatenate([value[self.delay :], np.zeros((self.delay, len(own)))]) * self.weight[:, None]
        value[-1] += rest
        return value


def _largest(kernels: list[LoopKernel], pushed: LoopKernel | None = None, between: Any = 0.0) -> LoopKernel:
    """The largest of several kernels [L outputs] at each lag, and a share `between` of the acceleration's kernel.

    - `pushed`: the acceleration's. `between`: [outputs].
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
    """Initial states: an error e that the filter has measured, and a velocity v that it does not know."""
    starts = np.zeros((size, 2))
    starts[[0, 2], 0] = 1.0
    starts[OWN::PENDING, 0] = 1.0
    starts[1, 1] = 1.0
    return starts


def _length(step: Floats) -> int:
    """Number of periods after which powers of the step are small."""
    power, length = step, 1
    while np.max(np.abs(power)) > SMALLEST:
        power, length = power @ power, 2 * length
        if length > LONGEST:
            raise DefinitionError(f"the loop of a joint takes more than {LONGEST} periods to settle")
    return max(length, 16)


def _powers(step: Floats, first: Floats, count: int) -> Floats:
    """Return `step^k first` for k < count."""
    values = first[None]
    while len(values) < count:
        values, step = np.concatenate([values, step @ values]), step @ step
    return values[:count]


def _rest(maps: PeriodMaps, length: int, state: Floats, growth: float) -> Floats:
    """Sums of all responses after the truncation, in size, [outputs inputs].

    With `A^L` after L periods, `Σ_{k >= L} |C A^k B| <= (Σ_{k < L} |C A^k|) (I - |A^L|)⁻¹ |A^L B|`.
    """
    step = maps.step * np.exp(growth)
    total = np.sum(np.abs(_powers(step.T, maps.outputs.T, length)), axis=0).T
    power = np.linalg.matrix_power(step, length)
    after = np.abs(state) * np.exp(growth * length)
    return np.asarray(total @ np.linalg.solve(np.eye(len(step)) - np.abs(power), after))


def _area(a: Floats, b: Floats) -> Floats:
    """`∫₀¹ |a + (b - a) x| dx`."""
    both = np.abs(a) + np.abs(b)
    safe = np.where(both > 0.0, both, 1.0)
    return np.where(a * b >= 0.0, 0.5 * both, 0.5 * (a * a + b * b) / safe)
