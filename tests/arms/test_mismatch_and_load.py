"""Differences between the true arm and the law's model: masses, friction, rotors and a payload at the tip."""

from __future__ import annotations

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import Articulated, Joint, Mismatch, Payload, TimedPayload, assemble
from slidax.core import semi_implicit_euler
from slidax.core.errors import DefinitionError
from slidax.core.types import State
from slidax.motions import ConstantPosture as Still
from slidax.plant import Constant
from slidax.simulation import Plant, simulate
from tests.arms.point_masses import body_of, points_of
from tests.arms.trees import random_joint, turned
from tests.paper_examples import TWO_LINK
from tests.peers.motion import Motion, States, assert_same, by_slidax, random_states
from tests.simulation.simple import Spring

PAYLOAD = Payload(2.0, (0.05, -0.02, 0.1), np.diag([0.004, 0.005, 0.006]))


def joints() -> list[Joint]:
    rng = np.random.default_rng(8)
    return [
        random_joint(rng, "base", None, armature=0.1, viscous=0.5, coulomb=0.2),
        random_joint(rng, "slide", "base", "prismatic", armature=0.3, viscous=0.1),
        random_joint(rng, "wrist", "slide", coulomb=0.4),
        random_joint(rng, "hand", "wrist", "fixed"),
    ]


@cache
def arm() -> Articulated:
    return assemble(joints(), tip="hand_link", name="arm")


@cache
def states() -> States:
    return random_states(arm(), 50)


def carrying(payload: Payload, robot: Articulated) -> Articulated:
    return eqx.tree_at(lambda a: a.payload, robot, payload)


def random_payload(rng) -> Payload:
    axes = turned(rng)
    return Payload(rng.uniform(0.5, 3.0), rng.normal(size=3) * 0.1, axes @ np.diag(rng.uniform(0.01, 0.02, 3)) @ axes.T)


def test_default_mismatch_leaves_the_nominal_arm():
    assert eqx.tree_equal(Mismatch().applied(arm()), arm())


def test_mass_factor_scales_inertias_by_default():
    lighter = Mismatch(mass_factor=0.85).applied(arm())
    np.testing.assert_allclose(lighter.masses, 0.85 * arm().masses, rtol=1e-15)
    np.testing.assert_allclose(lighter.inertias, 0.85 * arm().inertias, rtol=1e-15)
    both = Mismatch(mass_factor=[1.0, 2.0, 3.0], inertia_factor=[0.5, 1.0, 1.5]).applied(arm())
    np.testing.assert_allclose(both.masses, [1.0, 2.0, 3.0] * np.asarray(arm().masses), rtol=1e-15)
    for i, factor in enumerate((0.5, 1.0, 1.5)):
        np.testing.assert_allclose(both.inertias[i], factor * arm().inertias[i], rtol=1e-15)


def test_unset_mismatch_fields_keep_the_nominal_values():
    lighter = Mismatch(mass_factor=0.85).applied(arm())
    changed = (lighter.masses, lighter.inertias)
    assert eqx.tree_equal(eqx.tree_at(lambda a: (a.masses, a.inertias), arm(), changed), lighter)


@pytest.mark.parametrize("field", ["viscous", "coulomb", "armature"])
@pytest.mark.parametrize("value", [0.7, [0.1, 0.0, 0.3]])
def test_mismatch_friction_and_rotor_inertia_replace_the_nominal_values(field, value):
    true = Mismatch(**{field: value}).applied(arm())
    np.testing.assert_array_equal(getattr(true, field), np.broadcast_to(value, 3))
    assert eqx.tree_equal(eqx.tree_at(lambda a: getattr(a, field), arm(), getattr(true, field)), true)


def test_friction_is_smooth_coulomb_friction_and_viscous_friction():
    dq = np.array([0.02, -1.5, 0.005])
    expected = [0.2 * np.tanh(2.0) + 0.5 * 0.02, 0.1 * -1.5, 0.4 * np.tanh(0.5)]
    np.testing.assert_allclose(arm().friction(jnp.asarray(dq)), expected, rtol=1e-14)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mass_factor": 0.0}, "`Mismatch.mass_factor` must be > 0; got 0"),
        ({"mass_factor": [1.0, -1.0, 1.0]}, "`Mismatch.mass_factor` must be > 0; got -1 for joint 2"),
        ({"inertia_factor": -0.5}, "`Mismatch.inertia_factor` must be > 0; got -0.5"),
        ({"viscous": -0.1}, "`Mismatch.viscous` must be >= 0; got -0.1"),
        ({"coulomb": [0.0, 0.0, float("inf")]}, "`Mismatch.coulomb` must be >= 0; got inf for joint 3"),
        ({"armature": -1.0}, "`Mismatch.armature` must be >= 0; got -1"),
    ],
)
def test_mismatch_value_out_of_range_is_refused_with_its_field_name(fields, message):
    with pytest.raises(DefinitionError, match=message):
        Mismatch(**fields)


