import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from slidax.export.golden_samples import answer, random_samples, with_bad_numbers
from slidax.export.status import HELD
from slidax.law import SampledData
from slidax.law.implicit_steps import PRECISION
from slidax.scenarios import catalogue, load

from .exported import Exported, needs_a_compiler

pytestmark = needs_a_compiler

SAMPLES, EXAMPLES = 2500, 4
"""10 000 random states for each pair."""

TOLERANCE = 1e-12
NO_LIMITS = {"actuator": {}}
AT_MID_PERIOD = {
    **NO_LIMITS,
    "robot.nominal.viscous": 0.2,
    "scheme.horizon": 0.02,
    "scheme.sampled_data": {"midpoint": True, "viscous_feedforward": True, "delay": 2.0},
}

ARM_LEARNING = {**NO_LIMITS, "scheme.sampled_data.adaptation": {"kind": "arm_learning"}}

# Torque limits hide most of the law at random states; a single scheme tests the limits.
PAIRS = [
    *((arm, scheme, {}) for arm in ("example-4.1", "example-4.2") for scheme in catalogue()["schemes"]),
    *((f"example-4.{k}-1khz", scheme, NO_LIMITS) for k in (1, 2) for scheme in catalogue()["schemes"]),
    *((arm, "cftsmppc", {}) for arm in ("example-4.1-1khz", "example-4.2-1khz", "panda-payload")),
    ("panda-payload", "cftsmppc", NO_LIMITS),
    ("panda-payload", "computed_torque", AT_MID_PERIOD),
    ("panda-payload", "cftsmppc", ARM_LEARNING),
]
DAILY = ("example-4.1-1khz", "cftsmppc", {})

COMPOSED = {
    "name": "sliding_mode",
    "transformation": {"kind": "unconstrained"},
    "surface": {"kind": "linear", "rate": 5.0},
    "reaching": {"kind": "fixed_time", "gain": 0.1, "exponent": 1.2, "layer": 0.05},
    "bound": {"kind": "fixed", "size": 30.0},
}
"""A generic sliding-mode scheme whose parts no preset combines."""


def named(pair):
    arm, scheme, changes = pair
    kinds = ((NO_LIMITS, ", no limits"), (AT_MID_PERIOD, ", at mid-period"), (ARM_LEARNING, ", arm learning"))
    return f"{scheme}, {arm}{next((text for kind, text in kinds if changes == kind), '')}"


def slack(guard, samples):
    law = guard.controller
    if not isinstance(law, SampledData) or law.horizon is None:
        return 0.0
    stiffness = np.abs(jax.vmap(law.nominal.mass)(samples.state.q)).sum(-1).max(-1)
    return 2.0 * PRECISION * stiffness / float(law.horizon)


@pytest.mark.parametrize(
    "pair", [pytest.param(pair, marks=[pytest.mark.full] if pair != DAILY else [], id=named(pair)) for pair in PAIRS]
)
def test_c_and_python_agree_in_torque_and_status_with_repeatable_bits(pair, tmp_path):
    arm, scheme, changes = pair
    if scheme == COMPOSED["name"]:
        sampled = {"sampled_data": {}} if arm.endswith("khz") else {}
        scenario = load(arm, {"scheme": COMPOSED | sampled, **changes})
    else:
        scenario = load(arm, {"scheme.name": scheme, **changes})
    exported = Exported(scenario, tmp_path)
    leaves, tree = jax.tree.flatten(exported.project.guard)

    @settings(max_examples=EXAMPLES)
    @given(st.integers(0, 2**31), st.integers(0, len(leaves) - 1), st.floats(0.95, 1.05))
    def compare(seed, which, factor):
        guard = jax.tree.unflatten(tree, [leaf * (factor if k == which else 1.0) for k, leaf in enumerate(leaves)])
        samples = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, SAMPLES, seed=seed)
        command, status = answer(guard, samples)
        parameters = exported.parameters(guard)
        answers = exported.answers(samples, parameters)
        np.testing.assert_array_equal(answers.status, status)
        off = np.abs(answers.command["tau"] - command.tau).max(1)
        size = np.abs(np.asarray(command.tau)).max(1)
        assert np.all(off <= TOLERANCE * size + slack(guard, samples)), (off / size).max()
        again = exported.answers(samples, parameters)
        assert all(a.tobytes() == b.tobytes() for a, b in zip(answers, again, strict=True))

    compare()


@pytest.mark.full
@pytest.mark.parametrize("name", ["example-4.1", "example-4.2-1khz"])
def test_bad_inputs_to_c_give_pythons_status_and_a_finite_torque_within_limits(name, tmp_path):
    scenario = load(name, {"actuator.torque": 50.0})
    assert scenario.plant.actuator is not None
    exported = Exported(scenario, tmp_path)
    guard = exported.project.guard
    samples = with_bad_numbers(random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, 2000, seed=5))
    _, status = answer(guard, samples)
    answers = exported.answers(samples)
    np.testing.assert_array_equal(answers.status, status)
    assert np.isfinite(answers.command["tau"]).all() and (np.abs(answers.command["tau"]) <= 50.0).all()
    held = (answers.status & HELD) != 0
    assert 0.3 < held.mean() < 1.0
    # Before the first command, a held step commands zero torque.
    before = np.where(np.asarray(samples.memory.commanded)[:, None], samples.memory.tau, 0.0)[held]
    np.testing.assert_array_equal(answers.command["tau"][held], before)
    np.testing.assert_array_equal(answers.memory["t"][held], np.asarray(samples.memory.t)[held])


def test_a_changed_parameter_takes_effect_in_the_next_step(tmp_path):
    scenario = load("example-4.1")
    exported = Exported(scenario, tmp_path)
    guard = exported.project.guard
    samples = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, 50, seed=6)
    # The step computes the workspace again only after a change.
    assert exported.project.workspace
    torques = []
    for power in (0.5, 0.6, 0.5):
        changed = eqx.tree_at(lambda g: g.controller.surface.p, guard, jnp.asarray(power))
        parameters = exported.parameters()
        parameters["surface_p"] = power
        command, _ = answer(changed, samples)
        tau = exported.answers(samples, parameters, fresh=False).command["tau"]
        np.testing.assert_allclose(tau, command.tau, rtol=1e-11)
        torques.append(tau)
    assert np.abs(torques[1] - torques[0]).max() > 1e-3


def test_single_precision_c_agrees_with_python_within_1_percent_in_99_percent_of_samples(tmp_path):
    scenario = load("example-4.2")
    exported = Exported(scenario, tmp_path, single=True)
    guard = exported.project.guard
    samples = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, 2000, seed=8)
    command, _ = answer(guard, samples)
    answers = exported.answers(samples)
    tau = np.asarray(command.tau)
    size = np.abs(tau).max(1)
    off = np.abs(answers.command["tau"] - tau).max(1)
    # A step that is held before the first command has zero torque.
    assert not off[size == 0].any()
    off = off[size > 0] / size[size > 0]
    assert np.median(off) < 1e-4 and np.quantile(off, 0.99) < 1e-2
