"""The error equation of the theorem holds to rounding on data from an independent simulation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.certify.motion.joint_loop import JointLoop

from .cases import desired, knotted, panda
from .plant import Chain, simulate


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_both_sides_of_the_error_equation_agree_on_simulated_data(delay: int) -> None:
    """`ë = K (s + w) + ρ` with `K = M⁻¹ M0`, and w from the model error, the band and friction."""
    arm, rng, p = panda(), np.random.default_rng(2), 0.05
    loop = JointLoop.with_density(1e-3, 0.02, 0.1, 1e-5, delay)
    motion = knotted(arm, rng, 0.6)
    slots, sub = 300, 2
    reference = desired(motion, loop.period, slots, sub, delay)
    nominal = Chain.of(arm)
    truth = nominal.member(rng, p)
    push = rng.normal(size=(slots * sub, 7)) * 0.2
    run = simulate(truth, nominal, loop, reference, slots, sub, push=push, resolution=1e-5, trace=True)
    assert run.trace is not None
    q, dq, ddq, commanded, model_q, model_dq = np.moveaxis(run.trace.reshape(-1, 6, 7), 1, 0)
    at, following = (reference[i::sub][:slots, 1] for i in (0, sub))
    mean = np.repeat((following - at) / loop.period, sub, axis=0)
    forward = np.repeat(0.5 * (at + following), sub, axis=0) * np.asarray(arm.viscous)

    mass, bias = jax.vmap(arm.mass), jax.vmap(arm.bias)
    model = jnp.einsum("kij,kj->ki", mass(model_q), commanded) + bias(model_q, model_dq)
    own = jnp.einsum("kij,kj->ki", mass(q), commanded) + bias(q, dq)
    true_mass, true_bias = dynamics(truth, q, dq)
    unknown = np.einsum("kij,kj->ki", true_mass - mass(q), mean) + true_bias - bias(q, dq)
    friction = truth.viscous * dq - forward - push
    w = np.linalg.solve(mass(q), (model - own - unknown - friction)[..., None])[..., 0]
    s = commanded - mean
    ratio = np.linalg.solve(true_mass, mass(q))
    predicted = mean + np.einsum("kij,kj->ki", ratio, s + w)
    # Before the law's first command, the torques hold the arm.
    decided = slice(delay * sub, None)
    np.testing.assert_allclose(ddq[decided], predicted[decided], atol=1e-9 * np.max(np.abs(ddq)))


def dynamics(chain: Chain, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    from .test_body_points import torque_of

    nothing = np.zeros_like(q)
    still = torque_of(chain, q, nothing, nothing)
    mass = np.stack([torque_of(chain, q, nothing, nothing + row) - still for row in np.eye(q.shape[1])], axis=2)
    return mass, torque_of(chain, q, dq, nothing)


def test_eigenvalues_of_the_inertia_ratio_stay_within_the_band() -> None:
    arm, rng, p = panda(), np.random.default_rng(0), 0.05
    chain = Chain.of(arm)
    q = rng.uniform(-2.5, 2.5, size=(200, 7))
    nominal, _ = dynamics(chain, q, np.zeros_like(q))
    largest = 0.0
    for _ in range(5):
        true, _ = dynamics(chain.member(rng, p), q, np.zeros_like(q))
        ratios = np.linalg.eigvals(np.linalg.solve(nominal, true)).real
        largest = max(largest, np.abs(ratios - 1.0).max())
    assert 0.5 * p < largest <= p + 1e-9
