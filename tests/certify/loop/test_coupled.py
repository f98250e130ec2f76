"""All joints as one loop: a time-varying matrix K is known, and its uncertainty enters as a disturbance."""

import numpy as np
import pytest

from slidax.certify.arm.members import Members
from slidax.certify.loop.coupled_bound import CoupledLoops
from slidax.certify.loop.coupled_loop import CoupledMaps, LoopsAlongMotion, adjoint_responses
from slidax.certify.loop.coupled_responses import CoupledResponses, KnownOutputs, initial_columns, loop_memory
from slidax.certify.loop.joint_responses import (
    ACCELERATION,
    ERROR,
    ESTIMATE,
    LED,
    MISSED,
    OUTPUTS,
    SHIFT,
    JointResponses,
)
from slidax.certify.loop.set_bound import set_bound
from slidax.law.joint_loop import LinearLoop

from .test_sets import SETS, share_of_the_bound, subject_of

LOOPS = tuple(LinearLoop(1e-3, 7.0, 1.0, gains, False) for gains in [(0.24, 0.034, 0.0024), (0.39, 0.095, 0.0116)])
MATRIX = np.array([[0.9, 0.3], [0.2, 1.1]])
EVERY = (LED, ERROR, MISSED, SHIFT, ACCELERATION, ESTIMATE)
COUNT, WIDTH, MEMORY = 320, 16, 256
DECISIONS = np.arange(0, COUNT, WIDTH) + WIDTH // 2


def told(along, decisions, pushes, states, memory=MEMORY):
    """The known responses of the coupled loop, and its responses to unknown inputs."""
    kernels = CoupledResponses(along, len(decisions), memory)
    known = KnownOutputs(along, decisions, WIDTH, pushes, initial_columns(along, LOOPS, np.zeros(2), states), memory)
    for back in adjoint_responses(along, decisions, memory):
        kernels.take(back)
        known.take(back)
    kernels.finish()
    known.finish(kernels.later)
    return kernels, known


def test_coupled_responses_without_coupling_equal_single_responses():
    kappa = np.array([0.9, 1.2])
    along = LoopsAlongMotion(LOOPS, np.repeat(np.diag(kappa)[None], 700, axis=0))
    kernels, _ = told(along, np.array([600]), np.zeros((1, 700, 2)), np.zeros((1, 9, 2)), 512)
    alone = JointResponses.of(LOOPS, kappa[:, None])
    for kind, single in enumerate((alone.of_disturbance, alone.of_place, alone.of_change)):
        whole = (kernels.older[kind, 0].sum(axis=0) + kernels.newest[kind, 0]).reshape(OUTPUTS, 2, 2)
        if kind < 2:
            assert np.abs(whole[:, 0, 1]).max() == np.abs(whole[:, 1, 0]).max() == 0.0
        for i in range(2):
            sums = single[:, i, 0].sum(axis=1)
            # Of the acceleration that a joint commands, and not of what it then does.
            sums[ACCELERATION] /= kappa[i]
            outputs = [k for k in EVERY if kind < 2 or k not in (LED, ERROR)]
            np.testing.assert_allclose(whole[outputs, i, i], sums[outputs], rtol=2e-3)
    for i in range(2):
        for name in ("of_command", "noise"):
            whole_sums, sums = getattr(kernels, name), getattr(alone, name)
            whole_sums, sums = (single if name == "noise" else single[None] for single in (whole_sums, sums))
            np.testing.assert_allclose(
                whole_sums[:, 0].reshape(-1, OUTPUTS, 2, 2)[:, LED, i, i], sums[:, LED, i, 0], rtol=2e-3, atol=2e-3
            )


def moved():
    """K in each period."""
    t = np.arange(COUNT + 8)
    return MATRIX + 0.1 * np.sin(t / 30.0)[:, None, None] * np.array([[0.3, 1.0], [1.0, 0.2]])


def started(disturbance, beside):
    """A state in which all loops rest under a disturbance, plus a deviation of each joint."""
    own = CoupledMaps.of(LOOPS, MATRIX).own
    states = np.zeros((2, own))
    states[:, 2], states[:, 5] = -disturbance[0], disturbance[0]
    return (states + beside).reshape(-1)


