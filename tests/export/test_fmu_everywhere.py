import struct
import subprocess
import zipfile

import numpy as np
import pytest

from benchmarks.targets import importers
from slidax.export import fmu
from slidax.export.fmu import NAMES, PLATFORMS, export_fmu
from slidax.export.golden_samples import record_closed_loop
from slidax.scenarios import load

pytest.importorskip("fmpy")
pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not fmu.has_zig(), reason="ziglang is not installed: pip install 'slidax[fmu]'"),
]
MAGIC = {".so": b"\x7fELF", ".dll": b"MZ", ".dylib": b"\xcf\xfa\xed\xfe"}


@pytest.fixture(scope="module")
def scenario():
    return load("example-4.1-1khz")


@pytest.fixture(scope="module")
def file(scenario, tmp_path_factory):
    path = tmp_path_factory.mktemp("fmu") / "law.fmu"
    export_fmu(scenario, path)
    return path


@pytest.fixture(scope="module")
def older(scenario, tmp_path_factory):
    path = tmp_path_factory.mktemp("older") / "law.fmu"
    export_fmu(scenario, path, fmi=2, platforms=[fmu.this_platform()])
    return path


@pytest.fixture(scope="module")
def ours(scenario):
    return scenario.replace(t1=5.0).simulate().log


def test_the_fmu_has_a_binary_with_the_main_functions_for_every_platform(file):
    with zipfile.ZipFile(file) as archive:
        for each in PLATFORMS:
            inside = archive.read(f"binaries/{each.name}/slidax_example_4_1_1khz{each.ending}")
            assert inside.startswith(MAGIC[each.ending])
            for name in (b"fmi3InstantiateCoSimulation", b"fmi3DoStep", b"fmi3GetFloat64", b"fmi3SetFMUState"):
                assert name in inside
    assert len(NAMES) == 5


def test_the_apple_silicon_binary_has_a_code_signature(file):
    with zipfile.ZipFile(file) as archive:
        inside = archive.read("binaries/aarch64-darwin/slidax_example_4_1_1khz.dylib")
    place, kinds = 32, []
    for _ in range(struct.unpack_from("<I", inside, 16)[0]):
        kind, size = struct.unpack_from("<II", inside, place)
        kinds.append(kind)
        place += size
    code_signature = 0x1D
    assert code_signature in kinds


def test_exporting_an_fmu_twice_gives_identical_files(scenario, file, tmp_path):
    export_fmu(scenario, tmp_path / "again.fmu")
    assert (tmp_path / "again.fmu").read_bytes() == file.read_bytes()


@pytest.mark.parametrize("importer", ["fmpy", "libcosimpy"])
def test_an_fmu_in_the_loop_moves_the_arm_as_the_law_does(scenario, file, older, ours, importer):
    pytest.importorskip(importer)
    if importer == "fmpy":
        with importers.fmpy_steps(file, 2, scenario.period) as step:
            log = importers.in_our_loop(scenario, step, 5.0).log
    else:
        log = importers.in_our_loop(scenario, importers.libcosim_steps(older, 2, scenario.period), 5.0).log
    np.testing.assert_allclose(log.state.q, ours.state.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(log.tau, ours.tau, rtol=0, atol=1e-9)


@pytest.mark.parametrize("platform", ["x86_64-windows", "aarch64-linux"])
def test_fmu_binaries_for_other_platforms_give_the_same_torques(scenario, file, platform, tmp_path):
    if importers.lacks(platform):
        pytest.skip(f"{importers.lacks(platform)} is not here")
    run = record_closed_loop(scenario, export_guard(scenario), 0.2)
    tau = importers.by_host(file, run, scenario.period, platform, tmp_path)
    np.testing.assert_allclose(tau, run.tau, rtol=0, atol=1e-8)


def export_guard(scenario):
    from slidax.export.c_project import project

    return project(scenario, with_golden=False).guard


def test_a_failing_compiler_is_reported_in_one_line(scenario, tmp_path, monkeypatch):
    from slidax.core.errors import DefinitionError

    def failed(*_, **__):
        return subprocess.CompletedProcess([], 1, "", "error: no room\nmore")

    monkeypatch.setattr(fmu.subprocess, "run", failed)
    with pytest.raises(DefinitionError, match=r"the compiler for x86_64-linux failed: error: no room$"):
        export_fmu(scenario, tmp_path / "law.fmu", platforms=["x86_64-linux"])
