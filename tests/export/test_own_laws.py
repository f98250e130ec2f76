"""User-defined laws: simulated, linearised, and exported to C that answers as Python does."""

import math
import random
import re
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import slidax as sx
from examples.own_laws import LAWS, PDPlus
from slidax.analysis import linearise, steady_error
from slidax.core import DefinitionError, PerJoint, parameter
from slidax.export import export_c
from slidax.export.golden_samples import answer, random_samples
from slidax.law import AbstractModelBased

from .exported import COMPILERS, Exported, compiled, needs_a_compiler, run


def scenario_of(law):
    scenario = sx.scenarios.load("example-4.1-1khz", {"simulation.t1": 5.0})
    return scenario.replace(controller=law(scenario.controller.nominal))


@needs_a_compiler
@pytest.mark.parametrize("law", LAWS)
def test_a_user_defined_law_answers_in_c_as_in_python(law, tmp_path):
    scenario = scenario_of(law)
    exported = Exported(scenario, tmp_path)
    guard = exported.project.guard
    samples = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, 2000, seed=3)
    command, status = answer(guard, samples)
    answers = exported.answers(samples)
    np.testing.assert_array_equal(answers.status, status)
    size = np.abs(np.asarray(command.tau)).max(1)
    assert np.all(np.abs(answers.command["tau"] - command.tau).max(1) <= 1e-12 * size) and size.max() > 10.0


@pytest.mark.parametrize("law", LAWS)
def test_a_user_defined_law_tracks_in_simulation(law):
    simulated = scenario_of(law).simulate()
    assert simulated.outcome.ok, simulated.outcome.message
    assert np.all(np.asarray(steady_error(simulated)) < 0.05)


@pytest.fixture(scope="module")
def sampled():
    """PD+ in its sampled-data form, for the limits and the delay of the arm."""
    scenario = sx.scenarios.load("example-4.1-1khz", {"simulation.t1": 2.0})
    old = scenario.controller
    law = sx.law.sampled_data(PDPlus(old.nominal), period=scenario.period, delay=1.0, limits=old.limits)
    return scenario.replace(controller=law)


@needs_a_compiler
def test_c_project_of_a_user_defined_law_answers_golden_samples_and_loads_in_python(sampled, tmp_path):
    project = export_c(sampled, str(tmp_path), name="law")
    assert repr(project).startswith("C project `law`: PDPlus on two_link in doubles, at most ")
    sources = ("slidax_law.c", "slidax_law_scenario.c", "test_law.c")
    compiled(COMPILERS[0], tmp_path, "-O2", *sources, "-o", "test_law", "-lm")
    message = run(tmp_path, "./test_law")
    assert int(re.match(r"(\d+) golden samples", message)[1]) > 200 and message.endswith("0 faults\n")
    law = sx.load_export(tmp_path)
    kp = next(name for name in law if name.endswith("kp"))
    assert law[kp].tolist() == 400.0


def test_the_loop_of_a_user_defined_law_has_stability_margins(sampled):
    loop = linearise(sampled, at=1.0)
    assert loop.stable
    for margins in loop.margins("torque"):
        assert margins.gain_up > 1.5 and margins.phase > 30.0


def test_each_run_of_a_batch_of_a_user_defined_law_equals_its_single_run(sampled):
    masses = np.random.default_rng(1).uniform(0.8, 1.2, (200, 2)) * np.array([0.5, 1.5])

    def heavier(scenario, masses):
        return scenario.replace(plant=eqx.tree_at(lambda plant: plant.robot.masses, scenario.plant, masses))

    many = sampled.simulate_batch(heavier, jnp.asarray(masses))
    errors = np.asarray(steady_error(many))
    best, worst = np.argmin(errors.max(-1)), np.argmax(errors.max(-1))
    assert errors[worst].max() > 1.2 * errors[best].max()
    for k in (best, worst):
        alone = heavier(sampled, jnp.asarray(masses[k])).simulate()
        np.testing.assert_allclose(errors[k], steady_error(alone), rtol=1e-6)


