"""Discrete-time linear systems with named inputs and outputs, and their stability margins."""

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
"""Number of frequencies that are solved at a time."""


@dataclass(frozen=True, eq=False)
class SampledSystem:
    """Discrete-time system `x⁺ = A x + B u`, `y = C x + D u`.

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
        """Eigenvalues of A, the largest modulus first."""
        eigenvalues = np.linalg.eigvals(self.a).astype(complex)
        return eigenvalues[np.lexsort((eigenvalues.imag, -np.abs(eigenvalues)))]

    @property
    def radius(self) -> float:
        """Spectral radius of A; the system is stable if it is below 1."""
        return float(np.abs(self.eigenvalues[0])) if self.a.size else 0.0

    def select(self, inputs: str | list[str], outputs: str | list[str]) -> SampledSystem:
        """Return the system with only some of its inputs and outputs.

        - `inputs`, `outputs`: a group, such as `torque`, an entry, such as `torque[joint 1]`, or a list of these.

        Raises DefinitionError for an unknown name.
        """
        columns, rows = _indices(self.inputs, inputs, "input"), _indices(self.outputs, outputs, "output")
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
        """Frequency response `C (z - A)⁻¹ B + D` at `z = e^{jωh}`, [k outputs inputs].

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
        """Times [k], s, and the response to a unit step of each input, [k outputs inputs].

        - `duration`: length of the response [s].
        """
        steps = max(1, round(duration / self.period))
        x = np.zeros_like(self.b)
        outputs = np.empty((steps + 1, *self.d.shape))
        for k in range(steps + 1):
            outputs[k] = self.c @ x + self.d
            x = self.a @ x + self.b
        times: Array = self.period * np.arange(steps + 1, dtype=float)
        return times, outputs

    def to_control(self) -> Any:
        """Convert the system to a `control.StateSpace` of python-control with sample time `dt`.

        Raises DefinitionError if python-control is not installed.
        """
        try:
            import control
        except ImportError:
            raise DefinitionError(
                "`to_control` needs python-control, which is not installed: pip install 'slidax[linear]'"
            ) from None
        return control.ss(
            self.a, self.b, self.c, self.d, self.period, inputs=list(self.inputs), outputs=list(self.outputs)
        )


def _indices(names: tuple[str, ...], choice: str | list[str], kind: str) -> list[int]:
    indices: list[int] = []
    for name in [choice] if isinstance(choice, str) else choice:
        matching = [k for k, entry in enumerate(names) if entry == name or entry.partition("[")[0] == name]
        if not matching:
            groups = dict.fromkeys(entry.partition("[")[0] for entry in names)
            raise DefinitionError(f"there is no {kind} `{name}`; {nearest_word(name, [*groups, *names])}")
        indices += matching
    return indices


