"""Bounds of torques and torque steps against adversarial runs of an independent plant."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from slidax.certify.motion.body_points import BodyPoints, frame_motion
from slidax.certify.motion.drive_limits import DriveBounds, Torques, drive_bounds
from slidax.certify.motion.joint_loop import JointLoop
from slidax.certify.motion.lagged_sums import Lags
from slidax.certify.motion.tracking_bound import CertifiedPath, certified_path

from .cases import desired, panda
from .plant import Chain, PaperPlan, simulate
from .test_tracking_bound import short, uncertainty

LOOPS = {
    "fast": (JointLoop.with_density(1e-3, 0.007, 3.0, 1e-5, 1), 1e-5),
    "smooth": (JointLoop.with_density(1e-3, 0.02, 0.03, 1e-6, 1), 1e-6),
}


@cache
def case(name: str, seed: int) -> tuple[Any, Any, CertifiedPath, DriveBounds]:
    arm, (loop, resolution) = panda(), LOOPS[name]
    motion = short(arm, seed, 0.3)
    certified = certified_path(arm, motion, loop, uncertainty(0.02, resolution=resolution))
    assert certified.bounds.verified
    return arm, motion, certified, drive_bounds(arm, certified.solution)


def attacked_torques(
    arm: Any,
    motion: Any,
    certified: CertifiedPath,
    rng: np.random.Generator,
    run: int,
    plan: PaperPlan | None = None,
) -> np.ndarray:
    """Torques of one adversarial run [slots n]."""
    loop, cells = certified.loop, certified.path.cells
    slots, sub, coulomb = len(cells.q) * cells.per_cell, 4, np.asarray(certified.inputs.coulomb)
    nominal = Chain.of(arm)
    push, friction = None, coulomb
    if run % 2:
        pace = rng.integers(2, 40)
        push = np.repeat(rng.choice([-1.0, 1.0], size=(slots * sub // pace + 1, arm.joints)), pace, axis=0)
        push, friction = push[: slots * sub] * coulomb, None
    return simulate(
        nominal.member(rng, 0.02),
        nominal,
        loop,
        desired(motion, loop.period, slots, sub, loop.delay),
        slots,
        sub,
        push=push,
        coulomb=friction,
        resolution=float(certified.inputs.resolution[0]),
        phase=rng.random(arm.joints),
        plan=plan,
    ).torque


@pytest.mark.parametrize("name", LOOPS)
def test_adversarial_runs_stay_within_the_torque_and_torque_step_bounds(name: str) -> None:
    rng = np.random.default_rng(0)
    for seed in (0, 1):
        arm, motion, certified, bounds = case(name, seed)
        cells = certified.path.cells
        for run in range(4):
            torque = attacked_torques(arm, motion, certified, rng, run)
            step = np.abs(np.diff(torque, axis=0, prepend=torque[:1]))
            for value, bound in ((np.abs(torque), bounds.torque), (step, bounds.step)):
                largest = value.reshape(len(cells.q), -1, arm.joints).max(axis=1)
                assert np.all(largest <= bound)


class Moves:
    """The model's arguments at two successive samples, as shares between -1 and 1 of their bounds."""

    def __init__(self, name: str, seed: int, starts: int) -> None:
        self.arm, _, certified, _ = case(name, seed)
        bounds, cells, rng = certified.bounds, certified.path.cells, np.random.default_rng(seed)
        torques = Torques(certified.solution.problem, bounds)
        cell = rng.integers(len(cells.q), size=starts)
        sample = cell * cells.per_cell + rng.integers(cells.per_cell, size=starts)
        h = cells.period
        times = np.maximum(sample[:, None] + np.arange(-1, 2), 0) * h
        q, dq = (part.reshape(starts, 3, -1) for part in cells.pieces.at(times.reshape(-1))[:2])
        mean = np.diff(dq, axis=1) / h
        self.plan = q[:, :2] + 0.5 * h * dq[:, :2] + 0.125 * h * h * mean, dq[:, :2] + 0.5 * h * mean, mean
        names = "model_position", "model_velocity", "command", "model_position_step", "model_velocity_step"
        self.sizes = [bounds.outputs[each][cell] for each in names]
        self.norms = [bounds.norms[each][cell] for each in names]
        self.state, self.step = (
            torques.moved("model_position", "model_velocity")[cell],
            (torques.state_step() + torques.turning())[cell],
        )
        self.bodies, self.places = BodyPoints.of(self.arm), rng.choice([-1.0, 1.0], size=(starts, 5, self.arm.joints))

    def model(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The nominal arm's torque and inertia."""
        points = frame_motion(self.bodies, q, dq, ddq, np.zeros_like(q)).of(self.bodies.points)
        y, rotors = points.columns[0], self.bodies.rotors
        return np.einsum("ndk,nd->nk", y, points.acceleration) + rotors * ddq, y.swapaxes(1, 2) @ y + np.diag(rotors)

    def ratios(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Deviation of the model's torque from the plan, and its step with that of `M0 s`, relative to their bounds."""
        (q, dq, ddq), repeat = self.plan, len(places) // len(self.step)
        q, dq, ddq = (np.repeat(part, repeat, axis=0) for part in (q, dq, ddq))
        planned, masses = zip(*(self.model(q[:, k], dq[:, k], ddq[:, k]) for k in range(2)), strict=True)
        offs, mass = [], masses[1]
        for k, (size, norm) in enumerate(zip(self.sizes, self.norms, strict=True)):
            off = places[:, k] * np.repeat(size, repeat, axis=0)
            most = np.sqrt(np.einsum("ni,nij,nj->n", off, mass, off))
            # The metric differs a little from that of the bound.
            offs.append(off * np.minimum(0.98 * np.repeat(norm, repeat) / np.maximum(most, 1e-12), 1.0)[:, None])
        place, speed, command, moved, faster = offs
        apart, inertias = [], []
        for k, (e, v) in enumerate(((place - moved, speed - faster), (place, speed))):
            torque, inertia = self.model(q[:, k] + e, dq[:, k] + v, ddq[:, k])
            apart.append(torque - planned[k])
            inertias.append(inertia)
        step = apart[1] - apart[0] + np.einsum("nij,nj->ni", inertias[1] - inertias[0], command)
        state, whole = (np.repeat(part, repeat, axis=0) for part in (self.state, self.step))
        return np.abs(apart[1]) / state, np.abs(step) / whole

    def climb(self, which: int, rounds: int) -> float:
        """Largest ratio after rounds in which each share moves to the end that increases it."""
        places, worst = self.places, 0.0
        shape = places[0].size
        for _ in range(rounds):
            here = self.ratios(places)[which]
            worst, joint = max(worst, float(here.max())), here.argmax(axis=1)
            moved = np.repeat(places.reshape(len(places), -1), shape, axis=0)
            moved[np.arange(len(moved)), np.tile(np.arange(shape), len(places))] *= 1.0 - 1e-3
            there = self.ratios(moved.reshape(-1, *places.shape[1:]))[which].reshape(len(places), shape, -1)
            rows = np.arange(len(places))
            slope = (here[rows, joint][:, None] - there[rows, :, joint]) * places.reshape(len(places), -1)
            places = np.where(slope >= 0.0, 1.0, -1.0).reshape(places.shape)
        return max(worst, float(self.ratios(places)[which].max()))


@pytest.mark.parametrize("which", [0, 1], ids=["torque", "step"])
def test_model_torque_and_torque_step_stay_within_their_bounds_in_a_search(which: int) -> None:
    assert 0.15 < Moves("smooth", 0, 16).climb(which, 2) <= 1.0


@pytest.mark.full
@pytest.mark.parametrize("which", [0, 1], ids=["torque", "step"])
@pytest.mark.parametrize("name", LOOPS)
def test_model_torque_and_torque_step_stay_within_their_bounds_in_a_long_search(name: str, which: int) -> None:
    assert all(Moves(name, seed, 200).climb(which, 4) <= 1.0 for seed in range(3))


def test_bound_on_the_kernel_weighted_past_change_holds_at_every_sample() -> None:
    rng = np.random.default_rng(0)
    kernel, per_cell, cells = rng.random(37) * 0.9 ** np.arange(37), 4, 12
    rates, sizes = rng.random((cells, 3)), rng.random(cells)
    bound = Lags.of(kernel[:, None], per_cell, 5).past_change(rates, sizes)
    even = Lags.of(kernel[:, None], per_cell, 5).past(sizes[:, None])[..., 0]
    largest = 0.0
    for now in range(cells * per_cell):
        cell = now // per_cell
        sums = np.zeros(3)
        for lag, weight in enumerate(kernel):
            then = max(now - lag, 0) // per_cell
            sums += weight * sizes[then] * rates[then : cell + 1].max(axis=0)
        assert np.all(sums <= bound[cell])
        largest = max(largest, float(np.max(sums / bound[cell])))
    assert largest > 0.7
    np.testing.assert_allclose(
        Lags.of(kernel[:, None], per_cell, 5).past_change(np.full((cells, 1), 2.0), sizes), 2.0 * even
    )


def test_planned_torque_agrees_with_the_simulated_torque_of_an_exactly_known_arm() -> None:
    arm, motion, certified, bounds = case("fast", 0)
    cells, nominal = certified.path.cells, Chain.of(arm)
    slots = len(cells.q) * cells.per_cell
    torque = simulate(
        nominal, nominal, certified.loop, desired(motion, 1e-3, slots, 4, 1), slots, 4, settled=True
    ).torque
    largest = np.abs(torque).reshape(len(cells.q), -1, 7).max(axis=1)
    np.testing.assert_allclose(largest, bounds.planned_torque, atol=0.02)


def test_torque_step_bound_is_from_the_planned_step_to_the_sum_of_its_terms() -> None:
    *_, bounds = case("smooth", 0)
    assert np.all(bounds.step <= sum(bounds.step_terms.values()) * (1 + 1e-9))
    assert np.all(bounds.planned_step <= bounds.step)
