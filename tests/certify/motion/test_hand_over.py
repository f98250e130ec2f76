"""The nonlinear part of a sliding-mode law in its bound along a motion."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax.certify.motion.admission import certified_law, tracking_bound
from slidax.certify.motion.drive_limits import drive_bounds
from slidax.certify.motion.hand_over import HandOver
from slidax.certify.motion.joint_loop import JointLoop
from slidax.certify.motion.loop_kernels import loop_kernels
from slidax.certify.motion.parameter_region import BodyBand
from slidax.certify.motion.path_cells import PathCells
from slidax.certify.motion.tracking_bound import ArmUncertainty, certified_path
from slidax.core.errors import DefinitionError
from slidax.motions.tabulated import Tabulated
from slidax.scenarios.family import Family

from .cases import desired
from .plant import Chain, PaperPlan, simulate
from .test_certified_law import PERIOD, sliding
from .test_drive_limits import attacked_torques
from .test_loop_kernels import LOOPS
from .test_tracking_bound import arm_of, at_the_edge, attack, short, uncertainty

PANDA = "examples/motions/panda.yaml"
SAMPLED = {
    "horizon": 0.03,
    "midpoint": True,
    "viscous_feedforward": True,
    "adaptation": None,
    "estimator": {"kind": "kalman", "acceleration_density": 0.01},
}
PAPER: dict[str, Any] = {
    "name": "cftsmppc",
    "performance": {"kind": "fixed_time", "initial": 0.01, "final": 0.006, "deadline": 0.3, "exponent": 2.01},
    "overshoot": 0.3,
    "surface": {"k1": 0.5, "k2": 1.0, "p": 0.5, "q": 1.2, "delta": 0.01},
    "reaching": {"gain": 0.1, "exponent": 1.2, "layer": 0.0},
    "bound": {"kind": "fixed", "size": 20.0},
    "sampled_data": SAMPLED,
}
SCHEMES: dict[str, dict[str, Any]] = {
    "cftsmppc": PAPER,
    "ftsmc": {"name": "ftsmc", "sampled_data": SAMPLED},
    "slotine_li": {
        "name": "slotine_li",
        "surface": {"rate": 10.0},
        "damping": 5.0,
        "gain": 20.0,
        "layer": 0.0,
        "sampled_data": SAMPLED,
    },
}


def scenario(scheme: dict[str, Any], **changes: Any) -> Any:
    return sx.scenarios.load(PANDA, {"scheme": scheme, "tolerance": None} | changes)


@pytest.mark.parametrize("name", LOOPS)
def test_goal_with_the_signs_of_its_kernel_attains_the_kernel_gain(name: str) -> None:
    loop, count = LOOPS[name], 600
    kernels = loop_kernels(loop)

    def responses(goal: np.ndarray) -> dict[str, np.ndarray]:
        """e, v and s by the equations, for goals indexed by the period in which their command acts."""
        h, delay = loop.period, loop.delay
        e = v = position = speed = push = 0.0
        pending = [(0.0, 0.0)] * delay
        results: dict[str, list[float]] = {"error": [], "velocity": [], "command": [], "led": []}
        leds = [0.0] * delay
        for k in range(len(goal) - delay):
            r = e - position
            position, speed, push = (x + g * r for x, g in zip((position, speed, push), loop.gains, strict=True))
            at, rate = position, speed
            for i, (s, _) in enumerate(pending):
                at, rate = at + h * rate + h * h / 2 * (s + push), rate + h * (s + push)
                if i == 0:
                    position, speed = at, rate
            leds.append(at + loop.lead * rate)
            pending.append((-loop.kp * at - loop.kd * rate + goal[k + delay] - push, push))
            s, _ = pending.pop(0)
            if delay == 0:
                position, speed = position + h * speed + h * h / 2 * (s + push), speed + h * (s + push)
            for key, value in (("error", e), ("velocity", v), ("command", s), ("led", leds[k])):
                results[key].append(value)
            e, v = e + h * v + h * h / 2 * s, v + h * s
        return {key: np.array(value) for key, value in results.items()}

    impulse = np.zeros(count)
    impulse[loop.delay] = 1.0
    single = responses(impulse)
    for output in single:
        kernel = single[output][loop.delay :]
        signs = np.concatenate([np.zeros(loop.delay), np.sign(kernel)[::-1], np.zeros(loop.delay)])
        reached, gain = responses(signs)[output][-1], kernels[output].goal.sum()
        assert 0.99 * gain <= reached <= gain * (1 + 1e-9), output


def place_of_plan(plan: PaperPlan, now: float, y: float, upper: float) -> float:
    """ψ(ε) with `N ψ(ε) + H φ(ε) = y`, by bisection, for the sides (-ϑ, 1) or (-1, ϑ)."""
    lower = -plan.overshoot / upper
    p, d = plan.p, plan.delta
    core = [(p * p / 2 - 5 * p / 2 + 3), (-p * p + 4 * p - 3), (p * p / 2 - 3 * p / 2 + 1)]
    low, high = -100.0, 100.0
    for _ in range(200):
        x = 0.5 * (low + high)
        z, size = np.exp(x), abs(x)
        near = size**p if size >= d else sum(c * d ** (p - i - 1) * size ** (i + 1) for i, c in enumerate(core))
        place = lower * upper * (z - 1.0) / (lower * z - upper)
        value = now * place + plan.horizon * np.sign(x) * (plan.k1 * near + plan.k2 * size**plan.q)
        low, high = (x, high) if value < y else (low, x)
    return float(place)


def test_sliding_mode_goals_stay_within_their_bound_and_nearly_attain_it() -> None:
    plan = PaperPlan(horizon=0.02, initial=0.05, final=0.01, deadline=0.2)
    cells = PathCells.of(short(arm_of("panda"), 0), PERIOD, rest=0.2)
    hand_over = HandOver.of(sliding(arm_of("panda"), plan, 1))
    assert hand_over is not None
    along = hand_over.along(cells)
    rng, shares = np.random.default_rng(0), []
    for _ in range(200):
        cell = int(rng.integers(len(along.now)))
        time = (cell * cells.per_cell + int(rng.integers(cells.per_cell))) * PERIOD
        y = 10.0 ** rng.uniform(-7, -1)
        now, ahead = (float(value[0]) for value in plan.frames(np.array([time]), PERIOD))
        goals = [
            ahead * abs(place_of_plan(plan, now, sign * y, upper)) / plan.horizon**2
            for sign in (-1.0, 1.0)
            for upper in (plan.overshoot, 1.0)
        ]
        shares.append(max(goals) / along.goal(np.full_like(along.now, y))[cell, 0])
    assert max(shares) <= 1.0 and max(shares) > 0.98


def test_adversarial_runs_stay_within_the_bounds_of_a_sliding_mode_law() -> None:
    arm, rng = arm_of("panda"), np.random.default_rng(0)
    # The envelope narrows while the arm moves, so that the goal matters.
    plan = PaperPlan(horizon=0.01, initial=0.05, final=0.01, deadline=0.2)
    law = sliding(arm, plan, 1, density=3.0)
    motion = short(arm, 0)
    certified = certified_path(arm, motion, JointLoop.of(law), uncertainty(0.03), hand_over=HandOver.of(law))
    assert certified.bounds.verified
    assert np.max(certified.bounds.terms["hand-over"]) > 1e-4
    ratios = attack(arm, motion, certified, rng, 9, at_the_edge(0.03), plan=plan)
    assert 0.1 < np.max(ratios) <= 1.0
    drives = drive_bounds(arm, certified.solution)
    for run in range(4):
        torque = attacked_torques(arm, motion, certified, rng, run, plan)
        step = np.abs(np.diff(torque, axis=0, prepend=torque[:1]))
        for value, bound in ((np.abs(torque), drives.torque), (step, drives.step)):
            assert np.all(value.reshape(len(bound), -1, arm.joints).max(axis=1) <= bound)


@pytest.mark.parametrize("joint", [0, 6])
def test_a_disturbance_with_the_signs_of_the_kernel_nearly_attains_the_bound(joint: int) -> None:
    arm = eqx.tree_at(lambda arm: arm.viscous, arm_of("panda"), jnp.zeros(7))
    place = np.array([0.3, -0.4, 0.2, -1.9, 0.1, 1.7, 0.5])
    motion = Tabulated.through([0.0, 0.3], np.stack([place, place]), np.zeros((2, 7)), np.zeros((2, 7)))
    plan = PaperPlan(horizon=0.02, initial=0.0101, final=0.01, deadline=0.2)
    law, force = sliding(arm, plan, 1), 0.01
    loop = JointLoop.of(law)
    known = ArmUncertainty(BodyBand(0.0, 0.0), torque=force, settled=True)
    certified = certified_path(arm, motion, loop, known, hand_over=HandOver.of(law))
    slots, nominal = 301, Chain.of(arm)
    reference = desired(motion, loop.period, slots, 1, loop.delay)
    towards = np.sign(np.linalg.inv(np.asarray(arm.mass(jnp.asarray(place))))[joint])

    def run(push: np.ndarray) -> np.ndarray:
        return (
            simulate(nominal, nominal, loop, reference, slots, 1, push=push, settled=True, trace=True, plan=plan).trace[
                :, 0, 0, joint
            ]
            - place[joint]
        )  # type: ignore[index]

    pulse = np.zeros((slots, 7))
    pulse[0] = 1e-3 * towards
    signs = np.sign(run(pulse)[1:])[::-1].reshape(-1, 1) * towards
    reached = np.max(np.abs(run(force * np.concatenate([signs, np.zeros((1, 7))]))))
    bound = certified.bounds.error.max(axis=0)[joint]
    assert 0.9 * bound <= reached <= bound


@pytest.mark.parametrize("scheme", SCHEMES)
def test_simulated_sliding_mode_arms_stay_within_tracking_bound_and_envelope(scheme: str) -> None:
    whole = scenario(SCHEMES[scheme])
    verdict = tracking_bound(whole)
    assert verdict.holds and verdict.grade == "A"
    family = Family.of(whole.description)
    drawn = family.uncertain.values(np.random.default_rng(0).random((2, family.uncertain.dimensions)))
    times, along = verdict.bound["times"], verdict.bound["error_over_time"]
    for k in range(2):
        log = family.scenario({path: values[k] for path, values in drawn.items()}, "arm").simulate().log
        assert not np.any(log.signals["s_next"]) and np.any(log.signals["s"])
        cell = np.clip(np.searchsorted(times, np.asarray(log.t), side="right") - 1, 0, len(times) - 1)
        assert np.all(np.abs(np.asarray(log.e)) <= along[cell])
        assert (log.envelope is not None) == (scheme == "cftsmppc")
        if log.envelope is not None:
            assert np.all(np.abs(np.asarray(log.e)) < np.minimum(-log.envelope.lower, log.envelope.upper))
    assert any("envelope" in line.text for line in verdict.assumptions) == (scheme == "cftsmppc")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bound": {"kind": "fixed", "size": 2.0}}, "robust torque u"),
        ({"bound": {"kind": "fixed", "size": 0.5}}, "sliding variable"),
        ({"performance": {"kind": "exponential", "initial": 0.0041, "final": 0.004, "rate": 1.0}}, "envelope"),
    ],
)
def test_a_law_that_may_leave_its_linear_region_is_not_certified(changes: dict[str, Any], words: str) -> None:
    verdict = tracking_bound(scenario(PAPER | changes))
    assert verdict.holds is False and words in verdict.statement
    (line,) = (line for line in verdict.assumptions if words in line.text)
    assert line.status == "fails" and line.value is not None and line.value > 1.0


def test_a_start_far_from_the_motion_is_not_certified() -> None:
    start = np.array([0.004, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    performance = {"kind": "exponential", "initial": 0.02, "final": 0.006, "rate": 5.0}
    verdict = tracking_bound(scenario(PAPER | {"performance": performance}, start={"q": start.tolist()}))
    assert verdict.holds is False and "sliding variable" in verdict.statement


def test_a_boundary_layer_is_refused_with_a_remedy_that_works() -> None:
    with pytest.raises(DefinitionError, match="`layer` to 0"):
        certified_law(scenario(PAPER | {"reaching": {"gain": 0.1, "exponent": 1.2, "layer": 0.05}}))
    assert certified_law(scenario(PAPER)).hand_over is not None
