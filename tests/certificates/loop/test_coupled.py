"""The joints' loops as one: what they do is what one matrix K at a time makes known, and a push for the rest."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from slidax.certificates.arm.members import Members
from slidax.certificates.loop.coupled_kernels import CoupledKernels, length_of
from slidax.certificates.loop.coupled_known import begun, pushed
from slidax.certificates.loop.coupled_maps import CoupledMaps
from slidax.certificates.loop.kernels import ACCELERATION, ERROR, ESTIMATE, LED, MISSED, SHIFT, Kernels
from slidax.certificates.loop.proved import proved
from slidax.certificates.loop.signals import entries
from slidax.certificates.loop.together import Together
from slidax.diagnosis.linear_loop import LinearLoop

from .test_sets import SETS, share_of_the_bound, subject_of

LOOPS = tuple(LinearLoop(1e-3, 7.0, 1.0, gains, False) for gains in [(0.24, 0.034, 0.0024), (0.39, 0.095, 0.0116)])
MATRIX = np.array([[0.9, 0.3], [0.2, 1.1]])
EVERY = (LED, ERROR, MISSED, SHIFT, ACCELERATION, ESTIMATE)


def kernels_of(matrix):
    maps = CoupledMaps.of(LOOPS, matrix)
    length = length_of([maps])
    return maps, CoupledKernels.of(maps, LOOPS[0], length)


def test_joints_that_do_not_move_each_other_have_the_loops_that_each_has_by_itself():
    kappa = np.array([0.9, 1.2])
    _, found = kernels_of(np.diag(kappa))
    alone = Kernels.of(LOOPS, kappa[:, None])
    for kind, one in enumerate((alone.of_push, alone.of_place, alone.of_change)):
        whole = found.older[kind].reshape(9, 2, -1, 2).sum(axis=2) + found.newest[kind]
        if kind < 2:
            assert np.abs(whole[:, 0, 1]).max() == np.abs(whole[:, 1, 0]).max() == 0.0
        for i in range(2):
            sums = one[:, i, 0].sum(axis=1)
            # Of the acceleration that a joint commands, and not of what it then does.
            sums[ACCELERATION] /= kappa[i]
            outputs = [k for k in EVERY if kind < 2 or k not in (LED, ERROR)]
            np.testing.assert_allclose(whole[outputs, i, i], sums[outputs], rtol=2e-3)


def run_of(matrices, push, start):
    """The loops with another K in each period: e and each joint's `a + w*` when torques set in [N n]."""
    state, rows = start, []
    for k, matrix in enumerate(matrices):
        maps = CoupledMaps.of(LOOPS, matrix)
        rows.append(maps.asked @ state)
        state = maps.step @ state + maps.enters[3] @ push[k] + maps.enters[4] @ push[k + 1]
    asked = np.array(rows)
    command = asked[:-1, 4]
    ends = [command + push[k : k + len(command)] for k in (1, 2)]
    return asked[1:, 0], np.max(np.abs(ends), axis=0)


