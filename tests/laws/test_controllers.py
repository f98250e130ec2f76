"""What every scheme must be: a pure function of arrays that compiles once, batches and differentiates."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import Reference, State
from slidax.controllers import GravityCompensatedPD
from slidax.estimators import Kalman
from tests.controllers.members import CONTROLLERS, LIKE_OTHERS
from tests.enrolled import every


def answer(case, controller, t, state):
    """The command at time t, to a start as the case has it."""
    memory = controller.init(jnp.zeros(()), case.start, case.trajectory.reference(jnp.zeros(())))
    now, ahead = case.trajectory.reference(t), case.trajectory.reference(t + 1e-3)
    return controller(t, state, now, ahead, memory)


def near(case, t, seed=0):
    """A state close to the reference at time t, inside any envelope of the members."""
    n = case.robot.joints
    rng = np.random.default_rng(seed)
    reference = case.trajectory.reference(jnp.asarray(t))
    e, de = rng.uniform(-1e-3, 1e-3, n) * 0.3, rng.normal(size=n) * 0.1
    return State(q=reference.q + e, dq=reference.dq + de)


def on_reference(case, t):
    reference = case.trajectory.reference(jnp.asarray(t))
    return State(q=reference.q, dq=reference.dq)


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_compiled_and_eager_agree(case):
    state, t = near(case, 1.0), jnp.asarray(1.0)
    eager = answer(case, case.controller, t, state)
    compiled = eqx.filter_jit(lambda c, t, y: answer(case, c, t, y))(case.controller, t, state)
    for a, b in zip(jax.tree.leaves(eager), jax.tree.leaves(compiled), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_a_batch_over_any_gain_is_the_loop_over_it(case):
    state, t = near(case, 1.0), jnp.asarray(1.0)
    arrays, rest = eqx.partition(case.controller, eqx.is_array)
    factors = jnp.array([1.0, 1.01, 1.05])
    single = jax.jit(lambda arrays: answer(case, eqx.combine(arrays, rest), t, state).tau)
    batch = jax.tree.map(lambda x: x * factors.reshape(-1, *[1] * x.ndim), arrays)
    looped = [single(jax.tree.map(lambda x, i=i: x[i], batch)) for i in range(3)]
    np.testing.assert_allclose(jax.vmap(single)(batch), looped, rtol=1e-9)
    assert np.all(np.ptp(looped, axis=0) > 0)


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_one_trace_serves_many_gains_states_and_times(case):
    traces = []

    @eqx.filter_jit
    def run(controller, t, state):
        traces.append(1)
        return answer(case, controller, t, state).tau

    arrays, rest = eqx.partition(case.controller, eqx.is_array)
    for i, factor in enumerate((1.0, 1.01, 1.02, 1.03)):
        controller = eqx.combine(jax.tree.map(lambda x, f=factor: x * f, arrays), rest)
        run(controller, jnp.asarray(0.5 * i), near(case, 0.5 * i, seed=i))
    assert len(traces) == 1


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_every_gain_is_a_floating_array_leaf(case):
    leaves = jax.tree.leaves(case.controller)
    assert leaves
    assert all(isinstance(leaf, jax.Array) and leaf.dtype == float for leaf in leaves)


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_gradients_by_all_gains_and_by_the_state_are_finite_also_without_any_error(case):
    @eqx.filter_jit
    def gradients(controller, state, t):
        def total(both):
            return jnp.sum(answer(case, both[0], t, both[1]).tau)

        return jax.grad(total)((controller, state))

    for t in (0.5, 5.0, 8.0):
        for state in (near(case, t), on_reference(case, t)):
            found = jax.tree.leaves(gradients(case.controller, state, jnp.asarray(t)))
            assert all(np.all(np.isfinite(leaf)) for leaf in found)


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_the_torque_is_not_indifferent_to_its_gains(case):
    """Wherever a gain stands idle at one state, it acts at another: here every leaf but a few at the start."""
    reference = case.trajectory.reference(jnp.zeros(()))
    state = State(q=case.start.q, dq=case.start.dq + 0.1)
    assert float(jnp.abs(state.q - reference.q).max()) > 0

    def total(controller):
        tau = answer(case, controller, jnp.asarray(0.1), state).tau
        return jnp.sum(tau * jnp.arange(1.0, tau.shape[0] + 1.0))

    moved = [np.any(np.asarray(leaf) != 0) for leaf in jax.tree.leaves(jax.jit(jax.grad(total))(case.controller))]
    # The core's width acts only inside the core.
    assert moved.count(False) <= case.idle


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_the_gradient_by_each_gain_matches_differences(case):
    state, t = near(case, 1.0), jnp.asarray(1.0)
    arrays, rest = eqx.partition(case.controller, eqx.is_array)
    flat, treedef = jax.tree.flatten(arrays)

    @jax.jit
    def total(flat):
        return jnp.sum(answer(case, eqx.combine(jax.tree.unflatten(treedef, flat), rest), t, state).tau)

    gradient = jax.jit(jax.grad(total))(flat)
    for i, (leaf, slope) in enumerate(zip(flat, gradient, strict=True)):
        h = 1e-6 * float(jnp.max(jnp.abs(leaf)) + 1e-2)
        up, down = ([*flat[:i], leaf + d, *flat[i + 1 :]] for d in (h, -h))
        if float(jnp.min(leaf)) == 0.0:  # a layer of zero cannot be less
            continue
        difference = (total(up) - total(down)) / (2 * h)
        np.testing.assert_allclose(jnp.sum(slope), difference, rtol=2e-4, atol=1e-4)


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_the_memory_and_its_rate_keep_its_tree_shapes_and_types(case):
    before = case.controller.init(jnp.zeros(()), case.start, case.trajectory.reference(jnp.zeros(())))
    command = answer(case, case.controller, jnp.asarray(0.5), near(case, 0.5))
    for after in (command.memory, before if command.rate is None else command.rate):
        assert jax.tree.structure(before) == jax.tree.structure(after)
        for a, b in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
            assert (a.shape, a.dtype, a.weak_type) == (b.shape, b.dtype, b.weak_type)


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_the_scheme_commands_one_torque_per_joint_of_its_arm(case):
    assert case.controller.joints == case.robot.joints
    tau = answer(case, case.controller, jnp.asarray(0.5), near(case, 0.5)).tau
    assert tau.shape == (case.robot.joints,)
    assert np.all(np.isfinite(tau))


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_the_start_lies_inside_the_envelope_that_the_scheme_promises(case):
    reference = case.trajectory.reference(jnp.zeros(()))
    memory = case.controller.init(jnp.zeros(()), case.start, reference)
    envelope = case.controller.envelope(jnp.zeros(()), memory)
    if envelope is not None:
        e = np.asarray(case.start.q - reference.q)
        assert np.all(np.asarray(envelope.lower) < e)
        assert np.all(e < np.asarray(envelope.upper))


@every("case", CONTROLLERS, full=LIKE_OTHERS)
def test_the_same_measurements_give_the_same_bits_twice(case):
    first, second = (answer(case, case.controller, jnp.asarray(0.7), near(case, 0.7)).tau for _ in range(2))
    np.testing.assert_array_equal(first, second)


# What a law predicts over its delay hangs on the torques that are under way; what a filter says of the velocity, on
# what came before.
IMMEDIATE = [
    (name, case)
    for name, case in CONTROLLERS
    if getattr(case.controller, "delay", 0) == 0 and not isinstance(getattr(case.controller, "estimator", None), Kalman)
]


@every("case", IMMEDIATE)
def test_without_any_error_the_torque_is_the_feed_forward_of_the_nominal_arm(case):
    """At e = ė = 0 every law is `M0 q̈_d + C0 q̇ + G0`; PD with gravity compensation knows the last of them only."""
    nominal = case.controller.nominal
    for t in (0.5, 1.5, 8.0):
        state, reference = on_reference(case, t), case.trajectory.reference(jnp.asarray(t))
        motion = nominal.mass(state.q) @ reference.ddq + nominal.coriolis(state.q, state.dq) @ state.dq
        if isinstance(case.controller, GravityCompensatedPD):
            motion = 0.0
        memory = case.controller.init(jnp.zeros(()), on_reference(case, 0.0), case.trajectory.reference(jnp.zeros(())))
        # A law that plans over a period takes the mean acceleration, so the motion goes on evenly here.
        ahead = Reference(reference.q + 1e-3 * reference.dq, reference.dq + 1e-3 * reference.ddq, reference.ddq)
        given = case.controller(jnp.asarray(t), state, reference, ahead, memory)
        np.testing.assert_allclose(given.tau, motion + nominal.gravity(state.q), rtol=1e-10, atol=1e-11)
