"""Linear systems in discrete time with named inputs and outputs, and their stability margins."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.core.errors import DefinitionError, nearest_word

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

CHUNK = 64
"""Frequencies that are solved for together."""


@dataclass(frozen=True, eq=False)
class SampledSystem:
    """`x⁺ = A x + B u`, `y = C x + D u`, once a period.

    - `a`, `b`, `c`, `d`: the matrices.
    - `period`: h [s].
    - `inputs`, `outputs`: names, such as `torque[joint 1]`.
    - `input_units`, `output_units`: their units.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    period: float
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]

    @property
    def eigenvalues(self) -> Complex:
        """Of A, the largest first."""
        eigenvalues = np.linalg.eigvals(self.a).astype(complex)
        return eigenvalues[np.lexsort((eigenvalues.imag, -np.abs(eigenvalues)))]

    @property
    def radius(self) -> float:
        """The largest modulus of an eigenvalue; below 1 the loop is stable."""
        return float(np.abs(self.eigenvalues[0])) if self.a.size else 0.0

    def part(self, inputs: str | list[str], outputs: str | list[str]) -> SampledSystem:
        """The same states with some inputs and outputs alone.

        - `inputs`, `outputs`: a group, such as `torque`, one of its entries, such as `torque[joint 1]`, or a list.

        Raises DefinitionError for a name that is not there.
        """
        columns, rows = _places(self.inputs, inputs, "input"), _places(self.outputs, outputs, "output")
        return SampledSystem(
            a=self.a,
            b=self.b[:, columns],
            c=self.c[rows],
            d=self.d[np.ix_(rows, columns)],
            period=self.period,
            inputs=tuple(self.inputs[k] for k in columns),
            outputs=tuple(self.outputs[k] for k in rows),
            input_units=tuple(self.input_units[k] for k in columns),
            output_units=tuple(self.output_units[k] for k in rows),
        )

    def response(self, frequencies: Array) -> Complex:
        """`C (z - A)⁻¹ B + D` at `z = e^{jωh}`, [k outputs inputs].

        - `frequencies`: ω [k], rad/s, up to π/h.
        """
        z = np.exp(1j * np.atleast_1d(frequencies) * self.period)
        eye = np.eye(len(self.a))
        response = []
        for first in range(0, len(z), CHUNK):
            matrices = z[first : first + CHUNK, None, None] * eye - self.a
            right = np.broadcast_to(self.b, (len(matrices), *self.b.shape))
            response.append(self.c @ np.linalg.solve(matrices, right))
        return (np.concatenate(response) + self.d).astype(complex)

    def step_response(self, duration: float) -> tuple[Array, Array]:
        """Times [k], s, and the outputs after a unit step of each input, [k outputs inputs].

        - `duration`: [s].
        """
        steps = max(1, round(duration / self.period))
        x = np.zeros_like(self.b)
        outputs = np.empty((steps + 1, *self.d.shape))
        for k in range(steps + 1):
            outputs[k] = self.c @ x + self.d
            x = self.a @ x + self.b
        times: Array = self.period * np.arange(steps + 1, dtype=float)
        return times, outputs

    def for_control(self) -> Any:
        """The system as a `control.StateSpace` of python-control, with `dt`, for `bode_plot` and all else.

        Raises DefinitionError if python-control is not installed.
        """
        try:
            import control
        except ImportError:
            raise DefinitionError(
                "this needs python-control, which is not installed: pip install 'slidax[linear]'"
            ) from None
        return control.ss(
            self.a, self.b, self.c, self.d, self.period, inputs=list(self.inputs), outputs=list(self.outputs)
        )


def _places(names: tuple[str, ...], choice: str | list[str], what: str) -> list[int]:
    places: list[int] = []
    for name in [choice] if isinstance(choice, str) else choice:
        here = [k for k, entry in enumerate(names) if entry == name or entry.partition("[")[0] == name]
        if not here:
            groups = dict.fromkeys(entry.partition("[")[0] for entry in names)
            raise DefinitionError(f"there is no {what} `{name}`; {nearest_word(name, [*groups, *names])}")
        places += here
    return places


def connected_states(a: Array, b: Array, c: Array) -> NDArray[np.intp]:
    """The states that inputs reach and outputs see: the others are constants, clocks, or are used by nothing.

    - `a`, `b`, `c`: the matrices.
    """
    links = np.abs(a) > 0
    reached = (np.abs(b) > 0).any(axis=1)
    observed = (np.abs(c) > 0).any(axis=0)
    for _ in range(len(a)):
        further = reached | links[:, reached].any(axis=1)
        more = observed | links[observed].any(axis=0)
        if (further == reached).all() and (more == observed).all():
            break
        reached, observed = further, more
    return np.flatnonzero(reached & observed)


POINTS = 1500
"""Frequencies at which a loop is looked at first."""

LOWEST = 1e-5
"""The lowest of them, times π/h."""

TURNS = 60
"""Of a search between two of them."""


