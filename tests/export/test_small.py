import re
import shutil

import pytest

from slidax.codegen.ir import Loop, functions
from slidax.codegen.passes import count_iterations
from slidax.core.root_finding import ITERATIONS as SEARCH_OF_PLAN
from slidax.export.c_project import project
from slidax.law.reaching_laws import STEPS as SEARCH_OF_S
from slidax.scenarios import load

from .exported import compiled, needs_a_compiler, run, write_law

ARM = ("arm-none-eabi-gcc", "-std=c99", "-Os", "-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "-mthumb")
ARMS = ("ur5e-payload", "panda-payload")
NODE = re.compile(r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes')
EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')


@pytest.fixture(scope="module")
def panda(tmp_path_factory):
    folder = tmp_path_factory.mktemp("panda")
    exported_law = project(load("panda-payload"), name="law", with_golden=False)
    write_law(exported_law, folder)
    return folder, exported_law


def deepest(folder):
    """Bytes of the stack on the worst path through the calls, as gcc reports."""
    text = (folder / "law.ci").read_text()
    own = {name: int(size) for name, size in NODE.findall(text)}
    calls = {}
    for caller, called in EDGE.findall(text):
        calls.setdefault(caller, set()).add(called)

    def below(name):
        return own.get(name, 0) + max((below(item) for item in calls.get(name, ())), default=0)

    return below("slidax_law_step")


def test_the_c_code_of_a_panda_has_under_3400_lines_and_functions_for_frames_and_inertia(panda):
    folder, exported_law = panda
    text = (folder / "slidax_law.c").read_text()
    assert len(text.splitlines()) < 3400
    names = {program.name for program in functions(exported_law.step.answered.program)}
    assert names >= {"frames", "links", "inertia", "bias", "factors", "substituted", "matvec"}
    for name in names:
        assert len(re.findall(rf"^static void {name}\(", text, re.MULTILINE)) >= 1, name
    assert all(len(line) <= 140 for line in text.splitlines())


def test_every_loop_and_the_operation_count_of_an_exported_step_are_bounded(panda):
    _, exported_law = panda
    program = exported_law.step.answered.program
    every = [value for item in (program, *functions(program)) for value in item.walk() if isinstance(value, Loop)]
    assert {count_iterations(loop) for loop in every} >= {SEARCH_OF_S, SEARCH_OF_PLAN - 1}
    assert all(count_iterations(loop) is not None for loop in every)
    # If each search took its largest number of iterations, a step would take about three times as long.
    assert (
        exported_law.longest.operations < 200_000 and f"{exported_law.longest.operations}" in exported_law.longest_text
    )


@needs_a_compiler
@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not here")
@pytest.mark.parametrize("optimisation", ["-Os", "-O2", pytest.param("-O3", marks=pytest.mark.full)])
def test_the_stack_bound_holds_and_is_tight(panda, optimisation):
    folder, exported_law = panda
    compiled("gcc", folder, optimisation, "-fcallgraph-info=su", "-c", "slidax_law.c", "-o", "law.o")
    used = deepest(folder)
    assert used <= exported_law.stack <= 1.5 * used


@pytest.mark.full
@pytest.mark.parametrize("single", [False, True], ids=["doubles", "floats"])
@pytest.mark.parametrize(
    "name", ["example-4.1", "example-4.1-1khz", "example-4.2-1khz", "ur5e-payload", "panda-payload"]
)
def test_no_export_takes_more_stack_than_its_bound(name, single, tmp_path):
    exported_law = project(load(name), name="law", single=single, with_golden=False)
    write_law(exported_law, tmp_path)
    for optimisation in ("-Os", "-O1", "-O2", "-O3"):
        compiled("gcc", tmp_path, optimisation, "-fcallgraph-info=su", "-c", "slidax_law.c", "-o", "law.o")
        assert deepest(tmp_path) <= exported_law.stack, optimisation


@pytest.mark.skipif(not shutil.which(ARM[0]), reason="arm-none-eabi-gcc is not here")
def test_the_panda_law_fits_a_cortex_m7(panda):
    folder, exported_law = panda
    run(folder, *ARM, "-fcallgraph-info=su", "-c", "slidax_law.c", "-o", "law.o")
    code = int(run(folder, "arm-none-eabi-size", "law.o").splitlines()[1].split()[0])
    assert code < 70_000
    used = deepest(folder)
    assert used <= exported_law.stack <= 1.5 * used
