"""Bounds of torques and their steps, attacked on an independent plant."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from slidax.certify.motion.drive_limits import DriveBounds, drive_bounds, drive_verdict
from slidax.certify.motion.joint_loop import JointLoop
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
    """Torques of one attacked run [slots n]."""
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
def test_no_attack_exceeds_the_torque_bounds(name: str) -> None:
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


def test_the_planned_torque_is_the_torque_of_an_exactly_known_arm() -> None:
    arm, motion, certified, bounds = case("fast", 0)
    cells, nominal = certified.path.cells, Chain.of(arm)
    slots = len(cells.q) * cells.per_cell
    torque = simulate(
        nominal, nominal, certified.loop, desired(motion, 1e-3, slots, 4, 1), slots, 4, settled=True
    ).torque
    largest = np.abs(torque).reshape(len(cells.q), -1, 7).max(axis=1)
    np.testing.assert_allclose(largest, bounds.planned_torque, atol=0.02)


def test_the_terms_of_a_torque_step_sum_to_its_bound() -> None:
    *_, bounds = case("smooth", 0)
    assert np.all(bounds.step <= sum(bounds.step_terms.values()) * (1 + 1e-9))
    assert np.all(bounds.planned_step <= bounds.step)


def test_the_verdict_separates_torque_and_step() -> None:
    arm, _, certified, _ = case("fast", 0)
    verdict = drive_verdict(arm, certified)
    assert verdict.holds is False
    assert [line.status for line in verdict.assumptions] == ["proved", "fails"]
    assert "encoder" in verdict.statement
    easy = drive_verdict(arm, certified, torque=500.0, torque_rate=1e5)
    assert easy.holds and easy.grade == "A" and easy.margin is not None and easy.margin > 0.0
