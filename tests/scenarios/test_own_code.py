"""Scenario files that name a user's class, which needs permission to run code."""

import warnings

import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.scenarios.own_code import VARIABLE
from slidax.scenarios.yaml_text import as_yaml
from tests.cli.commands import in_process
from tests.export.exported import COMPILERS, compiled, needs_a_compiler, run

SOURCES = ("slidax_law.c", "slidax_law_scenario.c", "test_law.c")

MODULE = '''
import jax.numpy as jnp

from slidax.core import Command, PerJoint, parameter
from slidax.law import AbstractModelBased, AbstractSurface


class Straight(AbstractSurface):
    """`k e`."""

    slope: PerJoint = parameter("k", "1/s", "> 0")

    def phi_and_slope(self, eps):
        return self.slope * eps, self.slope * jnp.ones_like(eps)

    def reach(self, phi):
        return phi / self.slope


class Other:
    pass


class Unfinished(AbstractSurface):
    """Without its functions."""


class Simple(AbstractModelBased):
    """Computed torque with two gains."""

    kp: PerJoint = parameter("kp", "1/s²", "> 0", default=100.0)
    kd: PerJoint = parameter("kd", "1/s", "> 0", default=20.0)
    # The laws of the package have parts of this name.
    bound: PerJoint = parameter("largest acceleration", "rad/s²", "> 0", default=1e9)

    def __call__(self, t, state, now, following, memory):
        u = now.ddq - self.kp * (state.q - now.q) - self.kd * (state.dq - now.dq)
        u = jnp.clip(u, -self.bound, self.bound)
        tau = self.nominal.mass(state.q) @ u + self.nominal.bias(state.q, state.dq)
        return Command(tau=tau, memory=memory, signals={})
'''


@pytest.fixture
def own_file(tmp_path, monkeypatch):
    """A scenario with a user's surface, next to its module."""
    monkeypatch.delenv(VARIABLE, raising=False)
    # The variable is restored after a test that sets it.
    monkeypatch.setenv(VARIABLE, "0")
    (tmp_path / "straight_surface.py").write_text(MODULE, encoding="utf-8")
    (tmp_path / "broken.py").write_text("x = 0\ny = 1 / x\n", encoding="utf-8")
    text = as_yaml(scenarios.load("example-4.1-1khz").description)
    return tmp_path, text


def surface(kind, **values):
    return {"scheme.surface": {"kind": kind, **values}, "simulation.t1": 1.0}


def parsed(own_file, kind="straight_surface:Straight", **values):
    folder, text = own_file
    return scenarios.parse(text, surface(kind, **({"slope": 0.6} | values)), folder=folder)


def test_a_users_surface_is_refused_unless_code_is_allowed(own_file):
    with pytest.raises(DefinitionError, match=r"scheme\.surface.*slidax --allow-code COMMAND"):
        parsed(own_file)


def test_a_users_surface_runs_and_survives_a_yaml_round_trip(own_file):
    scenarios.allow_code()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        description = parsed(own_file)
        again = scenarios.parse(as_yaml(description), folder=own_file[0])
    for each in (description, again):
        assert float(each.build("own").controller.step.surface.slope) == 0.6
    linear = scenarios.load("example-4.1-1khz", surface("linear", rate=0.6)).simulate()
    np.testing.assert_allclose(again.build("own").simulate().tally.steady_error, linear.tally.steady_error, rtol=1e-9)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("broken:Surface", r"line 2 of .*broken\.py: ZeroDivisionError"),
        ("straight_surface:Unfinished", "must define `phi_and_slope` and `reach`"),
        ("straight_surface:Other", "must be a class derived from `AbstractSurface`"),
        ("straight_surface:Missing", "cannot import `straight_surface:Missing`"),
        ("no_such_module:Straight", "No module named 'no_such_module'"),
    ],
)
def test_a_class_that_is_no_surface_is_refused(own_file, kind, message):
    scenarios.allow_code()
    with pytest.raises(DefinitionError, match=message):
        parsed(own_file, kind)


def test_parameters_of_a_users_surface_are_checked_against_its_declarations(own_file):
    scenarios.allow_code()
    with pytest.raises(DefinitionError, match="unknown key `slop`; did you mean `slope`"):
        parsed(own_file, slop=1.0)
    with pytest.raises(DefinitionError, match="must be > 0"):
        parsed(own_file, slope=-1.0).build("own")


def test_the_flag_allow_code_lets_a_scenario_run_a_users_class(own_file, monkeypatch):
    folder, text = own_file
    (folder / "mine.yaml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(folder)
    change = "scheme.surface={kind: 'straight_surface:Straight', slope: 0.6}"
    short = ["--set", change, "--set", "simulation.t1=0.05"]
    assert "--allow-code" in in_process("run", "mine.yaml", *short, code=2).output
    in_process("--allow-code", "run", "mine.yaml", *short, code=0)


LAW = "straight_surface:Simple"


@pytest.fixture
def own_law(own_file):
    """A scenario whose scheme is a user's law, with or without its sampled-data form."""

    def of(printed=False, **values):
        folder, text = own_file
        changes = {"scheme.name": LAW, "simulation.t1": 1.0, **{f"scheme.{k}": v for k, v in values.items()}}
        if printed:
            changes["scheme.sampled_data"] = None
        return scenarios.parse(text, changes, folder=folder)

    return of


def test_a_users_law_is_refused_unless_code_is_allowed(own_law):
    with pytest.raises(DefinitionError, match=r"scheme.*slidax --allow-code COMMAND"):
        own_law()


@pytest.mark.parametrize("printed", [False, pytest.param(True, marks=pytest.mark.full)])
def test_a_users_law_runs_like_the_built_in_law_after_a_yaml_round_trip(own_law, own_file, printed):
    scenarios.allow_code()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = scenarios.parse(as_yaml(own_law(printed, kp=80.0)), folder=own_file[0])
    assert again.scheme.name == LAW
    ours = {"scheme.name": "computed_torque", "scheme.kp": 80.0, "scheme.kd": 20.0, "simulation.t1": 1.0}
    if printed:
        ours["scheme.sampled_data"] = None
    expected = scenarios.load("example-4.1-1khz", ours).simulate()
    run = again.build("own").simulate()
    np.testing.assert_allclose(run.log.tau, expected.log.tau, rtol=1e-6, atol=1e-6)


def test_parameters_of_a_users_law_are_checked_against_its_declarations(own_law):
    scenarios.allow_code()
    with pytest.raises(DefinitionError, match="unknown key `kq`"):
        own_law(kq=1.0)
    with pytest.raises(DefinitionError, match="must be > 0"):
        own_law(kp=-1.0).build("own")


@pytest.mark.full
@needs_a_compiler
def test_the_command_line_exports_a_users_law_to_c(own_file, monkeypatch):
    folder, text = own_file
    (folder / "mine.yaml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(folder)
    in_process(
        "--allow-code",
        "export",
        "c",
        "mine.yaml",
        "--set",
        f"scheme.name={LAW}",
        "--name",
        "law",
        "--out",
        "law",
        code=0,
    )
    compiled(COMPILERS[0], folder / "law", *SOURCES, "-o", "test_law", "-lm")
    assert run(folder / "law", "./test_law").endswith("0 faults\n")
