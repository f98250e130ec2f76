"""Rivals of examples/own_laws.py with a barrier, a funnel, or a prescribed time: their formulas and guarantees."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from examples.own_laws import BarrierSuperTwisting, PrescribedTime, SampledFunnel
from slidax.core.types import Reference, State
from slidax.scenarios import load

STILL = Reference(q=jnp.zeros(2), dq=jnp.zeros(2), ddq=jnp.zeros(2))


@pytest.fixture(scope="module")
def nominal():
    return load("example-4.1-1khz").controller.nominal


def acceleration(law, t, q, dq, memory, now=STILL):
    """Acceleration that the law demands from its model, and its command."""
    state = State(q=jnp.asarray(q), dq=jnp.asarray(dq))
    command = law(jnp.asarray(t), state, now, now, memory)
    return np.linalg.solve(law.nominal.mass(state.q), command.tau - law.nominal.bias(state.q, state.dq)), command


def test_barrier_gain_grows_from_its_base_to_a_bound_at_the_barriers_edge(nominal):
    law = BarrierSuperTwisting(nominal, base=1.5, width=0.1, most=8.0, decay=10.0)
    reached, v = jnp.ones(2), jnp.zeros(2)
    for s, level in ((0.0, 1.5), (0.05, 1.5 * 2**0.5), (-0.075, 3.0), (0.0999, 8.0), (0.3, 8.0)):
        u, command = acceleration(law, 0.0, [0.0, 0.0], [s, s], (jnp.ones(2), reached, v))
        np.testing.assert_allclose(command.signals["level"], level)
        np.testing.assert_allclose(u, -10.0 * s - level * np.sqrt(abs(s)) * np.sign(s), atol=1e-12)
        np.testing.assert_allclose(command.rate[2], -(level**2) * np.sign(s))


def test_barrier_gain_grows_until_the_sliding_variable_has_been_near_zero(nominal):
    law = BarrierSuperTwisting(nominal, width=0.1, growth=3.0)
    memory = law.init(jnp.zeros(()), State(jnp.zeros(2), jnp.zeros(2)), STILL)
    _, command = acceleration(law, 0.0, [0.0, 0.0], [0.06, -0.05], memory)
    np.testing.assert_array_equal(command.rate[0], [3.0, 0.0])
    _, later = acceleration(law, 0.0, [0.0, 0.0], [0.06, 0.06], command.memory)
    np.testing.assert_array_equal(later.rate[0], [3.0, 0.0])


def test_funnel_controller_replaces_its_pd_law_above_its_threshold(nominal):
    law = SampledFunnel(nominal, initial=1.0, final=0.1, deadline=2.0, gain=5.0, threshold=0.75, kp=100.0, kd=20.0)
    for e, de in ((0.05, 0.01), (0.05, 0.2), (-0.05, -0.2), (0.2, 0.0)):
        x = e / 0.1
        e2 = de / 0.1 + x / max(1.0 - x * x, 1e-3)
        expected = -100.0 * e - 20.0 * de if abs(e2) < 0.75 else -5.0 / e2
        u, _ = acceleration(law, 3.0, [e, e], [de, de], ())
        np.testing.assert_allclose(u, expected)


def bump(x, powers):
    size = jnp.abs(x)
    return 1.0 - sum(c * size**p for p, c in powers.items())


def test_prescribed_time_law_uses_the_derivatives_of_its_transformed_errors(nominal):
    law = PrescribedTime(nominal, bound=0.8, speed=3.0, accuracy=0.05, deadline=2.0)
    b = 0.05 / (2**0.5 * 0.8)

    def xi1(e, t):
        beta = (1.0 - b) * (1.0 - t / 2.0) ** 3 + b
        return e / bump(e / (0.8 * beta), {3: 10.0, 4: -15.0, 5: 6.0})

    def xi2(v):
        return v / bump(v / 3.0, {2: 3.0, 3: -2.0})

    for t, e, dq in (
        (0.0, [0.3, -0.2], [1.0, -2.0]),
        (1.2, [0.05, 0.02], [-0.5, 0.1]),
        (1.9, [-0.01, 0.01], [0.0, 2.0]),
    ):
        e, dq = jnp.array(e), jnp.array(dq)
        now = Reference(q=jnp.array([0.2, -0.4]), dq=jnp.zeros(2), ddq=jnp.zeros(2))
        _, command = acceleration(law, t, now.q + e, dq, jnp.asarray(3.0), now)
        mu1, nu = jax.vmap(jax.grad(xi1), (0, None))(e, t), jax.vmap(jax.grad(xi1, 1), (0, None))(e, t)
        mu2, h2 = jax.vmap(jax.grad(xi2))(dq), bump(dq / 3.0, {2: 3.0, 3: -2.0})
        phi = jnp.max(mu1**2) * (jnp.max(h2**2) + 0.2) + jnp.sum(nu**2)
        z = xi2(dq) + (law.k1 + law.r1 * phi) * xi1(e, t) / (mu1 * h2)
        force = (law.k2 * z + mu1 * h2 * xi1(e, t) + law.r2 * 3.0 * law.activity * z) / mu2
        np.testing.assert_allclose(command.tau, -force, rtol=1e-9)


def authors_arm(q, dq, t, first):
    """Inertia, and all torques but the drives', of the two-link arm in the authors' code."""
    m1, m2, l1, l2, g, i1, i2 = 2.0, 0.85, 0.35, 0.31, 9.8, first, 0.02042
    turn, far = m2 * l1 * l2 * jnp.cos(q[1]), m2 * l2 * g * jnp.cos(q[0] + q[1])
    cross, sine = m2 * l2**2 + turn + i2, m2 * l1 * l2 * jnp.sin(q[1])
    mass = jnp.array([[(m1 + m2) * l1**2 + m2 * l2**2 + 2.0 * turn + i1 + i2, cross], [cross, m2 * l2**2 + i2]])
    speed = jnp.array([-sine * dq[1] * (2.0 * dq[0] + dq[1]), sine * dq[0] ** 2])
    weight = jnp.array([(m1 * l2 + m2 * l1) * g * jnp.cos(q[0]) + far, far + 0.1 * jnp.sin(t)])
    return mass, speed + weight


@pytest.mark.parametrize(
    ("deadline", "accuracy", "k1", "r1", "inertia"),
    [
        (2.0, 0.02, 4.0, 2.0, 0.061125),
        (0.5, 0.02, 4.0, 2.0, 0.61125),
        (1.0, 0.03, 3.0, 1.2, 0.61125),
        (1.0, 0.003, 3.0, 1.2, 0.61125),
    ],
)
def test_prescribed_time_law_keeps_its_accuracy_from_its_deadline_on_in_the_authors_cases(
    nominal, deadline, accuracy, k1, r1, inertia
):
    values = {"deadline": deadline, "accuracy": accuracy, "k1": k1, "r1": r1, "bound": 0.3, "speed": 3.0}
    law, h = PrescribedTime(nominal, activity=0.65, **values), 1e-3

    def period(carry, t):
        q, dq, memory = carry
        sine, cosine = 0.3 * jnp.sin(t), 0.3 * jnp.cos(t)
        desired = Reference(*(jnp.stack(pair) for pair in ((sine, cosine), (cosine, -sine), (-sine, -cosine))))
        command = law(t, State(q=q, dq=dq), desired, desired, memory)
        mass, rest = authors_arm(q, dq, t, inertia)
        dq = dq + h * jnp.linalg.solve(mass, command.tau - rest)
        q = q + h * dq
        return (q, dq, command.memory_after(jnp.asarray(h))), (jnp.linalg.norm(q - desired.q), jnp.max(jnp.abs(dq)))

    times = jnp.asarray(h * np.arange(1, 4001))
    _, (error, speed) = jax.lax.scan(period, (jnp.array([0.15, 0.4]), jnp.zeros(2), jnp.zeros(())), times)
    assert 0.0 < np.max(error[times >= deadline]) <= accuracy and np.max(speed) < 3.0