def connected_states(a: Array, b: Array, c: Array) -> NDArray[np.intp]:
    """Return the indices of the states that an input can affect and that affect an output.

    Others, such as clocks and constants, are left out.

    - `a`, `b`, `c`: matrices of `x⁺ = A x + B u`, `y = C x`.
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
"""Number of frequencies on the linear part of the grid; the logarithmic part has half as many."""

LOWEST = 1e-5
"""Lowest frequency of the grid, as a multiple of π/h."""

ITERATIONS = 60
"""Bisection steps between two frequencies of the grid; a search for a peak takes half as many steps."""


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop opened at a point, with all other loops closed; `None` for a margin without limit.

    L is the loop gain and S = 1/(1 + L) the sensitivity.

    - `where`: name of the point and the joint, such as `torque[joint 1]`.
    - `gain_up`, `gain_down`: gain margins, the factors of the gain at which the loop becomes unstable.
    - `phase`: phase margin, degrees.
    - `delay`: delay margin, the smallest additional delay at which the loop becomes unstable [s].
    - `disk`: disk margin α: the loop stays stable for all simultaneous changes of gain and phase, by the factor
      `(1 + δ/2)/(1 - δ/2)` for complex δ with `|δ| < α`.
    - `sensitivity`: peak of |S|.
    - `at_peak`: frequency of this peak [rad/s].
    - `crossover`: highest frequency with |L| = 1 [rad/s].
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
        """Smallest and largest gain factor that the disk margin allows."""
        if self.disk >= 2.0:
            return 0.0, math.inf
        return (2.0 - self.disk) / (2.0 + self.disk), (2.0 + self.disk) / (2.0 - self.disk)

    @property
    def disk_phase(self) -> float:
        """Phase change that the disk margin allows, degrees."""
        return math.degrees(2.0 * math.atan(0.5 * self.disk))

    def as_json(self) -> dict[str, Any]:
        """The margins by name."""
        low, high = self.disk_gains
        values = asdict(self) | {"disk_gains": [low, high if math.isfinite(high) else None]}
        return values | {"disk_phase": self.disk_phase}


def frequencies(period: float) -> Array:
    """Frequency grid up to half the sampling frequency, rad/s.

    - `period`: h [s].
    """
    top = math.pi / period
    return np.concatenate([np.geomspace(LOWEST * top, 0.05 * top, POINTS // 2), np.linspace(0.05, 1.0, POINTS) * top])


def margins_of(closed: SampledSystem, where: str) -> Margins:
    """Return the margins of a stable loop at a point.

    - `closed`: the closed loop at this point, `-L/(1 + L)` with the loop gain L; a single input and output.
    - `where`: name of the point, for the result.
    """

    def gain_at(omega: float) -> complex:
        response = complex(closed.response(np.array([omega]))[0, 0, 0])
        return -response / (1.0 + response)

    omega = frequencies(closed.period)
    sensitivity = 1.0 + closed.response(omega)[:, 0, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        loop_gain = (1.0 - sensitivity) / sensitivity
    real_axis = [gain_at(at).real for at in _crossings(omega, loop_gain.imag, lambda w: gain_at(w).imag)]
    gains = [-1.0 / value for value in real_axis if value < 0]
    # At half the sampling frequency L is real.
    end = float(loop_gain[-1].real)
    if end < 0:
        gains.append(-1.0 / end)
    ups, downs = [gain for gain in gains if gain > 1], [gain for gain in gains if gain < 1]
    crossed = _crossings(omega, np.abs(loop_gain) - 1.0, lambda w: abs(gain_at(w)) - 1.0)
    phases = [math.atan2(gain_at(at).imag, gain_at(at).real) for at in crossed]
    # Angle from L to -1: in either direction for the phase margin, clockwise for the delay margin.
    angles = [math.pi - abs(phase) for phase in phases]
    delays = [((phase + math.pi) % (2 * math.pi)) / at for phase, at in zip(phases, crossed, strict=True)]
    size, at_peak = _peak(omega, np.abs(sensitivity), lambda w: abs(1.0 + closed.response(np.array([w]))[0, 0, 0]))
    half, _ = _peak(omega, np.abs(sensitivity - 0.5), lambda w: abs(0.5 + closed.response(np.array([w]))[0, 0, 0]))
    return Margins(
        where=where,
        gain_up=min(ups, default=None),
        gain_down=max(downs, default=None),
        phase=math.degrees(min(angles)) if angles else None,
        delay=min(delays, default=None),
        disk=float(1.0 / half),
        sensitivity=float(size),
        at_peak=at_peak,
        crossover=max(crossed, default=None),
    )


def simultaneous_margins(closed: SampledSystem) -> tuple[float, float, float]:
    """Disk margin for simultaneous changes in all channels, peak of the sensitivity S, and its frequency [rad/s].

    Each channel may have a different factor. The disk margin is a lower bound, from a largest singular value. The peak
    is the largest singular value of `S = (1 + L)⁻¹`, with the loop gain L.

    - `closed`: the closed loop at a point, `-L (1 + L)⁻¹`, with as many inputs as outputs.
    """
    omega = frequencies(closed.period)
    eye = np.eye(len(closed.outputs))

    def largest(share: float) -> tuple[float, float]:
        def size(w: Array) -> Array:
            return np.linalg.svd(share * eye + closed.response(w), compute_uv=False)[:, 0]

        return _peak(omega, size(omega), lambda w: float(size(np.array([w]))[0]))

    return 1.0 / largest(0.5)[0], *largest(1.0)


def _crossings(omega: Array, values: Array, function: Callable[[float], float]) -> list[float]:
    """Frequencies at which a function changes its sign."""
    crossings = []
    known = np.isfinite(values[:-1]) & np.isfinite(values[1:])
    for k in np.flatnonzero(known & (np.sign(values[:-1]) * np.sign(values[1:]) < 0)):
        low, high = float(omega[k]), float(omega[k + 1])
        at_low = function(low)
        for _ in range(ITERATIONS):
            middle = 0.5 * (low + high)
            value = function(middle)
            if value * at_low > 0:
                low, at_low = middle, value
            else:
                high = middle
        crossings.append(0.5 * (low + high))
    return crossings


def _peak(omega: Array, values: Array, function: Callable[[float], float]) -> tuple[float, float]:
    """Largest value and its frequency, by golden-section search around the largest grid value."""
    best = int(np.argmax(values))
    low, high = float(omega[max(best - 1, 0)]), float(omega[min(best + 1, len(omega) - 1)])
    share = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(ITERATIONS // 2):
        a, b = high - share * (high - low), low + share * (high - low)
        if function(a) > function(b):
            high = b
        else:
            low = a
    at = 0.5 * (low + high)
    value = function(at)
    return (value, at) if value > values[best] else (float(values[best]), float(omega[best]))