def test_what_the_loops_do_under_a_known_push_is_known_exactly():
    maps, _ = kernels_of(MATRIX)
    t = np.arange(400)
    push = 1e-6 * np.stack([np.sin(t / 30.0), np.cos(t / 17.0)], axis=1)
    start = np.zeros(maps.step.shape[0])
    for j in range(2):
        start[j * maps.own + 2], start[j * maps.own + 5] = -push[0, j], push[0, j]
    e, _ = run_of([MATRIX] * 300, push, start)
    sizes, _ = pushed(
        maps, LOOPS[0], MATRIX, (push.T[None].swapaxes(1, 2), np.zeros((0, 400, 2))), range(200, 260), 512
    )
    np.testing.assert_allclose(sizes[:, 1, ERROR], e[200:260], rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(sizes[:, 0, ERROR], -e[200:260], rtol=1e-9, atol=1e-16)


def test_no_run_with_a_matrix_that_moves_exceeds_what_is_counted():
    count, edges = 320, (0, 64, 128, 192, 256, 320)
    t = np.arange(count + 8)
    moved = MATRIX + 0.1 * np.sin(t / 100.0)[:, None, None] * np.array([[0.3, 1.0], [1.0, 0.2]])
    later = np.maximum(t - 3, 0)
    push = 1e-6 * np.stack([np.cos(later / 30.0), np.sign(np.cos(later / 40.0))], axis=1)
    # What is taken for K is wrong by more than it moves.
    matrices = np.array([0.5 * (moved[a + 1] + moved[b]) - 0.15 for a, b in pairwise(edges)])
    maps = [CoupledMaps.of(LOOPS, one) for one in matrices]
    length = length_of(maps)
    kernels = [CoupledKernels.of(one, LOOPS[0], length) for one in maps]
    # A torque sets in one sample after its decision.
    after = moved[1 : count + 1]
    together = Together(edges, matrices, kernels, after, after, np.zeros_like(after), np.zeros((1, 2)))
    beside = np.zeros((1, 9, 2))
    beside[0, 0] = 1e-7
    start = np.zeros(maps[0].step.shape[0])
    for j in range(2):
        at = j * maps[0].own
        start[at + 2], start[at + 5] = -push[0, j], push[0, j]
        # Where the plan asks for no acceleration.
        start[at : at + 9] += 1e-7 * entries(LOOPS[j], 0.0, beside[:, :, j])[0][:, 0]
    e, asked = run_of(moved[: count + 1], push, start)
    nothing = np.zeros((count, 2))
    before = together.before(asked[:count], nothing, nothing, nothing, 0.0)[:, 0, ERROR]
    worst = 0.0
    for i, (a, b) in enumerate(pairwise(edges)):
        given = (push.T[None].swapaxes(1, 2), np.zeros((0, len(t), 2)))
        known, _ = pushed(maps[i], LOOPS[0], matrices[i], given, range(a, b), 512)
        alone, _ = begun(maps[i], LOOPS, np.zeros(2), beside, range(a, b))
        unknown = np.abs(e[a:b] - known[:, 1, ERROR])
        assert (unknown <= (before[a:b] + alone[:, ERROR]) * (1.0 + 1e-9)).all()
        worst = max(worst, float(np.max(unknown / (before[a:b] + alone[:, ERROR]))))
    assert worst > 0.5


def test_the_halves_of_a_set_meet_in_its_middle_and_end_where_it_does():
    whole = Members.of(subject_of("example-4.1-1khz", SETS["masses"], {}).scenario)
    halves = [whole.within(0, low, low + 0.5) for low in (0.0, 0.5)]
    ends = np.array([[0.0, 0.3], [1.0, 0.3]])
    path = "robot.plant.masses"
    there = np.concatenate([one.values(ends)[path] for one in halves])
    np.testing.assert_allclose(
        there[:, 0], whole.values(np.array([[x, 0.3] for x in (0.0, 0.5, 0.5, 1.0)]))[path][:, 0]
    )
    np.testing.assert_allclose(there[:, 1], whole.values(ends)[path][0, 1])


SLOW = {"scheme.sampled_data.adaptation": None, "simulation.t1": 4.0}
PANDA = {**SLOW, "robot.plant.coulomb": 0.05, "robot.plant.load.mass": 0.5}
UR5E = {**SLOW, "robot.plant.coulomb": 0.05, "robot.plant.load.mass": 0.5}
ARMS = [
    (
        "panda-payload",
        {"robot.plant.load.mass": {"between": [0.4, 0.6]}, "start.q": {"around": 0.05, "each": "joint"}},
        PANDA,
    ),
    (
        "ur5e-payload",
        {"robot.plant.load.mass": {"between": [0.4, 0.6]}, "robot.plant.mass_factor": {"between": [0.85, 0.9]}},
        UR5E,
    ),
]


@pytest.mark.full
@pytest.mark.parametrize("case", ARMS, ids=["panda", "ur5e"])
def test_arms_of_six_and_seven_joints_hold_and_no_case_exceeds_its_bound(case):
    subject = subject_of(*case)
    whole = proved(subject)
    assert whole.holds
    assert share_of_the_bound(subject, whole, 32, 3) <= 1.0
