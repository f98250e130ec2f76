"""Arms with joints that follow other joints."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import Articulated, Coupled, Mismatch, Payload, TimedPayload, couple, from_urdf
from slidax.core.errors import DefinitionError, DefinitionWarning
from tests.arms.bad_file import changed
from tests.arms.bad_urdf import ELBOW, END, GOOD, LIMIT, SPARE, joint, limit
from tests.arms.trees import small_tree

pytest.importorskip("mujoco")
FOLLOWS = LIMIT + '<mimic joint="shoulder" multiplier="-0.5" offset="0.2"/>'
FOLLOWED = changed(GOOD, LIMIT, FOLLOWS)
SPARE_FOLLOWS = SPARE + joint("revolute", "spare", "upper", "spare", '<axis xyz="0 1 0"/><mimic joint="shoulder"/>')


def read(text: str, **arguments: object) -> Articulated | Coupled:
    with pytest.warns(DefinitionWarning):
        return from_urdf(text, **arguments)


@pytest.fixture(scope="module")
def pair() -> tuple[Coupled, Articulated]:
    return read(FOLLOWED), from_urdf(GOOD)


def test_a_joint_between_base_and_tip_that_mimics_another_follows_it(pair):
    arm, _ = pair
    assert isinstance(arm, Coupled)
    assert arm.joint_names == ("shoulder",)
    assert arm.followers == ("elbow",)
    np.testing.assert_allclose(arm.positions(jnp.array([0.8])), [0.8, -0.2])
    np.testing.assert_allclose(arm.velocities(jnp.array([2.0])), [2.0, -1.0])


def test_warning_names_follower_leader_and_the_new_range():
    with pytest.warns(DefinitionWarning) as caught:
        from_urdf(FOLLOWED)
    (warning,) = caught
    assert str(warning.message) == (
        "arm: joint `elbow` follows joint `shoulder` at the ratio -0.5 and the offset 0.2, whose range becomes "
        "-2 to 2.4, and is not a joint of the arm by itself; locked={'elbow': POSITION} holds it"
    )


def test_coupled_dynamics_are_projections_of_the_uncoupled_dynamics(pair):
    arm, every = pair
    s = np.array([1.0, -0.5])

    @jax.jit
    def motion(q, dq):
        of_the_leader = arm.mass(q), arm.bias(q, dq), arm.friction(dq), arm.tip(q), arm.potential(q)
        at, moving = arm.positions(q), arm.velocities(dq)
        of_both = every.mass(at), every.bias(at, moving), every.friction(moving), every.tip(at), every.potential(at)
        return of_the_leader, of_both

    leading, both = motion(jnp.array([0.7]), jnp.array([1.3]))
    (mass, bias, friction, tip, energy), (masses, biases, frictions, there, whole_energy) = leading, both
    np.testing.assert_allclose(mass, [[s @ masses @ s]], rtol=1e-14)
    np.testing.assert_allclose(bias, [s @ biases], rtol=1e-14)
    np.testing.assert_allclose(friction, [s @ frictions], rtol=1e-14)
    np.testing.assert_allclose(tip, there, rtol=1e-14)
    np.testing.assert_allclose(energy, whole_energy, rtol=1e-14)


def test_leader_limits_are_narrowed_by_the_limits_of_its_followers(pair):
    arm, _ = pair
    # The elbow's -1 to 1.5 rad are -2.6 to 2.4 rad at the shoulder; its 4 rad/s are 8 rad/s.
    assert (float(arm.limits.lower[0]), float(arm.limits.upper[0])) == (-2.0, pytest.approx(2.4))
    assert float(arm.limits.velocity[0]) == 3.0
    assert float(arm.limits.torque[0]) == 50.0
    slow = read(changed(GOOD, LIMIT, FOLLOWS.replace('velocity="4"', 'velocity="1"')))
    assert float(slow.limits.velocity[0]) == 2.0


def test_follower_range_disjoint_from_its_leaders_is_ignored_with_a_warning():
    text = changed(GOOD, LIMIT, FOLLOWS.replace('lower="-1" upper="1.5"', 'lower="2" upper="3"'))
    with pytest.warns(DefinitionWarning) as caught:
        arm = from_urdf(text)
    told = " ".join(str(warning.message) for warning in caught)
    assert "the range of joint `elbow` is -5.6 to -3.6 in positions of its leader `shoulder`, whose" in told
    assert (float(arm.limits.lower[0]), float(arm.limits.upper[0])) == (-2.0, 2.5)


def test_rotor_inertia_and_friction_act_on_the_leader():
    arm = read(FOLLOWED, armature={"shoulder": 0.1, "elbow": 0.4})
    np.testing.assert_allclose(arm.armature, [0.1 + 0.25 * 0.4])
    np.testing.assert_allclose(arm.viscous, [0.5])
    np.testing.assert_allclose(arm.coulomb, [0.25])
    np.testing.assert_allclose(arm.mass(jnp.zeros(1)) - read(FOLLOWED).mass(jnp.zeros(1)), [[0.2]], rtol=1e-12)
    # A single number is the armature of each joint of the arm, and a follower is none.
    assert float(read(FOLLOWED, armature=0.3).arm.armature[1]) == 0.0


def test_the_option_locked_holds_a_follower():
    arm, held = (from_urdf(text, locked={"elbow": 0.5}) for text in (FOLLOWED, GOOD))
    assert isinstance(arm, Articulated)
    np.testing.assert_array_equal(arm.inertias, held.inertias)


def test_follower_outside_the_arm_moves_if_mimics_is_followed():
    text = changed(GOOD, END, SPARE_FOLLOWS + END)
    arm = read(text, tip="tool", limits=False, mimics="followed")
    assert isinstance(arm, Coupled)
    assert (arm.joint_names, arm.followers) == (("shoulder", "elbow"), ("spare",))
    held = read(text, tip="tool", limits=False)
    assert isinstance(held, Articulated)
    with pytest.raises(DefinitionError, match="`mimics` must be `held` or `followed`; got `fixed`"):
        from_urdf(text, tip="tool", mimics="fixed")


def test_a_follower_with_ratio_0_is_held_at_its_offset():
    with pytest.warns(DefinitionWarning, match="held at 0.2"):
        arm = from_urdf(FOLLOWED.replace("-0.5", "0"))
    assert isinstance(arm, Articulated)
    held = from_urdf(GOOD, locked={"elbow": 0.2})
    np.testing.assert_allclose(arm.inertias, held.inertias, rtol=1e-14, atol=1e-16)


def test_leader_outside_the_arm_is_a_joint_if_a_follower_carries_the_tip():
    text = changed(GOOD, END, SPARE + joint("revolute", "spare", "base", "spare", '<axis xyz="0 1 0"/>') + END)
    text = changed(text, LIMIT, LIMIT + '<mimic joint="spare" multiplier="2"/>')
    arm = read(text, tip="tool", limits=False)
    assert (arm.joint_names, arm.followers) == (("shoulder", "spare"), ("elbow",))
    np.testing.assert_allclose(arm.positions(jnp.array([-0.4, 0.3])), [-0.4, 0.6, 0.3])


def test_chained_followers_have_the_product_of_the_ratios():
    chain = joint(
        "revolute", "wrist", "tool", "spare", '<axis xyz="0 1 0"/><mimic joint="elbow" multiplier="3" offset="1"/>'
    )
    arm = read(changed(FOLLOWED, END, SPARE + chain + END), limits=False)
    assert arm.joint_names == ("shoulder",)
    # elbow = -0.5 q + 0.2; wrist = 3 elbow + 1.
    np.testing.assert_allclose(arm.positions(jnp.array([0.4])), [0.4, 0.0, 1.0], atol=1e-15)


def test_mismatch_and_payload_change_the_coupled_joints():
    arm = couple(small_tree(), {"arm": ("waist", 0.5, 0.1)})
    true = Mismatch(mass_factor=jnp.array(0.5)).applied(arm)
    np.testing.assert_allclose(true.arm.masses, 0.5 * arm.arm.masses)
    loaded = TimedPayload(Payload(mass=2.0)).on(arm, jnp.zeros(()))
    assert float(loaded.arm.payload.mass) == 2.0


@pytest.mark.parametrize(
    ("following", "named"),
    [
        ({"elbow": ("waist", 1.0, 0.0)}, "`elbow` is not a joint of small_tree"),
        ({"arm": ("wrist", 1.0, 0.0)}, "`wrist` is not a joint"),
        ({"arm": ("lift", 1.0, 0.0), "lift": ("waist", 1.0, 0.0)}, "`lift` is a follower"),
        ({"arm": ("arm", 1.0, 0.0)}, "`arm` is a follower"),
        ({"arm": ("waist", 0.0, 0.0)}, "must be finite and not 0"),
        ({"arm": ("waist", np.nan, 0.0)}, "must be finite and not 0"),
    ],
)
def test_invalid_followers_are_errors(following, named):
    with pytest.raises(DefinitionError, match=named):
        couple(small_tree(), following)


def test_disjoint_ranges_of_leader_and_follower_are_refused():
    arm = from_urdf(changed(GOOD, LIMIT, limit(lower="2", upper="3")))
    with pytest.raises(DefinitionError, match=r"range of joint `elbow` and that of joint `shoulder`.*do not overlap"):
        couple(arm, {"elbow": ("shoulder", -1.0, 0.0)})


def test_a_prismatic_joint_may_follow_a_revolute_joint():
    text = changed(FOLLOWED, ELBOW, ELBOW.replace("revolute", "prismatic"))
    arm = read(text, limits=False)
    assert arm.joint_units == ("rad",)
    np.testing.assert_allclose(jax.grad(arm.potential)(jnp.array([0.3])), arm.gravity(jnp.array([0.3])), rtol=1e-12)