@pytest.mark.parametrize("field", ["mass_factor", "inertia_factor", "viscous", "coulomb", "armature"])
def test_mismatch_list_of_wrong_length_is_refused_with_its_field_name(field):
    message = f"`Mismatch.{field}` must be one number or one for each of the 3 joints of arm, base, slide, wrist; got 2"
    with pytest.raises(DefinitionError, match=message):
        Mismatch(**{field: [0.5, 0.5]}).applied(arm())


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mass": -1.0}, "`Payload.mass` must be >= 0 kg; got -1"),
        ({"mass": float("inf")}, "`Payload.mass` must be >= 0 kg; got inf"),
        ({"mass": [1.0, 2.0]}, r"`Payload.mass` must be one number; got shape \[2\]"),
        ({"mass": 1.0, "center": (0.0, float("nan"), 0.0)}, "`Payload.center` must be finite"),
        ({"mass": 1.0, "center": (0.0, 0.1)}, r"`Payload.center` must be 3 numbers; got shape \[2\]"),
        ({"mass": 1.0, "inertia": -0.1}, "`Payload.inertia` must have moments >= 0"),
        ({"mass": 1.0, "inertia": np.diag([0.1, 0.1, -0.01])}, "`Payload.inertia` must have moments >= 0"),
        ({"mass": 1.0, "inertia": [[0.1, 0.05, 0], [0, 0.1, 0], [0, 0, 0.1]]}, "`Payload.inertia` must be symmetric"),
        ({"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}, r"`Payload.inertia` must be one number or 3 x 3; got \[3\]"),
        ({"inertia": 0.1}, "`Payload.mass` must be > 0 kg where there is inertia; got 0"),
    ],
)
def test_impossible_payloads_are_errors_that_name_the_field(fields, message):
    with pytest.raises(DefinitionError, match=message):
        Payload(**fields)


def test_a_spherical_payload_has_the_same_moment_about_every_axis():
    np.testing.assert_array_equal(Payload(1.0, inertia=0.02).inertia, 0.02 * np.eye(3))


def test_joined_payloads_agree_with_the_sum_of_inertias_in_pinocchio():
    pinocchio = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(3)
    for _ in range(5):
        ours, other = random_payload(rng), random_payload(rng)
        first, second = (
            pinocchio.Inertia(float(x.mass), np.array(x.center), np.array(x.inertia)) for x in (ours, other)
        )
        both, expected = ours.joined(other), first + second
        np.testing.assert_allclose(both.mass, expected.mass, rtol=1e-15)
        np.testing.assert_allclose(both.center, expected.lever, rtol=0, atol=1e-15)
        np.testing.assert_allclose(both.inertia, expected.inertia, rtol=0, atol=1e-15)


def test_empty_payload_changes_nothing_when_joined():
    for both in (PAYLOAD.joined(Payload()), Payload().joined(PAYLOAD), PAYLOAD.joined(PAYLOAD.times(jnp.zeros(())))):
        np.testing.assert_allclose(both.mass, PAYLOAD.mass)
        np.testing.assert_allclose(both.center, PAYLOAD.center)
        np.testing.assert_allclose(both.inertia, PAYLOAD.inertia)
    nothing = Payload().joined(Payload())
    assert all(np.all(np.asarray(leaf) == 0) for leaf in jax.tree.leaves(nothing))


def test_arm_with_a_payload_has_the_dynamics_of_a_heavier_last_link():
    """The last link with the payload is composed of point masses before the arm is assembled."""
    *others, hand = joints()
    points = [points_of(float(x.mass), np.array(x.center), np.array(x.inertia)) for x in (hand, PAYLOAD)]
    mass, center, inertia = body_of(*points)
    heavy = Joint(
        "hand", "fixed", "wrist", "hand_link", hand.rotation, hand.translation, hand.axis, mass, center, inertia
    )
    expected = by_slidax(assemble([*others, heavy], tip="hand_link"), states())
    loaded = by_slidax(carrying(PAYLOAD, arm()), states())
    assert_same(loaded, expected)
    assert np.abs(expected.mass - by_slidax(arm(), states()).mass).max() > 0.1


