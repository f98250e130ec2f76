"""Every adaptation is a pure function of arrays whose learnt arm is physically possible for any samples."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import Reference, State
from slidax.law import ComputedTorque, Experience, sampled_data
from slidax.law.adaptation import with_rotors
from tests.enrolled import assert_same, assert_same_form, every
from tests.law.members import ADAPTATIONS
from tests.law.moved import ARM, LINKS, motion, swept, taught
from tests.paper_examples import law_4_1

FIRST = State(q=jnp.array([0.1, -0.2]), dq=jnp.zeros(2))


def experience(scale=1.0):
    return Experience(
        q=scale * jnp.array([0.1, -0.3]),
        dq=scale * jnp.array([1.0, -2.0]),
        tau=scale * jnp.array([5.0, 1.0]),
        mass=jnp.asarray(LINKS) + 0.1 * jnp.eye(2),
        bias=jnp.array([1.0, -1.0]),
        period=jnp.asarray(1e-3),
        missed=jnp.asarray(False),
        nominal=ARM,
    )


@every("adaptation", ADAPTATIONS)
def test_memory_keeps_its_tree_structure_after_a_sample(adaptation):
    before = adaptation.init(FIRST)
    after = adaptation(experience(), before)
    assert_same_form(before, after)


@every("adaptation", ADAPTATIONS)
def test_learnt_inertia_is_positive_definite_after_any_samples(adaptation):
    generator = np.random.default_rng(11)
    torque = generator.choice([-30.0, 0.0, 30.0], (400, 2))
    q, dq = motion(torque, 0.01, 1.0, generator.normal(0.0, 30.0, (400, 2)), fine=1)
    _, learnt = taught(adaptation, q, dq, torque)
    mass = jnp.asarray(LINKS) + jnp.diag(jnp.broadcast_to(adaptation.counted, 2))
    believed = jax.vmap(lambda rotor: with_rotors(mass, rotor, adaptation.counted))(jnp.asarray(learnt.rotor))
    assert np.all(np.linalg.eigvalsh(np.asarray(believed)) > 0) and np.all(np.asarray(learnt.coulomb) >= 0)


@every("adaptation", ADAPTATIONS)
def test_compiled_and_eager_adaptations_agree(adaptation):
    first = adaptation.init(FIRST)
    with jax.disable_jit():
        eager = adaptation(experience(), first)
    compiled = eqx.filter_jit(adaptation)(experience(), first)
    assert_same(compiled, eager, rtol=1e-12, atol=1e-300)


WITH_FRICTION = [case for case in ADAPTATIONS if case[0] != "joint_learning_of_inertia_alone"]


@every("adaptation", WITH_FRICTION)
def test_learnt_friction_opposes_the_motion_and_is_odd(adaptation):
    torque = swept(1.0, 0.4)
    q, dq = motion(torque, 0.1, np.array([1.5, 0.3]))
    memory, _ = taught(adaptation, q, dq, torque)
    dq = jnp.array([0.3, -0.1])
    friction = adaptation.friction(memory, dq)
    assert np.all(np.asarray(friction * dq) >= 0) and np.any(np.asarray(friction) != 0)
    np.testing.assert_array_equal(adaptation.friction(memory, -dq), -friction)


@every("adaptation", ADAPTATIONS)
@pytest.mark.parametrize("explicit", [False, True])
def test_model_based_laws_accept_every_adaptation(adaptation, explicit):
    law = ComputedTorque(ARM, 100.0, 20.0) if explicit else law_4_1(ARM)
    stepped = sampled_data(law, period=1e-3, adaptation=adaptation)
    reference = Reference(q=[0.1, 0.0])
    memory = stepped.init(jnp.zeros(()), FIRST, reference)
    command = stepped(jnp.zeros(()), FIRST, reference, reference, memory)
    assert np.all(np.isfinite(command.tau)) and {"rotor", "coulomb"} <= command.signals.keys()
    assert jax.tree.structure(command.memory) == jax.tree.structure(memory)
