"""Rotor inertia and friction of joints, learnt from torques and positions."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.law import JointLearning
from slidax.law.adaptation import noise_of
from tests.law.adaptation.moved import LINKS, PERIOD, motion, swept, taught

RATED = {"mass": LINKS, "torque": [100.0, 12.0], "deviation": 1e-5 / np.sqrt(12.0), "period": PERIOD}
TRUE = np.array([0.2, 0.06])


def learning(**given):
    return JointLearning.of_arm(rotors=np.zeros(2), **{**RATED, **given})


def rounded(q, resolution=1e-5):
    return resolution * np.round(q / resolution)


def test_rotors_and_coulomb_friction_are_found_from_a_motion_that_shows_them():
    torque = swept(1.0)
    q, dq = motion(torque, TRUE, np.array([1.5, 0.3]))
    _, learnt = taught(learning(), rounded(q), dq, torque)
    np.testing.assert_allclose(learnt.rotor[-1], TRUE, rtol=0.1)
    np.testing.assert_allclose(learnt.coulomb[-1], [1.5, 0.3], rtol=0.15)


def test_a_wrong_rotor_is_mended_in_a_tenth_of_a_second():
    torque = swept(1.0)
    q, dq = motion(torque, TRUE, 0.0)
    _, learnt = taught(learning(rotor=[1.0, 0.6]), rounded(q), dq, torque)
    np.testing.assert_allclose(learnt.rotor[100], TRUE, rtol=0.25)


def test_links_that_are_lighter_than_the_model_give_a_negative_rotor():
    torque = swept(1.0)
    q, dq = motion(torque, 0.0, 0.0, links=np.array([[0.35, 0.08], [0.08, 0.02]]))
    _, learnt = taught(learning(rotor_min=0.0, rotor=0.01), rounded(q), dq, torque)
    np.testing.assert_allclose(learnt.rotor[-1, 0], -0.15, rtol=0.2)


def test_the_weight_of_a_load_that_swings_teaches_nothing():
    t = np.arange(4000) * PERIOD
    # The arm follows 2 rad/s, and the weight that nobody knows changes with it: it looks like negative inertia.
    q = np.stack([0.4 * np.sin(2.0 * t), 0.3 * np.sin(2.0 * t)], axis=1)
    dq = np.stack([0.8 * np.cos(2.0 * t), 0.6 * np.cos(2.0 * t)], axis=1)
    torque = (-4.0 * q) @ (LINKS + np.diag(TRUE)) + 20.0 * q
    _, learnt = taught(learning(rotor=TRUE), rounded(q), dq, torque)
    np.testing.assert_allclose(learnt.rotor[-1], TRUE, rtol=0.05)


def test_at_rest_nothing_is_learnt_and_nothing_forgotten():
    torque = swept(1.0)
    q, dq = motion(torque, TRUE, 0.0)
    _, learnt = taught(learning(), rounded(q), dq, torque)
    still = np.zeros((5000, 2))
    noise = rounded(np.random.default_rng(3).normal(0.0, 3e-6, (5000, 2)))
    _, later = taught(learning(rotor=np.asarray(learnt.rotor[-1])), noise, still, still)
    # The first samples of noise look like a jump; after that not a bit changes.
    np.testing.assert_allclose(later.rotor[100], learnt.rotor[-1], rtol=1e-2)
    np.testing.assert_array_equal(later.rotor[-1], later.rotor[100])


def test_coarse_encoders_do_not_draw_the_inertia_to_zero():
    torque = swept(0.3)
    q, dq = motion(torque, TRUE, 0.0)
    coarse = 2.5e-4
    adaptation = learning(deviation=coarse / np.sqrt(12.0), rotor=TRUE)
    _, learnt = taught(adaptation, rounded(q, coarse), dq, torque)
    np.testing.assert_allclose(learnt.rotor[-1], TRUE, rtol=0.25)
    ungated = eqx.tree_at(
        lambda a: (a.gate, a.coherence, a.high), adaptation, (jnp.zeros(()), jnp.zeros(()), jnp.asarray(800.0))
    )
    _, drawn = taught(ungated, rounded(q, coarse), dq, torque)
    assert np.any(np.asarray(drawn.rotor[-1]) < 0.6 * TRUE)


def test_lost_samples_teach_nothing_wrong():
    torque = swept(1.0)
    q, dq = motion(torque, TRUE, 0.0)
    arrives = np.ones(len(q), bool)
    for start in range(100, 1900, 90):
        arrives[start : start + 15] = False
    missed = np.concatenate([[False], ~arrives[:-1]])[arrives]
    # While nothing arrives the last torque stands: here the arm is pushed on as planned, which is harder.
    _, learnt = taught(learning(), rounded(q)[arrives], dq[arrives], torque[arrives], missed)
    np.testing.assert_allclose(learnt.rotor[-1], TRUE, rtol=0.35)


def test_the_first_guess_is_the_models_rotors_or_two_thousandths_of_the_rated_torque():
    np.testing.assert_allclose(learning().rotor, [0.2, 0.024])
    known = JointLearning.of_arm(rotors=[0.3, 0.0], **RATED)
    np.testing.assert_allclose(known.rotor, [0.3, 0.024])
    np.testing.assert_allclose(known.counted, [0.3, 0.0])
    # An arm without rotors of its own is as its model says.
    np.testing.assert_allclose(JointLearning.of_arm(rotors=None, **RATED).rotor, 0.0)
    unknown = JointLearning.of_arm(rotors=np.zeros(2), **{**RATED, "torque": [np.inf, 12.0]})
    np.testing.assert_allclose(unknown.rotor, [0.002 * 25.0 * 0.5, 0.024])


@pytest.mark.parametrize("high", [80.0, 200.0])
def test_the_noise_in_the_band_is_what_a_simulation_finds(high):
    deviation = 1e-4
    white = np.random.default_rng(5).normal(0.0, deviation, (40, 500, 2))
    adaptation = eqx.tree_at(lambda a: a.high, learning(), jnp.asarray(high))
    still = np.zeros((500, 2))
    ends = [np.asarray(taught(adaptation, one, still, still)[0].stages)[-1, 1] for one in white]
    np.testing.assert_allclose(np.std(ends), noise_of(deviation, 15.0, high, PERIOD), rtol=0.2)


def test_nothing_grows_without_bound_whatever_is_measured():
    generator = np.random.default_rng(7)
    adaptation = learning()
    wild = generator.choice([0.0, 1.0, -1e3, 1e150, -1e300, 1e308], (3000, 2))
    memory, learnt = taught(adaptation, wild, -wild, wild[::-1])
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((memory, learnt)))
    assert np.all(np.asarray(memory.information)[0] <= np.asarray(adaptation.window) * (1 + 1e-12))
    assert np.all(np.asarray(learnt.rotor) <= adaptation.rotor_max + np.diagonal(LINKS))