def run_of(matrices, disturbance, start):
    """The loops with another K in each period: e and each joint's `a + w*` when torques start [N n]."""
    state, rows = start, []
    for k, matrix in enumerate(matrices):
        maps = CoupledMaps.of(LOOPS, matrix)
        rows.append(maps.rows @ state)
        state = maps.step @ state + maps.enters[3] @ disturbance[k] + maps.enters[4] @ disturbance[k + 1]
    outputs = np.array(rows)
    command = outputs[:-1, 4]
    ends = [command + disturbance[k : k + len(command)] for k in (1, 2)]
    return outputs[1:, 0], np.max(np.abs(ends), axis=0)


@pytest.mark.parametrize("memory", [256, 512])
def test_known_disturbance_has_its_exact_response_for_a_varying_coupling(memory):
    matrices, t = moved(), np.arange(COUNT + 8)
    disturbance = 1e-6 * np.stack([np.sin(t / 30.0), np.cos(t / 17.0)], axis=1)
    e, _ = run_of(matrices[: COUNT + 2], disturbance, started(disturbance, 0.0))
    _, known = told(LoopsAlongMotion(LOOPS, matrices), DECISIONS, disturbance[None], np.zeros((1, 9, 2)), memory)
    sizes, _ = known.told(COUNT, 1, 1, False)
    at = DECISIONS
    # Inputs beyond the memory count with their last value.
    close = 1e-9 if memory > COUNT else 1e-3
    scale = np.abs(e).max()
    np.testing.assert_allclose(sizes[at, 1, ERROR], e[at], rtol=0.0, atol=close * scale)
    np.testing.assert_allclose(sizes[at, 0, ERROR], -e[at], rtol=0.0, atol=close * scale)


def test_no_run_with_a_varying_coupling_exceeds_its_bound():
    matrices, t = moved(), np.arange(COUNT + 8)
    later = np.maximum(t - 3, 0)
    disturbance = 1e-6 * np.stack([np.cos(later / 30.0), np.sign(np.cos(later / 40.0))], axis=1)
    # The error of the model's K exceeds its change within a window.
    along = LoopsAlongMotion(LOOPS, matrices - 0.05)
    beside = np.zeros((1, 9, 2))
    beside[0, 0] = 1e-7
    kernels, known = told(along, DECISIONS, disturbance[None], beside)
    start = np.zeros((2, along.own))
    for j in range(2):
        column = initial_columns(along, LOOPS, np.zeros(2), beside)[0][:, j]
        start.reshape(-1)[along.kept] += column
    e, accelerations = run_of(matrices[: COUNT + 1], disturbance, started(disturbance, start))
    # A torque sets in one sample after its decision, and the K of a window is up to half of one away.
    around = [np.roll(along.matrices, -1 + k, axis=0)[:COUNT] for k in range(-WIDTH // 2, WIDTH // 2 + 1)]
    off = np.max([np.abs(matrices[1 : COUNT + 1] - near) for near in around], axis=0)
    off[:WIDTH] = off[-WIDTH:] = off.max()
    together = CoupledLoops(kernels, WIDTH, np.abs(MATRIX) + off, off, np.zeros((1, 2)))
    nothing = np.zeros((COUNT, 2))
    before = together.before(accelerations[:COUNT], nothing, nothing, nothing, 0.0)[:, 0, ERROR]
    sizes, _ = known.told(COUNT, 1, 1, False)
    unknown = np.abs(e[:COUNT] - sizes[:, 1, ERROR])
    bound = before + known.free.reshape(-1, OUTPUTS, 2)[:COUNT, ERROR]
    assert (unknown <= bound * (1.0 + 1e-9)).all() and float(np.max(unknown / bound)) > 0.3


def test_loop_memory_reports_temporary_growth():
    wild = 1.0 + 1.5 * (np.abs(np.arange(1200) - 700) < 100)
    memory = loop_memory(LoopsAlongMotion(LOOPS, MATRIX * wild[:, None, None]), 1200)
    calm = loop_memory(LoopsAlongMotion(LOOPS, np.repeat(MATRIX[None], 1200, axis=0)), 1200)
    assert calm.memory is not None and calm.grown < 1.0 < memory.grown and 600 <= memory.then <= 1199


def test_halves_of_a_set_share_its_middle_and_its_ends():
    whole = Members.of(subject_of("example-4.1-1khz", SETS["masses"], {}).scenario)
    halves = [whole.within(0, low, low + 0.5) for low in (0.0, 0.5)]
    ends = np.array([[0.0, 0.3], [1.0, 0.3]])
    path = "robot.plant.masses"
    there = np.concatenate([half.values(ends)[path] for half in halves])
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
    whole = set_bound(subject)
    assert whole.holds and share_of_the_bound(subject, whole, 32, 3) <= 1.0
