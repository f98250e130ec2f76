"""The inertia matrix and the weight as what they are: trigonometric polynomials of the joints' positions.

M is of degree 2 in each joint, G of degree 1; with a prismatic joint at `q = m + a cos θ` both are polynomials of
degree 2 and 1 in cos θ. So 5 points a joint give all of their coefficients, exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import AbstractRobot, Coupled

from .evaluated import Floats

POINTS = 5
"""A joint: twice the degree, and one."""

MOST = 7
"""Joints that may matter: 5⁷ postures are 78 125."""


@dataclass(frozen=True)
class Series:
    """`f(q) = Σ c_k exp(i k·θ)`, k from -2 to 2 for each of the joints that matter.

    - `grid`: of which joints.
    - `coefficients`: c_k [K ...].
    """

    grid: Grid
    coefficients: Any

    def bound(self) -> Floats:
        """`Σ |c_k|`, which no |f| exceeds [...]."""
        return np.abs(self.coefficients).sum(axis=0)

    def slopes(self) -> Floats:
        """What no |∂f/∂q_j| exceeds [... n]: `Σ |k_j| |c_k|`, and Markov's `4 Σ |c_k|/a` for a prismatic joint."""
        size = np.abs(self.coefficients)
        found = np.zeros((*size.shape[1:], self.grid.size))
        for at, joint in enumerate(self.grid.joints):
            k = np.abs(self.grid.degrees[:, at])
            weight = k if self.grid.turns[joint] else 4.0 * (k > 0) / self.grid.half[joint]
            found[..., joint] = np.tensordot(weight, size, axes=1)
        return found


@dataclass(frozen=True)
class Grid:
    """Postures that tell all of M and G.

    - `joints`: on which these depend.
    - `turns`: whether each joint of the arm turns [n].
    - `middle`, `half`: of the way of each prismatic joint [n], m; 0 and 1 for one that turns.
    """

    joints: tuple[int, ...]
    turns: Floats
    middle: Floats
    half: Floats

    @classmethod
    def of(cls, at: Callable[[Floats], Floats], units: tuple[str, ...], lower: Floats, upper: Floats) -> Grid:
        """The grid of the joints that matter, which are found by postures drawn at random.

        - `at`: from postures [N n] to all values [N F].
        - `units`: of the joints.
        - `lower`, `upper`: ends of the prismatic joints [n], m; those of others are not used.

        Raises DefinitionError if more joints matter than can be done.
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
            raise DefinitionError(f"the inertia depends on {len(joints)} joints, and at most {MOST} can be done")
        return cls(joints, turns, middle, half)

    @property
    def size(self) -> int:
        """n, the joints of the arm."""
        return len(self.turns)

    @property
    def postures(self) -> Floats:
        """All of them [5^J n]."""
        angles = np.array(list(product(2.0 * np.pi * np.arange(POINTS) / POINTS, repeat=len(self.joints))))
        q = np.tile(self.middle, (len(angles), 1))
        for k, joint in enumerate(self.joints):
            q[:, joint] = (
                angles[:, k] if self.turns[joint] else self.middle[joint] + self.half[joint] * np.cos(angles[:, k])
            )
        return q

    @property
    def degrees(self) -> Floats:
        """The k of each coefficient [5^J J]."""
        harmonics = np.fft.fftfreq(POINTS, 1.0 / POINTS)
        count = len(self.joints)
        # Its length is said, since no -1 stands for it where no joint matters.
        return np.array(list(product(harmonics, repeat=count))).reshape(POINTS**count, count)

    def series(self, values: Floats) -> Series:
        """The series of what was evaluated.

        - `values`: at the postures [5^J ...].
        """
        axes = tuple(range(len(self.joints)))
        shaped = values.reshape(*[POINTS] * len(self.joints), *values.shape[1:])
        coefficients = np.fft.fftn(shaped, axes=axes) / len(values) if axes else shaped[None]
        return Series(self, coefficients.reshape(len(values), *values.shape[1:]))

    def rates(self) -> Floats:
        """D_j [n] with which `|f(q + e) - f(q)| <= D·|e| sup|f|` and the second derivative is within `(D·|e|)² sup|f|`.

        By Bernstein's inequality for a joint that turns, by Markov's for one that slides; of M's degree.
        """
        found = np.zeros(self.size)
        for joint in self.joints:
            found[joint] = 2.0 if self.turns[joint] else 4.0 / self.half[joint]
        return found


def require_independent_joints(robot: AbstractRobot) -> None:
    """Raise DefinitionError for an arm whose joints follow others.

    There M is no polynomial of degree 2 in a joint: a follower at the ratio 2 doubles the degree, one at 0.5 has none.

    - `robot`: any arm.
    """
    if isinstance(robot, Coupled):
        raise DefinitionError(
            f"joint `{robot.followers[0]}` of {robot.name} follows another one, so that M is no polynomial of degree 2 "
            "in cosine and sine of the joints, from which its bounds come"
        )
