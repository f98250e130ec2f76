"""Calm steps: least changes of the torque while the error is well inside its envelope."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from slidax.certify.arm.inertia_ratio import linear_loops
from slidax.certify.motion.admission import CertifiedLaw
from slidax.core.errors import DefinitionError
from slidax.core.types import Reference, State
from slidax.law.calm_step import DAMPING, TURN, WAIT, Calm, CalmStep, gains
from slidax.law.steps import StepInput
from slidax.plant.actuators import TorqueLimits
from slidax.scenarios import load
from tests.certify.motion.test_hand_over import PANDA, SCHEMES

H = 1e-3
CALM = {"scheme.sampled_data.calm": True}


@pytest.fixture(scope="module")
def scenario():
    return load("example-4.1-1khz", {**CALM, "simulation.t1": 4.0})


@pytest.fixture(scope="module")
def run(scenario):
    return scenario.simulate()


@pytest.mark.parametrize("bandwidth", [1.0, 60.0, 140.0, 900.0])
def test_gains_place_the_poles_of_the_bandwidth(bandwidth):
    gain = np.array([float(each[0]) for each in gains(jnp.array([bandwidth]), jnp.asarray(H))])
    keeps, moves = np.array([[1.0, H, 0.5 * H * H], [0.0, 1.0, H], [0.0, 0.0, 1.0]]), np.array([0.5 * H * H, H, 1.0])
    poles = np.linalg.eigvals(keeps - np.outer(moves, gain))
    d = bandwidth * H
    expected = np.exp([-d, d * (-DAMPING + 1j * TURN), d * (-DAMPING - 1j * TURN)])
    # A triple root near 1 is known to the cube root of the rounding.
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(expected), atol=1e-4 * d + 1e-12)


def moment_of(step, q, dq, disturbance, *, t=5.0, planned=True, settled=True):
    still = jnp.zeros(2)
    robot = step.robot
    return StepInput(
        t=jnp.asarray(t),
        state=State(q=q, dq=dq),
        reference=Reference(q=still, dq=still, ddq=still),
        mass=robot.mass(q),
        bias=robot.bias(q, dq),
        robot=robot,
        limits=TorqueLimits(),
        period=jnp.asarray(H),
        horizon=jnp.asarray(0.012),
        planned=jnp.asarray(planned),
        expected=dq,
        disturbance=disturbance,
        settled=jnp.asarray(settled),
    )


@pytest.fixture(scope="module")
def step(scenario):
    return scenario.controller.step


@pytest.fixture(scope="module")
def decide(step):
    return eqx.filter_jit(step)


@pytest.fixture(scope="module")
def calm_memory(step, decide):
    """The memory after the waiting time inside the envelope."""
    still = jnp.zeros(2)
    memory = step.init(
        jnp.zeros(()), State(q=still, dq=still), Reference(still, still, still), jnp.asarray(H), jnp.asarray(0.012)
    )
    for _ in range(round(WAIT / H) + 2):
        memory = decide(moment_of(step, still, still, still), memory).memory
    assert (memory.inside >= WAIT).all()
    # The usual change of the disturbance on this arm.
    return eqx.tree_at(lambda memory: memory.usual, memory, still + 20.0)


def test_calm_step_without_an_error_answers_only_to_a_change_of_the_disturbance(step, decide, calm_memory):
    still, change = jnp.zeros(2), jnp.array([0.3, -0.2])
    decision = decide(moment_of(step, still, still, change), calm_memory)
    k3 = gains(decision.signals["bandwidth"], jnp.asarray(H))[2]
    # `τ = M (a - w)`: the change of w is compensated except for the share K3.
    np.testing.assert_allclose(decision.acceleration, change * (1.0 - k3), rtol=1e-6)


def test_a_calm_step_aims_inside_the_envelope_for_any_state(step, decide, calm_memory):
    rng = np.random.default_rng(0)
    frame = step.transformation.frame(jnp.asarray(5.0), jnp.asarray(0.0115), jnp.asarray(0.012), calm_memory.plan.sides)
    calm = 0
    for _ in range(40):
        q, dq = jnp.asarray(rng.uniform(-4e-4, 4e-4, 2)), jnp.asarray(rng.uniform(-0.05, 0.05, 2))
        decision = decide(moment_of(step, q, dq, jnp.asarray(rng.uniform(-50.0, 50.0, 2))), calm_memory)
        y, acceleration = q + 0.0115 * dq, decision.acceleration
        place = (0.012 * (0.012 * acceleration + dq) + y) / frame.ahead
        is_calm = np.asarray(decision.signals["calm"]) == 1.0
        calm += is_calm.sum()
        room = float(step.calm.room) + 1e-9
        inside = (place >= room * frame.sides.lower) & (place <= room * frame.sides.upper)
        assert np.asarray(inside)[is_calm].all()
    assert calm > 10


@pytest.mark.parametrize("change", ["far", "lost", "new", "unsettled", "sudden"])
def test_the_underlying_step_replaces_calm_steps_outside_the_calm_region(step, decide, calm_memory, change):
    still = jnp.zeros(2)
    far = jnp.array([0.05, 0.0]) if change == "far" else still
    memory = calm_memory
    if change == "new":
        memory = step.restarted(jnp.asarray(5.0), memory)
    disturbance = still + 200.0 if change == "sudden" else still
    moment = moment_of(step, far, still, disturbance, planned=change != "lost", settled=change != "unsettled")
    decision = decide(moment, memory)
    assert decision.signals["calm"].tolist() == ([0.0, 1.0] if change == "far" else [0.0, 0.0])


def test_the_bandwidth_grows_while_the_error_is_large_and_falls_again(step, decide, calm_memory):
    envelope = step.envelope(jnp.asarray(5.0), calm_memory)
    still, off = jnp.zeros(2), jnp.array([0.15, 0.0]) * jnp.minimum(envelope.upper, -envelope.lower)
    memory = calm_memory
    for _ in range(20):
        decision = decide(moment_of(step, off, still, still), memory)
        memory = decision.memory
    assert memory.pace[0] > 1.05 and memory.pace[1] == 1.0
    back = decide(moment_of(step, still, still, still), memory).memory
    assert 1.0 < back.pace[0] < memory.pace[0]


def test_calm_steps_hold_the_envelope_with_half_the_torque_noise(run):
    own = load("example-4.1-1khz", {"simulation.t1": 4.0}).simulate()
    late = np.asarray(run.log.t) > 2.5

    def noise(log):
        # Second differences: those of the motion's own torque are negligible.
        return np.sqrt(np.mean(np.diff(np.asarray(log.tau)[late], n=2, axis=0) ** 2))

    assert np.mean(np.asarray(run.log.signals["calm"])[late]) > 0.9
    lower, upper = (np.asarray(side) for side in (run.log.envelope.lower, run.log.envelope.upper))
    assert ((np.asarray(run.log.e) > lower) & (np.asarray(run.log.e) < upper)).all()
    assert noise(run.log) < 0.5 * noise(own.log)


def test_calm_true_gives_the_default_calm_step_and_false_gives_no_calm_step():
    assert isinstance(load("example-4.1-1khz", CALM).controller.step, CalmStep)
    assert not isinstance(load("example-4.1-1khz", {"scheme.sampled_data.calm": False}).controller.step, CalmStep)


@pytest.mark.parametrize("scheme", ["ftsmc", "computed_torque"])
def test_a_law_without_an_envelope_has_no_calm_step(scheme):
    with pytest.raises(DefinitionError, match="leave `calm` out"):
        load("example-4.1-1khz", {**CALM, "scheme": {"name": scheme, "sampled_data": {"calm": True}}})


def test_certificates_name_calm_steps_as_not_covered(scenario):
    with pytest.raises(DefinitionError, match=r"leave `scheme.sampled_data.calm` out"):
        CertifiedLaw.of(load(PANDA, {"scheme": SCHEMES["cftsmppc"], "tolerance": None, **CALM}))
    assert "leave `scheme.sampled_data.calm` out" in linear_loops(scenario)


def test_calm_settings_for_another_number_of_joints_are_refused():
    with pytest.raises(DefinitionError, match="2 joints"):
        CalmStep(load("example-4.1-1khz").controller.step, Calm(bandwidth=jnp.ones(3)))


def test_super_twisting_in_an_envelope_can_have_calm_steps():
    law = load("example-4.1-1khz").controller
    twisting = sx.law.super_twisting(law.nominal, transformation=law.step.transformation)
    sampled = sx.law.sampled_data(twisting, period=H, calm=Calm())
    assert isinstance(sampled.step, CalmStep)