def test_a_factor_on_all_masses_scales_inertia_matrix_and_bias():
    still = Mismatch(armature=0.0).applied(arm())
    light, plain = (by_slidax(robot, states()) for robot in (Mismatch(mass_factor=0.85).applied(still), still))
    expected = Motion(
        0.85 * plain.mass, 0.85 * plain.bias, 0.85 * plain.gravity, light.acceleration, plain.tip, plain.tip_axes
    )
    assert_same(light, expected)


def test_timed_payload_acts_from_pick_up_to_release():
    always = TimedPayload(PAYLOAD)
    assert (float(always.attached), float(always.released)) == (0.0, np.inf)
    own, load = Payload(0.7, (0.0, 0.0, 0.05), 0.001), TimedPayload(PAYLOAD, 0.5, 2.0)
    robot = carrying(own, arm())
    times = [0.0, np.nextafter(0.5, 0.0), 0.5, 1.2, np.nextafter(2.0, 0.0), 2.0, 9.0]
    loaded = jax.jit(jax.vmap(lambda t: load.on(robot, t)))(np.array(times))
    for k, carried in enumerate([False, False, True, True, True, False, False]):
        now = jax.tree.map(lambda leaf, k=k: np.asarray(leaf)[k], loaded)
        for part, expected in zip(
            *map(jax.tree.leaves, (now.payload, own.joined(PAYLOAD) if carried else own)), strict=True
        ):
            np.testing.assert_allclose(part, expected, rtol=1e-14)
        assert eqx.tree_equal(jax.tree.map(np.asarray, robot), carrying(jax.tree.map(np.asarray, own), now))


@pytest.mark.parametrize("released", [1.0, 0.5])
def test_release_before_pick_up_is_an_error(released):
    with pytest.raises(DefinitionError, match=r"`TimedPayload.released` must be .*`attached` = 1.0.*; got"):
        TimedPayload(PAYLOAD, 1.0, released)


def test_paper_arms_carry_no_payload():
    with pytest.raises(DefinitionError, match="a TwoLink has no tip to carry a payload; use an articulated arm"):
        TimedPayload(PAYLOAD).on(TWO_LINK, jnp.asarray(0.0))


PERIOD = 2.0**-10
"""A power of two, so that the sum of two times has no rounding."""


def moved(plant: Plant, state: State, periods: int, *, log_every: int | None = None):
    n = plant.robot.joints
    law = Spring(jnp.asarray([200.0, 400.0, 30.0]), jnp.asarray([20.0, 40.0, 3.0]), n)
    how = {"t1": periods * PERIOD, "period": PERIOD, "substeps": 4, "integrator": semi_implicit_euler}
    return simulate(plant, law, Still([0.3, -0.1, 0.5]), state, log_every=log_every, **how)


def test_run_with_a_timed_payload_equals_three_joined_runs():
    """The run has no payload, then a payload, then none again; positions and velocities do not jump."""
    start = State(q=jnp.zeros(3), dq=jnp.asarray([0.5, -0.2, 1.0]))
    push = Constant([1.0, -2.0, 0.5])
    load = TimedPayload(PAYLOAD, 100 * PERIOD, 150 * PERIOD)
    mismatch = Mismatch(mass_factor=0.9, viscous=[0.4, 0.2, 0.1], load=load)
    whole = moved(Plant.of_nominal(arm(), mismatch, push), start, 220, log_every=1)
    true = mismatch.applied(arm())
    free, loaded = Plant(true, push), Plant(carrying(PAYLOAD, true), push)
    state, ends = start, []
    for plant, periods in ((free, 100), (loaded, 50), (free, 70)):
        state = moved(plant, state, periods).state
        ends.append(state)
    for k, end in zip((100, 150, 220), ends, strict=True):
        np.testing.assert_allclose(whole.log.state.q[k], end.q, rtol=0, atol=1e-12)
        np.testing.assert_allclose(whole.log.state.dq[k], end.dq, rtol=0, atol=1e-11)
    without = moved(free, start, 220).state
    assert np.abs(np.asarray(without.q) - np.asarray(whole.state.q)).max() > 1e-3


def test_plant_of_nominal_applies_mismatch_payload_and_disturbance():
    load = TimedPayload(PAYLOAD, 0.5)
    mismatch, push = Mismatch(mass_factor=0.9, armature=0.2, load=load), Constant([0.0, 0.0, 1.0])
    plant = Plant.of_nominal(arm(), mismatch, push)
    assert eqx.tree_equal(plant, Plant(mismatch.applied(arm()), push, None, None, load))
