"""Certified errors along motions against adversarial runs of an independent plant."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms.articulated import Articulated
from slidax.certify.motion.joint_loop import JointLoop
from slidax.certify.motion.parameter_region import BodyBand
from slidax.certify.motion.tracking_bound import ArmUncertainty, CertifiedPath, certified_path, motion_bound
from slidax.core.errors import DefinitionError
from slidax.motions.tabulated import Tabulated

from .cases import Members, desired, knotted, panda, quintic, ur5e
from .plant import Chain, PaperPlan, simulate

LOOP = JointLoop.with_density(1e-3, 0.007, 3.0, 1e-5, 1)
SLOW = JointLoop.with_density(2e-3, 0.02, 1.0, 1e-5, 1)


def uncertainty(p: float, **changes: Any) -> ArmUncertainty:
    return replace(ArmUncertainty(BodyBand(p, p), 0.3 * (1 + p), 0.2 * p, resolution=1e-5), **changes)


@cache
def arm_of(name: str) -> Any:
    return {"panda": panda, "ur5e": ur5e}[name]()


def short(arm: Articulated, seed: int, share: float = 0.6) -> Any:
    """A motion of about half a second."""
    rng = np.random.default_rng(seed)
    lower, upper = np.asarray(arm.limits.lower), np.asarray(arm.limits.upper)
    middle = np.clip(0.5 * (lower + upper), -2.0, 2.0)
    ends = middle + rng.uniform(-0.4, 0.4, size=(2, arm.joints))
    duration = max(0.3, float(np.max(1.875 * np.abs(ends[1] - ends[0]) / (share * np.asarray(arm.limits.velocity)))))
    return Tabulated.through([0.0, duration], ends, np.zeros_like(ends), np.zeros_like(ends))


def attack(
    arm: Articulated,
    motion: Any,
    certified: CertifiedPath,
    rng: np.random.Generator,
    runs: int,
    member: Callable[[Chain, np.random.Generator], Chain],
    sub: int = 4,
    plan: PaperPlan | None = None,
) -> np.ndarray:
    """Run members of the region; return the largest ratio of error and speed to their bounds in each run."""
    loop, cells = certified.loop, certified.path.cells
    slots = len(cells.q) * cells.per_cell
    reference = desired(motion, loop.period, slots, sub, loop.delay)
    nominal, coulomb = Chain.of(arm), np.asarray(certified.inputs.coulomb)
    worst = []
    for run in range(runs):
        truth = member(nominal, rng)
        push, friction = None, coulomb
        kind = run % 3
        if kind:
            # Any form within the bound is allowed: reversals of single joints or of all joints together.
            pace = rng.integers(2, 40)
            signs = rng.choice([-1.0, 1.0], size=(slots * sub // pace + 1, arm.joints if kind == 1 else 1))
            push = np.repeat(signs, pace, axis=0)[: slots * sub] * coulomb
            friction = None
        simulated_run = simulate(
            truth,
            nominal,
            loop,
            reference,
            slots,
            sub,
            push=push,
            coulomb=friction,
            resolution=float(np.max(certified.inputs.resolution)),
            phase=rng.random(arm.joints),
            plan=plan,
        )
        ratios = [
            getattr(simulated_run, name).reshape(len(cells.q), -1, arm.joints).max(axis=1)
            / getattr(certified.bounds, name)
            for name in ("error", "velocity")
        ]
        worst.append(float(np.max(ratios)))
    return np.array(worst)


def at_the_edge(p: float) -> Callable[[Chain, np.random.Generator], Chain]:
    """Draw arms at the edge of a band per body."""
    return lambda nominal, rng: nominal.member(rng, p)


def of_the_ellipsoid(members: Members, certified: CertifiedPath) -> Callable[[Chain, np.random.Generator], Chain]:
    """Draw arms of an identified band: at random, and those that maximise terms of the bound where it is largest."""
    cells, region, bounds = certified.path.cells, certified.path.region, certified.bounds
    cell = int(np.argmax(bounds.error.max(axis=1)))
    at = [part[cell][None] for part in (cells.q, cells.dq, cells.ddq)]
    mass, inertia = members.nominal(at[0])[0], members.inertia(at[0])[0]
    torque = members.torque(*at)[0]
    relative = np.linalg.eigh(mass)[1]

    def draw(nominal: Chain, rng: np.random.Generator) -> Chain:
        direction = relative[:, rng.integers(len(mass))]
        share = [
            rng.normal(size=len(region.deviations)),
            np.linalg.solve(mass, torque)[rng.integers(len(mass))],
            np.einsum("i,ijr,j->r", direction, inertia, direction),
        ][rng.integers(3)]
        share = rng.choice([-1.0, 1.0]) * members.admitted(share[None] / np.linalg.norm(share))[0]
        bodies, rotors = (np.tensordot(share, part, axes=1) for part in (region.deviations, region.rotor_deviations))
        viscous = rng.choice([-1.0, 1.0], size=len(mass)) * certified.inputs.viscous_error
        return replace(nominal.deviated(bodies, rotors), viscous=np.maximum(nominal.viscous + viscous, 0.0))

    return draw


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_adversarial_runs_of_identified_arms_stay_within_the_bounds(name: str) -> None:
    members, rng = Members(name), np.random.default_rng(0)
    arm, loop = members.arm, LOOP if name == "panda" else SLOW
    uncertain = replace(ArmUncertainty.identified(arm, members.band, resolution=1e-5), coulomb=0.3, viscous_error=0.02)
    for seed in range(2):
        motion = short(arm, seed)
        certified = certified_path(arm, motion, loop, uncertain)
        assert certified.bounds.verified
        ratios = attack(arm, motion, certified, rng, 9, of_the_ellipsoid(members, certified))
        assert 0.1 < np.max(ratios) <= 1.0


@pytest.mark.full
@pytest.mark.parametrize("make", [quintic, knotted])
@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_long_adversarial_runs_of_identified_arms_stay_within_the_bounds(name: str, make: Any) -> None:
    members, rng = Members(name), np.random.default_rng(1)
    arm, loop = members.arm, LOOP if name == "panda" else SLOW
    base, attacked = ArmUncertainty.identified(arm, members.band, resolution=1e-5), 0
    for run in range(10):
        motion = make(arm, rng, rng.uniform(0.2, 1.0))
        # Every other run has no friction, so that the band dominates.
        uncertain = replace(base, coulomb=0.3 * (run % 2), viscous_error=0.02 * (run % 2))
        certified = certified_path(arm, motion, loop, uncertain)
        if certified.bounds.verified:
            attacked += 1
            assert np.all(attack(arm, motion, certified, rng, 9, of_the_ellipsoid(members, certified)) <= 1.0)
    assert attacked > 0


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_adversarial_runs_of_arms_in_a_band_stay_within_the_bounds(name: str) -> None:
    arm, rng = arm_of(name), np.random.default_rng(0)
    loop = LOOP if name == "panda" else SLOW
    for seed in range(2):
        motion = short(arm, seed)
        certified = certified_path(arm, motion, loop, uncertainty(0.03))
        assert certified.bounds.verified
        ratios = attack(arm, motion, certified, rng, 6, at_the_edge(0.03))
        assert np.all(ratios <= 1.0)
        assert np.max(ratios) > 0.1


@pytest.mark.full
@pytest.mark.parametrize("make", [quintic, knotted])
@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_long_adversarial_runs_of_arms_in_a_band_stay_within_the_bounds(name: str, make: Any) -> None:
    arm, rng = arm_of(name), np.random.default_rng(1)
    loop, attacked = LOOP if name == "panda" else SLOW, 0
    for _ in range(10):
        motion = make(arm, rng, rng.uniform(0.2, 1.0))
        for p in (0.02, 0.05):
            certified = certified_path(arm, motion, loop, uncertainty(p))
            if certified.bounds.verified:
                attacked += 1
                assert np.all(attack(arm, motion, certified, rng, 9, at_the_edge(p)) <= 1.0)
    assert attacked > 0


@pytest.mark.parametrize("joint", [0, 3, 6])
def test_a_disturbance_with_the_signs_of_the_kernel_attains_the_bound_of_a_known_arm(joint: int) -> None:
    # No viscous friction, because it damps the true arm.
    arm = eqx.tree_at(lambda arm: arm.viscous, arm_of("panda"), jnp.zeros(7))
    place = np.array([0.3, -0.4, 0.2, -1.9, 0.1, 1.7, 0.5])
    motion = Tabulated.through([0.0, 0.3], np.stack([place, place]), np.zeros((2, 7)), np.zeros((2, 7)))
    push = 0.02
    known = ArmUncertainty(BodyBand(0.0, 0.0), torque=push, settled=True)
    bound = certified_path(arm, motion, LOOP, known).bounds.error.max(axis=0)
    slots, sub = 301, 8
    nominal = Chain.of(arm)
    reference = desired(motion, LOOP.period, slots, sub, LOOP.delay)
    # The signs of the joint's response to a disturbance in each substep before the last.
    towards = np.sign(np.linalg.inv(np.asarray(arm.mass(jnp.asarray(place))))[joint])
    responses = np.zeros((slots - 1, sub))
    for i in range(sub):
        pulse = np.zeros((slots * sub, 7))
        pulse[i] = 1e-3 * towards
        simulated_run = simulate(nominal, nominal, LOOP, reference, slots, sub, push=pulse, settled=True, trace=True)
        assert simulated_run.trace is not None
        responses[:, i] = simulated_run.trace[1:, 0, 0, joint] - place[joint]
    signs = np.sign(responses)[::-1].reshape(-1, 1) * towards
    worst = simulate(
        nominal,
        nominal,
        LOOP,
        reference,
        slots,
        sub,
        settled=True,
        push=push * np.concatenate([signs, np.zeros((sub, 7))]),
    )
    reached = worst.error.max(axis=0)[joint]
    assert 0.99 * bound[joint] <= reached <= bound[joint]


def test_bounds_grow_with_every_uncertainty() -> None:
    arm = arm_of("panda")
    motion = short(arm, 1)

    def error(p: float = 0.02, rotors: float | None = None, **changes: Any) -> np.ndarray:
        band = BodyBand(p, p if rotors is None else rotors)
        return certified_path(arm, motion, LOOP, uncertainty(0.02, band=band, **changes)).bounds.error

    ladders: list[list[dict[str, Any]]] = [
        [{"p": 0.0, "rotors": 0.02}, {"p": 0.01, "rotors": 0.02}, {}, {"p": 0.03, "rotors": 0.02}],
        [{"rotors": 0.0}, {"rotors": 0.01}, {}, {"rotors": 0.03}],
        [{"coulomb": 0.0}, {"coulomb": 0.1}, {"coulomb": 0.3}],
        [{"viscous_error": 0.0}, {"viscous_error": 0.02}],
        [{"resolution": 0.0}, {"resolution": 1e-6}, {}, {"resolution": 2e-5}],
        [{}, {"torque": 0.1, "torque_rate": 0.1}, {"torque": 0.1, "torque_rate": 1.0}, {"torque": 0.1}],
        [{"settled": True}, {}, {"start_error": 1e-4}, {"start_error": 1e-4, "start_speed": 1e-2}],
    ]
    for ladder in ladders:
        errors = [error(**step) for step in ladder]
        for less, more in itertools.pairwise(errors):
            # Bounds have a relative accuracy of 0.001 and a margin from the step that verifies them.
            assert np.all(less <= more * 1.004)
        assert np.max(errors[0]) < np.max(errors[-1])


def test_tracking_verdict_names_the_joint_and_the_error_term() -> None:
    arm = arm_of("panda")
    motion = short(arm, 1)
    verdict = motion_bound(arm, motion, LOOP, uncertainty(0.02), allowed=1e-3)
    assert verdict.holds
    assert verdict.grade == "B"
    assert verdict.margin is not None and 0.0 < verdict.margin < 1.0
    assert "friction" in verdict.statement and "panda_joint" in verdict.statement
    terms = verdict.bound["terms"]
    assert np.max(verdict.bound["error"]) <= sum(terms.values()) * (1 + 1e-9)
    assert verdict.as_json()["bound"]["terms"]["friction"] > 0.0
    assert motion_bound(arm, motion, LOOP, uncertainty(0.02), allowed=1e-5).holds is False


def test_band_too_wide_for_the_feedback_is_not_certified_with_the_reason() -> None:
    arm = arm_of("panda")
    verdict = motion_bound(arm, short(arm, 1), LOOP, uncertainty(0.2))
    assert verdict.holds is False
    assert "band feedback" in verdict.statement
    assert verdict.assumptions[0].status == "fails"


def test_invalid_arm_uncertainty_is_refused_with_the_field_name() -> None:
    arm = arm_of("panda")
    with pytest.raises(DefinitionError, match="coulomb"):
        ArmUncertainty(BodyBand(0.0, 0.0), coulomb=-1.0)
    with pytest.raises(DefinitionError, match="bodies"):
        BodyBand(1.0, 0.0)
    with pytest.raises(DefinitionError, match="one per joint"):
        motion_bound(arm, short(arm, 1), LOOP, ArmUncertainty(BodyBand(0.0, 0.0), coulomb=[0.1, 0.2]))
