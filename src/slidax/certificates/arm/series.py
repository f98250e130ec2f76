"""Inertia matrix and weight as trigonometric polynomials of the joint positions.

M has degree 2 in each joint, G degree 1. With a prismatic joint at `q = m + a cos θ` both are polynomials of degree 2
and 1 in cos θ. So 5 points a joint determine all of their coefficients exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import AbstractRobot, Coupled

from ..each import Floats

POINTS = 5
"""Points a joint: twice the degree, and one."""

MOST = 7
"""Largest number of joints that may matter: 5⁷ postures are 78 125."""


@dataclass(frozen=True)
class Series:
    """`f(q) = Σ c_k exp(i k·θ)`, k from -2 to 2 for each joint that matters.

    - `coefficients`: c_k [K ...].
    """

    grid: Grid
    coefficients: Any

    def bound(self) -> Floats:
        """`Σ |c_k|`, an upper bound of |f| [...]."""
        return np.abs(self.coefficients).sum(axis=0)

    def slopes(self) -> Floats:
        """Upper bounds of |∂f/∂q_j| [... n]: `Σ |k_j| |c_k|`, and Markov's `4 Σ |c_k|/a` for a prismatic joint."""
        size = np.abs(self.coefficients)
        bounds = np.zeros((*size.shape[1:], self.grid.size))
        for at, joint in enumerate(self.grid.joints):
            k = np.abs(self.grid.degrees[:, at])
            weight = k if self.grid.turns[joint] else 4.0 * (k > 0) / self.grid.half[joint]
            bounds[..., joint] = np.tensordot(weight, size, axes=1)
        return bounds


@dataclass(frozen=True)
class Grid:
    """Postures that determine all of M and G.

    - `joints`: the joints that matter.
    - `turns`: True for each revolute joint [n].
    - `middle`, `half`: middle and half of the range of each prismatic joint [n], m; 0 and 1 for a revolute one.
    """

    joints: tuple[int, ...]
    turns: Floats
    middle: Floats
    half: Floats

    @classmethod
    def of(cls, at: Callable[[Floats], Floats], units: tuple[str, ...], lower: Floats, upper: Floats) -> Grid:
        """The grid of the joints that matter, which are found at random postures.

        - `at`: from postures [N n] to all values [N F].
        - `lower`, `upper`: limits of the prismatic joints [n], m; those of others are not used.

        Raises DefinitionError if too many joints matter.
        """
        turns = np.array([unit == "rad" for unit in units])
        n = len(turns)
        middle = np.where(turns, 0.0, 0.5 * (lower + upper))
        half = np.where(turns, 1.0, np.maximum(0.5 * (upper - lower), 1e-6))
        random = np.random.default_rng(3)
        places = np.where(turns, random.uniform(-np.pi, np.pi, (2, 4, n)), random.uniform(-1.0, 1.0, (2, 4, n)))
        q, other = middle + half * places
        moved = np.repeat(q[None], n + 1, axis=0)
        for joint in range(n):
            moved[joint + 1, :, joint] = other[:, joint]
        values = at(moved.reshape(-1, n)).reshape(n + 1, -1)
        change = np.abs(values[1:] - values[0]).max(axis=1)
        joints = tuple(np.flatnonzero(change > 1e-12 * max(float(np.abs(values).max()), 1e-300)).tolist())
        if len(joints) > MOST:
            raise DefinitionError(f"the inertia depends on {len(joints)} joints; at most {MOST} are possible")
        return cls(joints, turns, middle, half)

    @property
    def size(self) -> int:
        """Number n of the arm's joints."""
        return len(self.turns)

    @property
    def postures(self) -> Floats:
        """All postures [5^J n]."""
        angles = np.array(list(product(2.0 * np.pi * np.arange(POINTS) / POINTS, repeat=len(self.joints))))
        q = np.tile(self.middle, (len(angles), 1))
        for k, joint in enumerate(self.joints):
            q[:, joint] = (
                angles[:, k] if self.turns[joint] else self.middle[joint] + self.half[joint] * np.cos(angles[:, k])
            )
        return q

    @property
    def degrees(self) -> Floats:
        """Wave numbers k of each coefficient [5^J J]."""
        harmonics = np.fft.fftfreq(POINTS, 1.0 / POINTS)
        count = len(self.joints)
        # The length is explicit: -1 cannot replace it if no joint matters.
        return np.array(list(product(harmonics, repeat=count))).reshape(POINTS**count, count)

    def series(self, values: Floats) -> Series:
        """The series of values at the postures [5^J ...]."""
        axes = tuple(range(len(self.joints)))
        shaped = values.reshape(*[POINTS] * len(self.joints), *values.shape[1:])
        coefficients = np.fft.fftn(shaped, axes=axes) / len(values) if axes else shaped[None]
        return Series(self, coefficients.reshape(len(values), *values.shape[1:]))

    def rates(self) -> Floats:
        """D_j [n] with `|f(q + e) - f(q)| <= D·|e| sup|f|` and second derivatives within `(D·|e|)² sup|f|`.

        From Bernstein's inequality for a revolute joint, from Markov's for a prismatic one; for M's degree.
        """
        rates = np.zeros(self.size)
        for joint in self.joints:
            rates[joint] = 2.0 if self.turns[joint] else 4.0 / self.half[joint]
        return rates


def require_independent_joints(robot: AbstractRobot) -> None:
    """Raise DefinitionError for an arm with coupled joints.

    There M is no polynomial of degree 2 in a joint: a follower at the ratio 2 doubles the degree, one at 0.5 has none.
    """
    if isinstance(robot, Coupled):
        raise DefinitionError(
            f"joint `{robot.followers[0]}` of {robot.name} follows another joint: bounds of M exist only for arms "
            "without coupled joints, where M is a polynomial of degree 2 in cosine and sine of each joint"
        )
