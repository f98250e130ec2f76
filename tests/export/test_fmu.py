import re
import shutil
import subprocess
import zipfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from benchmarks.targets import importers
from slidax.core.errors import DefinitionError
from slidax.export import fmu as platforms
from slidax.export.fmu import ABSENT, export_fmu
from slidax.export.golden_samples import record_closed_loop
from slidax.scenarios import load

from .exported import STRICT

fmpy = pytest.importorskip("fmpy")
validate_fmu = pytest.importorskip("fmpy.validation").validate_fmu
pytestmark = pytest.mark.skipif(
    not shutil.which("cc") or platforms.this_platform() not in platforms.NAMES, reason="no C compiler is here"
)
HELD = {"simulation.mode": "held", "simulation.integrator": "semi_implicit_euler", "simulation.period": 1e-3}
PERIOD = 1e-3


@pytest.fixture(scope="module")
def scenario():
    return load("example-4.1", HELD)


@pytest.fixture(scope="module")
def units(scenario, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmu")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(platforms, "has_zig", lambda: False)
        return {
            fmi: (folder / f"law{fmi}.fmu", export_fmu(scenario, folder / f"law{fmi}.fmu", name="law", fmi=fmi))
            for fmi in (3, 2)
        }


@pytest.fixture(scope="module")
def run(scenario, units):
    return record_closed_loop(scenario, units[3][1].project.guard, 0.5)


@contextmanager
def opened(file):
    description = fmpy.read_model_description(str(file))
    folder, output = fmpy.extract(str(file)), []

    def log(*options):
        output.append(options[-1].decode())

    fmu = fmpy.instantiate_fmu(folder, description, "CoSimulation", logger=log)
    place = {each.name: each.valueReference for each in description.modelVariables}
    try:
        yield fmu, place, output
    finally:
        fmu.freeInstance()
        shutil.rmtree(folder)


@contextmanager
def running(file, run):
    with opened(file) as (fmu, place, output):
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        columns = importers.inputs(run)

        def sample(k):
            fmu.setFloat64([place[name] for name in columns], [float(values[k]) for values in columns.values()])

        def torque():
            return fmu.getFloat64([place[name] for name in importers.outputs(2)])

        yield fmu, place, output, sample, torque


@pytest.mark.parametrize("fmi", [3, 2])
def test_an_fmu_is_valid_and_gives_the_torques_of_the_run(units, run, fmi):
    file, _ = units[fmi]
    assert validate_fmu(str(file)) == []
    # The importer also sets all declared start values.
    tau, status = importers.by_fmpy(file, run, PERIOD, apply_default_start_values=True)
    assert len(tau) == 500
    np.testing.assert_allclose(tau, run.tau[:500], rtol=0, atol=1e-9)
    assert (status == run.status[:500]).all()


def test_libcosim_computes_the_torques_of_the_run_from_the_fmu(units, run):
    pytest.importorskip("libcosimpy")
    step = importers.libcosim_steps(units[2][0], 2, PERIOD)
    rows = np.stack(list(importers.inputs(run).values()), 1)[:100]
    tau = np.array([step(k * PERIOD, row) for k, row in enumerate(rows)])
    np.testing.assert_allclose(tau, run.tau[:100], rtol=0, atol=1e-9)


@pytest.mark.parametrize("fmi", [3, 2])
def test_fmu_parameters_have_units_ranges_start_values_and_descriptions(units, fmi):
    description = fmpy.read_model_description(str(units[fmi][0]))
    result = {each.name: each for each in description.modelVariables}
    gain = result["parameters.surface_k1"]
    assert (gain.unit, gain.min, gain.causality, gain.variability) == ("rad/s", "0.0", "parameter", "tunable")
    assert float(gain.start) == load("example-4.1").description.scheme.surface.k1
    assert "diagonal of K1" in gain.description
    assert (result["parameters.surface_p"].min, result["parameters.surface_p"].max) == ("0.0", "1.0")
    assert result["parameters.limits_torque[2]"].start == "1e+300"
    assert result["command.tau[2]"].unit == "N.m" and result["measurement.dq[1]"].unit == "rad/s"
    assert result["envelope.margin[1]"].unit is None
    torque = next(each.baseUnit for each in description.unitDefinitions if each.name == "N.m")
    assert (torque.kg, torque.m, torque.s, torque.rad) == (1, 2, -2, 0)
    parameters = [each for each in result.values() if each.causality == "parameter"]
    members = units[fmi][1].project.parameters
    assert len(parameters) == sum(member.size for member in members)
    assert {re.sub(r"parameters\.|\[.*", "", each.name) for each in parameters} == {each.name for each in members}


def test_an_fmu_parameter_acts_from_the_next_sample_and_is_refused_out_of_range(units, run):
    with running(units[3][0], run) as (fmu, place, output, sample, torque):
        sample(0)
        fmu.doStep(0.0, PERIOD)
        before = torque()
        for name, bad, message in (
            ("parameters.surface_p", 1.0, "must be in (0, 1); got 1"),
            ("parameters.surface_p", 0.0, "must be in (0, 1); got 0"),
            ("parameters.surface_k1", float("nan"), "must be a number"),
            ("parameters.surface_k1", 1e300, "must be in (0, inf); got inf"),
            ("command.tau[1]", 1.0, "is not to be set"),
        ):
            with pytest.raises(Exception, match="fmi3SetFloat64"):
                fmu.setFloat64([place[name]], [bad])
            assert output[-1] == f"`{name}` {message}"
        assert len(output) == 5
        fmu.setFloat64([place["parameters.limits_torque[1]"]], [1e300])
        assert fmu.getFloat64([place["parameters.limits_torque[1]"]]) == [1e300]
        fmu.setFloat64([place["parameters.surface_k1"]], [3.0])
        assert torque() == before
        sample(1)
        fmu.doStep(PERIOD, PERIOD)
        assert np.abs(np.array(torque()) - run.tau[1]).max() > 0.1


def test_fmu_steps_below_the_period_hold_the_torque_and_larger_steps_are_refused(units, run):
    with running(units[3][0], run) as (fmu, _, output, sample, torque):
        for k in range(8):
            sample(k // 4 if k % 4 == 0 else 400)
            fmu.doStep(k * PERIOD / 4, PERIOD / 4)
            np.testing.assert_allclose(torque(), run.tau[k // 4], rtol=0, atol=1e-9)
        with pytest.raises(Exception, match="fmi3DoStep"):
            fmu.doStep(2 * PERIOD, 1.5 * PERIOD)
        assert "passes over the sample at 0.003 s: take the period, 0.001 s, or a whole part of it" in output[-1]
        with pytest.raises(Exception, match="fmi3DoStep"):
            fmu.doStep(5 * PERIOD, PERIOD)
        assert output[-1] == "the step begins at 0.005 s, but the time is 0.002 s"
        with pytest.raises(Exception, match="fmi3DoStep"):
            fmu.doStep(2 * PERIOD, 0.0)
        fmu.doStep(2 * PERIOD, PERIOD)


def test_an_fmu_state_can_be_saved_serialised_and_restored(units, run):
    with running(units[3][0], run) as (fmu, _, _, sample, torque):
        sample(0)
        fmu.doStep(0.0, PERIOD)
        state = fmu.getFMUState()
        text = fmu.serializeFMUState(state)
        sample(1)
        fmu.doStep(PERIOD, PERIOD)
        once = torque()
        sample(2)
        fmu.doStep(2 * PERIOD, PERIOD)
        assert torque() != once
        for back in (state, fmu.deserializeFMUState(text)):
            fmu.setFMUState(back)
            sample(1)
            fmu.doStep(PERIOD, PERIOD)
            assert torque() == once
            fmu.freeFMUState(back)


def test_an_invalid_measurement_in_an_fmu_holds_the_torque_and_sets_the_status(units, run):
    with running(units[3][0], run) as (fmu, place, _, sample, torque):
        sample(0)
        fmu.doStep(0.0, PERIOD)
        before, margin = torque(), fmu.getFloat64([place["envelope.margin[1]"]])[0]
        # The start is somewhere inside the envelope.
        assert 0.0 < margin < 0.5
        sample(1)
        fmu.setFloat64([place["measurement.q[2]"]], [float("nan")])
        fmu.doStep(PERIOD, PERIOD)
        assert torque() == before and fmu.getInt32([place["command.status"]]) == [1]
        names = ("measurement_not_finite", "held", "envelope_left")
        assert fmu.getBoolean([place[f"status.{name}"] for name in names]) == [True, True, False]
        assert fmu.getFloat64([place["envelope.margin[1]"]]) == [0.0]


def test_an_fmu_restart_and_a_later_start_time_give_the_first_torque_again(units, run):
    with running(units[3][0], run) as (fmu, place, _, sample, torque):
        for k in range(3):
            fmu.setBoolean([place["restart"]], [k == 2])
            sample(0 if k == 2 else k)
            fmu.doStep(k * PERIOD, PERIOD)
        np.testing.assert_allclose(torque(), run.tau[0], rtol=0, atol=1e-9)
    with opened(units[3][0]) as (fmu, place, _):
        fmu.enterInitializationMode(startTime=7.0)
        fmu.exitInitializationMode()
        columns = importers.inputs(run)
        fmu.setFloat64([place[name] for name in columns], [float(values[0]) for values in columns.values()])
        fmu.doStep(7.0, PERIOD)
        result = fmu.getFloat64([place[name] for name in importers.outputs(2)])
        np.testing.assert_allclose(result, run.tau[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("fmi", [3, 2])
def test_the_fmu_sources_build_without_a_warning_against_the_standard_headers(units, fmi, tmp_path):
    file, _ = units[fmi]
    with zipfile.ZipFile(file) as archive:
        archive.extractall(tmp_path)
    sources = tmp_path / "sources"
    names = [path.name for path in sources.glob("*.c")]
    subprocess.run(["cc", *STRICT, "-O0", "-fsyntax-only", *names], cwd=sources, check=True)
    standard = Path(fmpy.__file__).parent / "c-code"
    both = ["-O0", "-c", "-I", str(standard), "-include", f"fmi{fmi}Functions.h", f"fmi{fmi}.c", "-o", "both.o"]
    subprocess.run(["cc", "-std=c99", "-Wall", "-Werror", *both], cwd=sources, check=True)
    output = (standard / f"fmi{fmi}Functions.h").read_text()
    if fmi == 3:
        text = (sources / "fmi3.c").read_text()
        assert set(re.findall(r"^FMI3_Export .*?(fmi3\w+);", output, re.M)) == set(
            re.findall(r"^FMI3_Export [\w ]+\W(fmi3\w+)\(", text, re.M)
        )
        assert set(ABSENT) <= set(re.findall(r"fmi3\w+", output))
        build = (sources / "buildDescription.xml").read_text()
        assert all(f'name="{name}"' in build for name in names)


def test_invalid_fmu_options_are_refused_and_write_no_file(scenario, tmp_path, monkeypatch):
    with pytest.raises(DefinitionError, match="no binary can be built for `riscv`"):
        export_fmu(scenario, tmp_path / "law.fmu", platforms=["riscv"])
    with pytest.raises(DefinitionError, match="`platforms` must have at least one name; supported: x86_64-linux"):
        export_fmu(scenario, tmp_path / "law.fmu", platforms=[])
    with pytest.raises(DefinitionError, match=r"end in \.fmu"):
        export_fmu(scenario, tmp_path / "law")
    monkeypatch.setattr(platforms, "has_zig", lambda: False)
    with pytest.raises(DefinitionError, match=r"pip install 'slidax\[fmu\]'"):
        export_fmu(scenario, tmp_path / "law.fmu", platforms=["x86_64-windows"])
    monkeypatch.setattr(platforms.shutil, "which", lambda name: None)
    with pytest.raises(DefinitionError, match=r"pip install 'slidax\[fmu\]'"):
        export_fmu(scenario, tmp_path / "law.fmu")
    assert not list(tmp_path.iterdir())
