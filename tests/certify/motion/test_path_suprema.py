"""Suprema along a motion against gradient ascents on the quantities, at any time of a cell and place of the tube."""

from collections.abc import Callable
from functools import cache, cached_property
from typing import Any

import jax
import numpy as np
import pytest

from slidax.certify.motion.body_points import BodyPoints, frame_motion
from slidax.certify.motion.parameter_region import BodyBand
from slidax.certify.motion.path import Path
from slidax.certify.motion.path_cells import PathCells, Pieces
from slidax.certify.motion.path_suprema import Suprema, suprema
from slidax.certify.motion.path_tube import Tube

from .cases import knotted, panda, quintic, ur5e

WIDTH, SPEED = 2e-3, 0.1


@cache
def case(name: str) -> tuple[Any, Any, PathCells, Path, Tube, Suprema]:
    arm = {"panda": panda, "ur5e": ur5e}[name.split()[0]]()
    make = {"quintic": quintic, "knotted": knotted}[name.split()[1]]
    motion = make(arm, np.random.default_rng(4), 0.8)
    cells = PathCells.of(motion, 1e-3)
    bodies = BodyPoints.of(arm)
    path = Path.of(bodies, BodyBand(0.05, 0.05).region(bodies), cells)
    wide = np.ones_like(cells.speed)
    norm = SPEED * np.sqrt(np.einsum("ni,nij,nj->n", wide, np.abs(path.mass), wide)) * 1.05
    tube = Tube(WIDTH * wide, SPEED * wide, norm, SPEED * wide, norm, 5.0 * wide, 50.0 * norm, 5.0 * wide, 50.0 * norm)
    bounds = suprema(path, tube)
    assert bounds is not None
    return arm, motion, cells, path, tube, bounds