class Wrong(AbstractModelBased):
    kp: PerJoint = parameter("diagonal of Kp", "N m/rad", "> 0", default=400.0)

    def __call__(self, t, state, now, following, memory):
        e = state.q - now.q
        return sx.Command(tau=-self.kp * self.effort(e), memory=memory, signals={"e": e})


class Branches(Wrong):
    def effort(self, e):
        return e if e[0] > 0 else 2.0 * e


class CallsNumPy(Wrong):
    def effort(self, e):
        return np.tanh(e)


class CallsMath(Wrong):
    def effort(self, e):
        return e * math.sin(e[0])


class IndexesAList(Wrong):
    def effort(self, e):
        return e * [1.0, 2.0][jnp.argmax(e)]


class Selects(Wrong):
    def effort(self, e):
        return e[e > 0]


class Sorts(Wrong):
    def effort(self, e):
        return jnp.sort(e)


class BranchesAtTheStart(PDPlus):
    def init(self, t, state, reference):
        return jnp.zeros(2) if state.q[0] > 0 else jnp.ones(2)


class Assigns(Wrong):
    def effort(self, e):
        e[0] = 0.0
        return e


class KeepsInItself(Wrong):
    def effort(self, e):
        self.last = e
        return e


class KeepsOutside(Wrong):
    errors: ClassVar[list] = []

    def effort(self, e):
        self.errors.append(e)
        return self.errors[0]


class Prints(Wrong):
    def effort(self, e):
        print(f"{e[0]:.3f}")
        return e


class Misspells(Wrong):
    def effort(self, e):
        return self.gain * e


class HasAnotherShape(Wrong):
    def effort(self, e):
        return jnp.ones((3, 3)) @ e


class Draws(Wrong):
    def effort(self, e):
        return e + random.random()


class ReturnsATorque(Wrong):
    def __call__(self, t, state, now, following, memory):
        return now.q - state.q


class ReturnsNothing(Wrong):
    def __call__(self, t, state, now, following, memory):
        sx.Command(tau=now.q - state.q, memory=memory, signals={})


class CommandsTooManyTorques(Wrong):
    def __call__(self, t, state, now, following, memory):
        return sx.Command(tau=jnp.append(now.q - state.q, 0.0), memory=memory, signals={})


class CountsInPython(Wrong):
    def init(self, t, state, reference):
        return 0


class GrowsItsMemory(Wrong):
    def init(self, t, state, reference):
        return jnp.zeros(2)

    def __call__(self, t, state, now, following, memory):
        return sx.Command(tau=now.q - state.q, memory=jnp.append(memory, 0.0), signals={})


class GrowsItsMemoryNextToARate(Wrong):
    def init(self, t, state, reference):
        return jnp.zeros(2)

    def __call__(self, t, state, now, following, memory):
        grown = jnp.append(memory, 0.0)
        return sx.Command(tau=now.q - state.q, memory=grown, signals={}, rate=jnp.zeros(2))


class SignalsAWord(Wrong):
    def __call__(self, t, state, now, following, memory):
        command = sx.Command(tau=now.q - state.q, memory=memory, signals={})
        # The type checker of the tests would refuse it first.
        object.__setattr__(command, "signals", {"mode": "hold"})
        return command


