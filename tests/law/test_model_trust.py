"""When the learnt model of an arm is used, when it is given up, and when the last good one returns."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.core.types import State
from slidax.law.adaptation import Experience
from slidax.law.model_trust import (
    BLIND,
    CONFIRMED,
    LASTING,
    PROBATION,
    PROVEN,
    RELIEF,
    UNSURE,
    Trust,
    judge,
)
from tests.law.moved import ARM, PERIOD, after_sample, learner

STEP = jnp.asarray(0.01)
VARIANCE = jnp.asarray(4e-4)
YES, NO = jnp.asarray(True), jnp.asarray(False)


@eqx.filter_jit
def window(trust, innovations, moves, certain, valid, lost, left, rubbed):
    """Trust and verdict after a window of joints that do not change their direction."""
    trust, loud = trust.after_window(innovations, jnp.ones(2), jnp.zeros(2), moves, VARIANCE, STEP)
    return judge(trust, certain, valid, loud, lost, left, rubbed, VARIANCE, STEP)


def judged(
    trust, seconds, *, innovation=0.0, of_good=0.0, certain=YES, valid=YES, heard=True, lost=0.0, left=0.0, rubbed=NO
):
    """Trust after windows in which every joint has the same innovation, N m, and a torque of 1 N m.

    - `lost`: share of the payload that every window finds lost. `left`: innovation without it, N m.
    - `rubbed`: True if changed friction explains the loud windows.
    """
    innovations = jnp.stack([jnp.full(2, innovation), jnp.full(2, of_good)])
    moves = jnp.full(2, heard) & valid
    verdicts = []
    for _ in range(round(seconds / float(STEP))):
        trust, verdict = window(trust, innovations, moves, certain, valid, jnp.asarray(lost), jnp.full(2, left), rubbed)
        verdicts.append(verdict)
    return trust, verdicts


@pytest.fixture(scope="module")
def in_use():
    """A model that has been in full use for long."""
    return judged(Trust.init(2, VARIANCE), 0.8 + PROBATION + PROVEN, innovation=0.01)[0]


def test_a_model_that_explains_the_torque_and_knows_each_inertia_is_used(in_use):
    assert in_use.share == 1.0 and not in_use.relearns and in_use.has_good
    unsure, _ = judged(Trust.init(2, VARIANCE), 2.0, innovation=0.01, certain=NO)
    wrong, _ = judged(Trust.init(2, VARIANCE), 2.0, innovation=0.6)
    assert unsure.share == 0.0 and wrong.share == 0.0


def test_a_push_leaves_the_model_in_use_unless_gaps_follow(in_use):
    pushed, verdicts = judged(in_use, LASTING - 0.2, innovation=3.0, of_good=3.0)
    assert pushed.share == 1.0 and not pushed.relearns
    # Predictions fail, and no window is valid: the joints' own learning takes over.
    blind, more = judged(pushed, BLIND + 0.12, valid=NO)
    assert blind.share == 0.0 and not blind.relearns
    assert judged(pushed, BLIND - 0.01, valid=NO)[0].share == 1.0
    after, most = judged(blind, 0.4, innovation=0.01)
    assert after.share == 1.0
    assert not any(bool(verdict.opens | verdict.restores) for verdict in (*verdicts, *more, *most))
    # Lost samples alone say nothing of a proven model; those after a loud window say that the arm may have changed.
    assert judged(in_use, 2.0, valid=NO)[0].share == 1.0
    assert judged(pushed, 0.3, valid=NO)[0].relearns
    new, _ = judged(Trust.init(2, VARIANCE), 0.8 + PROBATION, innovation=0.01)
    assert new.share == 1.0 and judged(new, BLIND + 0.12, valid=NO)[0].share == 0.0
    # After the loss of a payload its model stays in use.
    released, _ = judged(in_use, 0.01, innovation=3.0, of_good=3.0, lost=0.5, left=0.2)
    assert judged(released, RELIEF - 0.05, valid=NO)[0].share == 1.0


def test_a_model_that_fails_in_its_probation_is_not_used():
    first, _ = judged(Trust.init(2, VARIANCE), 0.4, innovation=0.01)
    half, _ = judged(first, 0.5 * PROBATION, innovation=0.01)
    failing, _ = judged(half, 0.5 * PROBATION, innovation=1.0)
    assert not failing.relearns and failing.share == 0.0


def test_equations_count_less_while_a_model_is_not_proven(in_use):
    adaptation, still = learner(), jnp.zeros(2)
    memory = adaptation.init(State(q=still, dq=still))
    speeds = memory.equations.drives.at[0].set(jnp.ones(2))
    where = lambda m: (m.equations.drives, m.equations.y, m.equations.weights)  # noqa: E731
    memory = eqx.tree_at(where, memory, (speeds, jnp.ones(2), jnp.ones(2)))
    args = still, still, still, ARM.mass(still), ARM.bias(still, still), jnp.asarray(PERIOD), NO, ARM
    first, _ = judged(Trust.init(2, VARIANCE), 0.4, innovation=0.01)
    for trust, variance in ((Trust.init(2, VARIANCE), UNSURE * 0.3), (first, UNSURE * 0.3), (in_use, 0.02**2)):
        trust = eqx.tree_at(lambda t: t.usual, trust, jnp.array([0.3, 0.2]))
        after = after_sample(adaptation, Experience(*args), eqx.tree_at(lambda m: m.trust, memory, trust))
        viscous = adaptation.parameters(after.estimates.parameters).viscous
        np.testing.assert_allclose(viscous, [0.16 / (0.16 + variance), 0.0], rtol=1e-12)


def test_a_lasting_change_is_learnt_anew(in_use):
    changed, verdicts = judged(in_use, LASTING + 0.15, innovation=3.0, of_good=3.0)
    assert changed.relearns and changed.share == 0.0 and any(bool(verdict.opens) for verdict in verdicts)
    assert judged(changed, 3.0, innovation=0.01, of_good=3.0)[0].share == 1.0


def test_a_small_push_does_not_become_usual_before_a_lasting_change_is_found(in_use):
    assert any(bool(verdict.opens) for verdict in judged(in_use, LASTING + 0.05, innovation=0.2, of_good=0.2)[1])


def test_the_first_model_learns_on_from_small_errors_and_stays_in_use():
    new, _ = judged(Trust.init(2, VARIANCE), 0.8 + PROBATION, innovation=0.01)
    assert new.share == 1.0 and not new.has_good
    refined, verdicts = judged(new, LASTING + 0.15, innovation=0.2)
    assert refined.share == 1.0 and not refined.relearns and not any(bool(verdict.opens) for verdict in verdicts)
    # All windows teach for a while, the unusual ones too.
    assert -RELIEF < refined.loud < 0.0
    assert judged(new, LASTING + 0.15, innovation=3.0)[0].relearns


def test_a_model_that_has_lost_its_payload_stays_in_use(in_use):
    released, verdicts = judged(in_use, 0.01, innovation=3.0, of_good=3.0, lost=0.5, left=0.2)
    assert all(bool(verdict.unloads) for verdict in verdicts) and released.share == 1.0
    np.testing.assert_allclose(released.usual, 0.2**2)
    # The unexplained rest is usual; the time of louder windows counts only after the relief.
    assert judged(released, RELIEF + LASTING - 0.05, innovation=9.0, of_good=9.0)[0].share == 1.0
    assert judged(released, RELIEF + LASTING + 0.15, innovation=9.0, of_good=9.0)[0].share == 0.0
    after, more = judged(released, 0.2, innovation=0.3, of_good=3.0)
    assert after.share == 1.0 and not any(bool(verdict.unloads) for verdict in more)
    # An arm that is learnt anew has no payload to lose.
    changed, _ = judged(in_use, LASTING + 0.05, innovation=3.0, of_good=3.0)
    assert not any(bool(v.unloads) for v in judged(changed, 0.03, innovation=3.0, of_good=3.0, lost=0.5)[1])


def test_the_last_good_model_returns_when_a_long_push_ends(in_use):
    pushed, _ = judged(in_use, LASTING + 0.3, innovation=3.0, of_good=3.0)
    restored, verdicts = judged(pushed, 2.0 + CONFIRMED, innovation=3.0, of_good=0.01)
    first = next(k for k, verdict in enumerate(verdicts) if bool(verdict.restores))
    # The energies remember the push for seconds, single windows do not.
    assert CONFIRMED - 0.015 < first * float(STEP) < CONFIRMED + 0.05
    assert judged(pushed, (first + 1) * float(STEP), innovation=3.0, of_good=0.01)[0].relearns == NO
    assert pushed.share == 0.0 and restored.has_good


def test_the_last_good_model_replaces_a_model_learnt_in_a_push_before_its_use(in_use):
    pushed, _ = judged(in_use, LASTING + 0.1, innovation=3.0, of_good=3.0)
    learnt = pushed
    while learnt.relearns:
        learnt, _ = judged(learnt, 0.05, innovation=0.01, of_good=3.0)
    assert learnt.share == 0.0 and learnt.since < PROBATION - CONFIRMED
    after, verdicts = judged(learnt, CONFIRMED + 0.05, innovation=0.3, of_good=0.01)
    assert any(bool(verdict.restores) for verdict in verdicts) and not after.relearns
    # A grasped payload stays in the model: its windows are loud for the earlier model, and rest is no evidence.
    for heard, of_good in ((True, 3.0), (False, 0.0)):
        more = judged(learnt, 0.5, innovation=0.01, of_good=of_good, heard=heard)[1]
        assert not any(bool(verdict.restores) for verdict in more)


def test_the_last_good_model_replaces_a_model_in_use_that_explains_the_torque_less_well(in_use):
    spoiled, verdicts = judged(in_use, 1.0, innovation=0.5, of_good=0.01)
    assert any(bool(verdict.restores) for verdict in verdicts) and not spoiled.relearns
    # A good model and a better one are both left alone.
    for innovation, of_good in ((0.03, 0.03), (0.03, 0.5), (0.04, 0.01)):
        assert not any(bool(v.restores) for v in judged(in_use, 1.0, innovation=innovation, of_good=of_good)[1])


def test_a_new_model_is_used_only_after_its_probation():
    first, _ = judged(Trust.init(2, VARIANCE), 0.4, innovation=0.01)
    assert not first.relearns and first.share == 0.0
    assert judged(first, 0.7 * PROBATION, innovation=0.01)[0].share == 0.0
    assert judged(first, PROBATION + 0.3, innovation=0.01)[0].share == 1.0


def test_a_push_hardly_changes_a_model_that_is_still_being_learnt(in_use):
    young, _ = judged(Trust.init(2, VARIANCE), 0.8, innovation=0.05, certain=NO)
    old, _ = judged(young, PROVEN, innovation=0.05, certain=NO)
    usual = float(old.usual[0])
    squares = usual * jnp.array([1.0, 1600.0])
    np.testing.assert_array_equal(young.weights(squares, YES), 1.0)
    np.testing.assert_allclose(old.weights(squares, YES), [1.0, 0.01], rtol=1e-12)
    np.testing.assert_array_equal(in_use.weights(squares, NO), 1.0)
    np.testing.assert_array_equal(in_use.weights(squares, YES), 0.0)
    np.testing.assert_array_equal(eqx.tree_at(lambda t: t.loud, in_use, -STEP).weights(squares, YES), 1.0)
    # A push does not enlarge the covariance, but a lasting change does.
    pushed, verdicts = judged(old, LASTING - 0.05, innovation=3.0, certain=NO)
    assert pushed.since > PROVEN and not any(bool(verdict.opens) for verdict in verdicts)
    assert any(bool(verdict.opens) for verdict in judged(pushed, 0.1, innovation=3.0, certain=NO)[1])
    assert any(bool(verdict.opens) for verdict in judged(young, 0.1, innovation=3.0, certain=NO)[1])


def test_changed_friction_leaves_the_model_in_use(in_use):
    rubbed, verdicts = judged(in_use, LASTING + 0.02, innovation=3.0, of_good=3.0, rubbed=YES)
    assert sum(bool(verdict.rubs) for verdict in verdicts) == 1 and not any(bool(verdict.opens) for verdict in verdicts)
    assert rubbed.share == 1.0 and not rubbed.relearns and rubbed.loud < 0.05
    # If the change does not explain the torque, the arm is learnt anew.
    assert judged(rubbed, LASTING + 0.05, innovation=3.0, of_good=3.0, rubbed=YES)[0].relearns
    # When a push ends that was taken for friction, the last good model returns, and the arm's model stays in use.
    after, more = judged(rubbed, CONFIRMED + 0.05, innovation=3.0, of_good=0.01, rubbed=YES)
    assert any(bool(verdict.restores) for verdict in more) and after.share == 1.0 and not after.relearns


def test_a_change_of_friction_is_recognised_by_the_direction_of_motion(in_use):
    def recognised(innovation, turns=None, coulomb=(0.5, 0.5)):
        trust = in_use
        for k in range(40):
            direction = jnp.array([1.0, -1.0 if turns is not None and k >= turns else 1.0])
            innovations = jnp.stack([innovation(direction, k)] * 2)
            trust, loud = trust.after_window(innovations, jnp.ones(2), direction, jnp.ones(2, bool), VARIANCE, STEP)
            trust = eqx.tree_at(lambda t: t.loud, trust, trust.loud + STEP * loud[0].astype(float))
        return trust.friction_change(jnp.asarray(coulomb), jnp.asarray(2.0), STEP)

    explains, change = recognised(lambda direction, k: jnp.array([0.7, -0.3]) * direction, turns=15)
    assert explains
    np.testing.assert_allclose(change, [0.7, -0.3], rtol=1e-9)
    # A constant torque does not turn with the motion, and a growing one is no friction.
    assert not recognised(lambda direction, k: jnp.array([0.7, 0.3]), turns=15)[0]
    assert not recognised(lambda direction, k: jnp.array([0.1 * k, 0.0]))[0]
    # Friction stays between zero and its limit.
    for coulomb in ((0.5, 0.2), (3.4, 0.5)):
        assert not recognised(lambda direction, k: jnp.array([0.7, -0.3]) * direction, coulomb=coulomb)[0]
    # The sums begin with the first loud window, since earlier quiet windows do not show the change.
    assert recognised(lambda direction, k: jnp.array([0.7, 0.0]) * float(k >= 20))[0]