class Point:
    """The arm at points; its parts agree with the arm's own equations (test_body_points.py)."""

    def __init__(self, bodies: BodyPoints, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> None:
        points = frame_motion(bodies, q, dq, ddq, np.zeros_like(q)).of(bodies.points)
        y, y1, _ = points.columns
        t = y.swapaxes(1, 2)
        self.mass = t @ y + np.diag(bodies.rotors)
        self.inverse = np.linalg.inv(self.mass)
        self.root = np.linalg.inv(np.linalg.cholesky(self.mass)).swapaxes(1, 2)
        self.coriolis = 2.0 * t @ y1
        self.rate = t @ y1 + y1.swapaxes(1, 2) @ y
        self.bodies, self.q, self.dq, self.ddq = bodies, q, dq, ddq

    @cached_property
    def stiffness(self) -> np.ndarray:
        """Derivative of the inverse dynamics by the positions; computed on demand, because it takes long."""
        step = 1e-6
        ahead, behind = (
            np.stack(
                [self.force(self.bodies, self.q + s, self.dq, self.ddq) for s in side * step * np.eye(self.q.shape[1])],
                axis=2,
            )
            for side in (1.0, -1.0)
        )
        return np.asarray((ahead - behind) / (2.0 * step))

    @property
    def by_joints(self) -> np.ndarray:
        """Norms of the derivatives of M0 by each joint."""
        step, nothing, norms = 1e-6, np.zeros_like(self.q), []
        for row in step * np.eye(self.q.shape[1]):
            ahead, behind = (
                frame_motion(self.bodies, self.q + shift, nothing, nothing, nothing).of(self.bodies.points).columns[0]
                for shift in (row, -row)
            )
            slope = (ahead.swapaxes(1, 2) @ ahead - behind.swapaxes(1, 2) @ behind) / (2.0 * step)
            norms.append(self.norm(slope))
        return np.stack(norms, axis=1)

    @staticmethod
    def force(bodies: BodyPoints, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        points = frame_motion(bodies, q, dq, ddq, np.zeros_like(q)).of(bodies.points)
        return np.einsum("ndk,nd->nk", points.columns[0], points.acceleration)

    def norm(self, form: np.ndarray) -> np.ndarray:
        return np.linalg.norm(self.root.swapaxes(1, 2) @ form @ self.root, 2, axis=(1, 2))


QUANTITIES: dict[str, Callable[[Point], np.ndarray]] = {
    "conversion": lambda at: np.sqrt(np.diagonal(at.inverse, axis1=1, axis2=2)),
    "growth": lambda at: 0.5 * at.norm(at.rate),
    "coriolis": lambda at: at.norm(at.coriolis),
    "coriolis_rows": lambda at: np.linalg.norm(at.inverse @ at.coriolis @ at.root, axis=2),
    "coriolis_entries": lambda at: np.abs(at.inverse @ at.coriolis),
    "coriolis_torques": lambda at: np.linalg.norm(at.coriolis @ at.root, axis=2),
    "change_torques": lambda at: np.linalg.norm(at.rate @ at.root, axis=2),
    "stiffness": lambda at: at.norm(at.stiffness),
    "stiffness_entries": lambda at: np.abs(at.inverse @ at.stiffness),
    "per_command": lambda at: at.by_joints,
    "inverse": lambda at: np.abs(at.inverse),
    "inertia": lambda at: np.abs(at.mass),
}


def ascend(name: str, which: str, starts: int, steps: int) -> float:
    """The largest ratio of a quantity to its stored bound after ascents from corner to corner of cell and tube."""
    _, motion, cells, path, _, bounds = case(which)
    rng, quantity = np.random.default_rng(1), QUANTITIES[name]
    # Half of the starts are where the bound is largest.
    bound = getattr(bounds, name).reshape(len(cells.q), -1)
    cell = rng.integers(len(bound), size=starts)
    cell[: starts // 2] = np.argsort(bound.max(axis=1))[-1 - np.arange(starts // 2) % 8]
    t = cells.centres[cell] + rng.choice([-1.0, 0.0, 1.0], size=starts) * cells.half * (1 - 1e-9)
    q, dq, ddq, _ = Pieces.of(motion).at(t)
    n = q.shape[1]
    corner = rng.choice([-1.0, 1.0], size=(starts, 2 * n))
    entry = np.full(starts, -1)

    def ratios(corner: np.ndarray) -> np.ndarray:
        shift_q, shift_v = WIDTH * corner[:, :n], SPEED * corner[:, n:]
        repeat = len(corner) // starts
        at = Point(
            path.bodies, *(np.repeat(part, repeat, axis=0) + s for part, s in ((q, shift_q), (dq, shift_v), (ddq, 0)))
        )
        return quantity(at).reshape(len(corner), -1) / np.repeat(bound[cell], repeat, axis=0)

    worst = 0.0
    for _ in range(steps):
        here = ratios(corner)
        worst = max(worst, float(here.max()))
        entry = here.argmax(axis=1)
        moved = np.repeat(corner[:, None], 2 * n, axis=1)
        moved[:, np.arange(2 * n), np.arange(2 * n)] *= 1.0 - 1e-4
        there = ratios(moved.reshape(-1, 2 * n)).reshape(starts, 2 * n, -1)
        rows = np.arange(starts)
        slope = (here[rows, entry][:, None] - there[rows, :, entry]) * corner
        corner = np.where(slope >= 0.0, 1.0, -1.0)
    return worst


@pytest.mark.parametrize("name", QUANTITIES)
def test_no_gradient_ascent_exceeds_the_bounds_along_the_motion(name: str) -> None:
    assert 0.1 < ascend(name, "panda knotted", 24, 3) <= 1.0


@pytest.mark.full
@pytest.mark.parametrize("which", ["panda quintic", "panda knotted", "ur5e quintic", "ur5e knotted"])
@pytest.mark.parametrize("name", QUANTITIES)
def test_no_long_gradient_ascent_exceeds_the_bounds_along_the_motion(name: str, which: str) -> None:
    assert ascend(name, which, 1000, 5) <= 1.0


def test_band_bounds_along_the_motion_hold_for_random_members() -> None:
    """`M0⁻¹ (E q̈ + Δn)` per joint, in the metric, and its rate, for members at the edge of the band."""
    from .plant import Chain
    from .test_body_points import torque_of

    arm, motion, cells, _, _, bounds = case("panda knotted")
    rng, chain = np.random.default_rng(0), Chain.of(arm)
    step = 1e-5
    for _ in range(5):
        member = chain.member(rng, 0.05)
        cell = rng.integers(len(cells.q), size=40)
        t = cells.centres[cell] + rng.uniform(-1, 1, size=40) * cells.half * 0.99
        values = []
        for time in (t, t + step):
            q, dq, ddq, _ = Pieces.of(motion).at(time)
            apart = torque_of(member, q, dq, ddq) - torque_of(chain, q, dq, ddq)
            mass = np.asarray(jax.vmap(arm.mass)(q))
            values.append(np.linalg.solve(mass, apart[..., None])[..., 0])
        assert np.all(np.abs(values[0]) <= bounds.band_joints[cell])
        assert np.all(np.sqrt(np.einsum("ni,nij,nj->n", values[0], mass, values[0])) <= bounds.band[cell])
        rate = (values[1] - values[0]) / step
        assert np.all(np.sqrt(np.einsum("ni,nij,nj->n", rate, mass, rate)) <= bounds.band_rate[cell] * 1.001 + 1e-6)


def test_motion_bounds_of_a_path_cell_hold_between_its_samples() -> None:
    _, motion, cells, *_ = case("panda knotted")
    pieces = Pieces.of(motion)
    t = np.linspace(0.0, (2 * len(cells.q) - 1) * cells.half, 50_001)
    index = np.minimum((t / (2 * cells.half)).astype(int), len(cells.q) - 1)
    for order, bound in enumerate((cells.speed, cells.acceleration, cells.jerk), start=1):
        value = np.abs(pieces.at(t)[order])
        assert np.all(value <= bound[index] * (1 + 1e-12) + 1e-12)
        assert value.sum() > 0.8 * bound[index].sum()