REMEDIES = {
    Assigns: "`x = x.at[i].set(value)`",
    KeepsInItself: "keep varying values in its memory",
    KeepsOutside: "a compiled law keeps its first value",
    Prints: "jax.debug.print",
    Misspells: "no attribute 'gain'",
    HasAnotherShape: "got (3,) and (2,)",
    Draws: "take random numbers from `jax.random`",
    ReturnsATorque: "`Command(tau=..., memory=memory, signals={})`; got an array",
    ReturnsNothing: "the `return` is missing",
    CommandsTooManyTorques: "an array of 2 torques, one per joint; got shape [3]",
    CountsInPython: "got 0, a int: write `jnp.asarray(0)`",
    GrowsItsMemory: "that `init` gives the memory, float64[2]; got float64[3]",
    GrowsItsMemoryNextToARate: "that `init` gives the memory, float64[2]; got float64[3]",
    SignalsAWord: "the signal `mode` must be made of arrays of numbers; got 'hold'",
    Branches: "jnp.where(condition, a, b)",
    BranchesAtTheStart: "jnp.where(condition, a, b)",
    CallsNumPy: "`jnp.tanh` for `np.tanh`",
    CallsMath: "`jnp.sin` for `math.sin`",
    IndexesAList: "make it an array by `jnp.array`",
    Selects: "jnp.where(mask, x, 0.0)",
    Sorts: "jnp.argmax",
}


@pytest.mark.parametrize("law", REMEDIES)
def test_untraceable_code_is_named_with_its_line_and_remedy(law, tmp_path):
    scenario = scenario_of(law)
    with pytest.raises(DefinitionError) as export:
        export_c(scenario, tmp_path, name="law")
    messages = [str(export.value)]
    if law is not Sorts:  # XLA can sort.
        for engine in ("auto", "xla"):
            with pytest.raises(DefinitionError) as simulation:
                scenario.replace(engine=engine).simulate()
            messages.append(str(simulation.value))
        with pytest.raises(DefinitionError) as batch:
            scenario.simulate_batch(lambda scenario, q: scenario.replace(state0=sx.State(q)), scenario.state0.q[None])
        messages.append(str(batch.value))
    for message in messages:
        assert REMEDIES[law] in message and "\n" not in message
        assert re.search(rf"line \d+ of {re.escape(__file__)}, in `{law.__name__}\.(effort|init|__call__)`", message)


class Strange(Wrong):
    """Integer memory, random numbers, a scan and an error function, all of which the tracer supports."""

    def init(self, t, state, reference):
        return jnp.zeros((), int)

    def __call__(self, t, state, now, following, memory):
        e, de = state.q - now.q, state.dq - now.dq
        half = jax.lax.scan(lambda x, _: (0.5 * x, None), e, None, length=1)[0]
        noise = jax.random.normal(jax.random.fold_in(jax.random.key(0), memory), (2,))
        tau = self.nominal.gravity(state.q) - self.kp * (half + jax.scipy.special.erf(half)) - 60.0 * de + 1e-3 * noise
        return sx.Command(tau=tau, memory=memory + 1, signals={"count": memory.astype(float), "e": noise})


@needs_a_compiler
def test_laws_with_integers_random_numbers_and_scans_agree_in_all_engines_and_c(tmp_path):
    scenario = scenario_of(Strange).replace(t1=0.3)
    native, xla = (scenario.replace(engine=engine).simulate() for engine in ("native", "xla"))
    np.testing.assert_allclose(native.log.tau, xla.log.tau, rtol=1e-8)
    np.testing.assert_allclose(native.log.signals["e"], xla.log.signals["e"], rtol=1e-12)
    assert np.asarray(native.log.signals["count"])[-1] == 300 and np.std(native.log.signals["e"]) > 0.5
    exported = Exported(scenario, tmp_path)
    samples = random_samples(exported.project.guard, scenario.trajectory, scenario.period, scenario.t1, 200, seed=3)
    expected = answer(exported.project.guard, samples)[0].tau
    np.testing.assert_allclose(exported.answers(samples).command["tau"], expected, rtol=1e-9, atol=1e-9)


class Undefined(Wrong):
    def effort(self, e):
        return e * jnp.sqrt(-1.0 - e * e)


def test_a_torque_that_is_nan_at_the_start_ends_the_run_with_an_explanation():
    run = scenario_of(Undefined).replace(t1=0.1).simulate()
    assert run.outcome.kind == "not_finite" and "roots and logarithms" in run.outcome.message
