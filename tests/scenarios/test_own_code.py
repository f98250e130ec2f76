"""A scenario file names a class of the user's own, where that is allowed."""

import warnings

import numpy as np
import pytest

from slidax import scenarios
from slidax.core.errors import DefinitionError
from slidax.scenarios.own_code import VARIABLE
from slidax.scenarios.yaml_text import as_yaml
from tests.cli.commands import in_process

MODULE = '''
import jax.numpy as jnp

from slidax.core import PerJoint, parameter
from slidax.law import AbstractSurface


class Straight(AbstractSurface):
    """`k e`."""

    slope: PerJoint = parameter("k", "1/s", "> 0")

    def phi_and_slope(self, eps):
        return self.slope * eps, self.slope * jnp.ones_like(eps)

    def reach(self, phi):
        return phi / self.slope


class Other:
    pass
'''


@pytest.fixture
def own_file(tmp_path, monkeypatch):
    """A scenario with a surface of the user's own, next to its module."""
    monkeypatch.delenv(VARIABLE, raising=False)
    # The variable is restored after a test that sets it.
    monkeypatch.setenv(VARIABLE, "0")
    (tmp_path / "straight_surface.py").write_text(MODULE, encoding="utf-8")
    text = as_yaml(scenarios.load("example-4.1-1khz").description)
    return tmp_path, text


def surface(kind, **values):
    return {"scheme.surface": {"kind": kind, **values}, "simulation.t1": 1.0}


def parsed(own_file, kind="straight_surface:Straight", **values):
    folder, text = own_file
    return scenarios.parse(text, surface(kind, **({"slope": 0.6} | values)), folder=folder)


def test_code_is_refused_unless_it_is_allowed(own_file):
    with pytest.raises(DefinitionError, match=r"scheme\.surface.*slidax --allow-code COMMAND"):
        parsed(own_file)


def test_an_own_surface_runs_and_is_written_into_a_file_again(own_file):
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
        ("straight_surface:Other", "must be a class derived from `AbstractSurface`"),
        ("straight_surface:Missing", "cannot import `straight_surface:Missing`"),
        ("no_such_module:Straight", "No module named 'no_such_module'"),
    ],
)
def test_a_class_that_is_no_surface_is_refused(own_file, kind, message):
    scenarios.allow_code()
    with pytest.raises(DefinitionError, match=message):
        parsed(own_file, kind)


def test_values_of_an_own_class_are_checked_by_its_declarations(own_file):
    scenarios.allow_code()
    with pytest.raises(DefinitionError, match="unknown key `slop`; did you mean `slope`"):
        parsed(own_file, slop=1.0)
    with pytest.raises(DefinitionError, match="must be > 0"):
        parsed(own_file, slope=-1.0).build("own")


def test_the_flag_of_the_command_line_allows_code(own_file, monkeypatch):
    folder, text = own_file
    (folder / "mine.yaml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(folder)
    change = "scheme.surface={kind: 'straight_surface:Straight', slope: 0.6}"
    short = ["--set", change, "--set", "simulation.t1=0.05"]
    assert "--allow-code" in in_process("run", "mine.yaml", *short, code=2).output
    in_process("--allow-code", "run", "mine.yaml", *short, code=0)
