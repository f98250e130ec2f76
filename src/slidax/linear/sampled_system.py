"""A linear system in discrete time, with names for what goes in and comes out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax._errors import DefinitionError, nearest

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
            raise DefinitionError(f"there is no {what} `{name}`; {nearest(name, [*groups, *names])}")
        places += here
    return places


def needed(a: Array, b: Array, c: Array) -> NDArray[np.intp]:
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