@dataclass(frozen=True)
class Margins:
    """Of a loop that is broken at one place, all else being closed; `None` where there is no such number.

    With S = 1/(1 + L), and L what goes around the loop.

    - `where`: the place.
    - `gain_up`, `gain_down`: factors of the gain there at which the loop becomes unstable.
    - `phase`: least change of the phase at which it does, degrees.
    - `delay`: least additional delay at which it does [s], if it is bounded.
    - `disk`: the disk margin α: all factors `(1 + δ/2)/(1 - δ/2)`, `|δ| < α`, of gain and phase at once are borne.
    - `sensitivity`: the peak of |S|.
    - `at_peak`: where that is [rad/s].
    - `crossover`: the highest frequency at which |L| = 1 [rad/s].
    """

    where: str
    gain_up: float | None
    gain_down: float | None
    phase: float | None
    delay: float | None
    disk: float
    sensitivity: float
    at_peak: float
    crossover: float | None

    @property
    def disk_gains(self) -> tuple[float, float]:
        """The factors of the gain that the disk margin allows."""
        if self.disk >= 2.0:
            return 0.0, math.inf
        return (2.0 - self.disk) / (2.0 + self.disk), (2.0 + self.disk) / (2.0 - self.disk)

    @property
    def disk_phase(self) -> float:
        """The change of the phase that the disk margin allows, degrees."""
        return math.degrees(2.0 * math.atan(0.5 * self.disk))

    def as_json(self) -> dict[str, Any]:
        """All numbers by name."""
        low, high = self.disk_gains
        values = asdict(self) | {"disk_gains": [low, high if math.isfinite(high) else None]}
        return values | {"disk_phase": self.disk_phase}


def frequencies(period: float) -> Array:
    """From slow to half of the sampling frequency, rad/s.

    - `period`: h [s].
    """
    top = math.pi / period
    return np.concatenate([np.geomspace(LOWEST * top, 0.05 * top, POINTS // 2), np.linspace(0.05, 1.0, POINTS) * top])


def margins_of(closed: SampledSystem, where: str) -> Margins:
    """The margins of a stable loop at one place.

    - `closed`: from a signal that is added there to what comes round, one input and one output: `-L/(1 + L)`.
    - `where`: the place.
    """

    def loop(omega: float) -> complex:
        around = complex(closed.response(np.array([omega]))[0, 0, 0])
        return -around / (1.0 + around)

    omega = frequencies(closed.period)
    sensitivity = 1.0 + closed.response(omega)[:, 0, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        around = (1.0 - sensitivity) / sensitivity
    gains = [-1.0 / loop(at).real for at in _crossings(omega, around.imag, lambda w: loop(w).imag) if loop(at).real < 0]
    # At half of the sampling frequency L is real.
    end = float(around[-1].real)
    if end < 0:
        gains.append(-1.0 / end)
    ups, downs = [gain for gain in gains if gain > 1], [gain for gain in gains if gain < 1]
    crossed = _crossings(omega, np.abs(around) - 1.0, lambda w: abs(loop(w)) - 1.0)
    phases = [math.atan2(loop(at).imag, loop(at).real) for at in crossed]
    # From there to -1, in either direction; and in that of a delay alone.
    apart = [math.pi - abs(phase) for phase in phases]
    delays = [((phase + math.pi) % (2 * math.pi)) / at for phase, at in zip(phases, crossed, strict=True)]
    size, at_peak = _peak(omega, np.abs(sensitivity), lambda w: abs(1.0 + closed.response(np.array([w]))[0, 0, 0]))
    half, _ = _peak(omega, np.abs(sensitivity - 0.5), lambda w: abs(0.5 + closed.response(np.array([w]))[0, 0, 0]))
    return Margins(
        where=where,
        gain_up=min(ups, default=None),
        gain_down=max(downs, default=None),
        phase=math.degrees(min(apart)) if apart else None,
        delay=min(delays, default=None),
        disk=float(1.0 / half),
        sensitivity=float(size),
        at_peak=at_peak,
        crossover=max(crossed, default=None),
    )


def simultaneous_margins(closed: SampledSystem, where: str) -> tuple[float, float, float]:
    """The disk margin for all channels at once, the largest singular value of S, and where that is [rad/s].

    Each channel may have a factor of its own; the number is a lower bound, by the largest singular value.

    - `closed`: from signals that are added to what comes round, as many inputs as outputs.
    - `where`: the place.
    """
    omega = frequencies(closed.period)
    eye = np.eye(len(closed.outputs))

    def largest(share: float) -> tuple[float, float]:
        def size(w: Array) -> Array:
            return np.linalg.svd(share * eye + closed.response(w), compute_uv=False)[:, 0]

        return _peak(omega, size(omega), lambda w: float(size(np.array([w]))[0]))

    return 1.0 / largest(0.5)[0], *largest(1.0)


def _crossings(omega: Array, values: Array, function: Callable[[float], float]) -> list[float]:
    """Where a function of the frequency is zero."""
    crossings = []
    known = np.isfinite(values[:-1]) & np.isfinite(values[1:])
    for k in np.flatnonzero(known & (np.sign(values[:-1]) * np.sign(values[1:]) < 0)):
        low, high = float(omega[k]), float(omega[k + 1])
        at_low = function(low)
        # A jump from one sign to the other, as of a phase, is no zero.
        for _ in range(TURNS):
            middle = 0.5 * (low + high)
            value = function(middle)
            if value * at_low > 0:
                low, at_low = middle, value
            else:
                high = middle
        crossings.append(0.5 * (low + high))
    return crossings


def _peak(omega: Array, values: Array, function: Callable[[float], float]) -> tuple[float, float]:
    """The largest value, and where it is."""
    best = int(np.argmax(values))
    low, high = float(omega[max(best - 1, 0)]), float(omega[min(best + 1, len(omega) - 1)])
    share = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(TURNS // 2):
        a, b = high - share * (high - low), low + share * (high - low)
        if function(a) > function(b):
            high = b
        else:
            low = a
    at = 0.5 * (low + high)
    value = function(at)
    return (value, at) if value > values[best] else (float(values[best]), float(omega[best]))
