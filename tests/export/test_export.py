import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from slidax.core.errors import DefinitionError
from slidax.export import export_c
from slidax.export.c_project import project
from slidax.export.status import CONDITIONS
from slidax.scenarios import load

from .exported import COMPILERS, STRICT, compiled, copied_with_a_wrong_answer, needs_a_compiler, run, write_law

pytestmark = needs_a_compiler
LAW = ("slidax_law.c",)
WITH_SCENARIO = ("slidax_law.c", "slidax_law_scenario.c")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("doubles")
    return folder, export_c(load("example-4.1"), folder, name="law", command="slidax export c example-4.1")


@pytest.fixture
def doubles(exported):
    return exported[0]


@pytest.fixture(scope="module")
def in_floats(tmp_path_factory):
    folder = tmp_path_factory.mktemp("floats")
    export_c(load("example-4.1-1khz"), folder, name="law", single=True)
    return folder


@pytest.fixture(scope="module")
def panda(tmp_path_factory):
    folder = tmp_path_factory.mktemp("panda")
    export_c(load("panda-payload"), folder, name="law")
    return folder


@pytest.fixture(params=["doubles", *(pytest.param(name, marks=pytest.mark.full) for name in ("in_floats", "panda"))])
def folder(request):
    return request.getfixturevalue(request.param)


@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_project_builds_without_a_warning_and_answers_the_golden_samples(folder, compiler):
    for program in ("test_law", "latency", "example"):
        compiled(compiler, folder, "-O2", *WITH_SCENARIO, f"{program}.c", "-o", f"{program}_{compiler}", "-lm")
    message = run(folder, f"./test_law_{compiler}")
    assert int(re.match(r"(\d+) golden samples", message)[1]) > 200 and message.endswith("0 faults\n")


def test_a_wrong_answer_of_the_law_fails_the_c_test(doubles, tmp_path):
    copied_with_a_wrong_answer(doubles, tmp_path)
    compiled(COMPILERS[0], tmp_path, *WITH_SCENARIO, "test_law.c", "-o", "test_law", "-lm")
    done = subprocess.run(["./test_law"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and ": s\n" in done.stdout


@pytest.mark.parametrize("compiler", COMPILERS)
def test_sanitizers_report_no_error(folder, compiler):
    checks = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    compiled(compiler, folder, *checks, *WITH_SCENARIO, "test_law.c", "-o", f"checked_{compiler}", "-lm")
    assert run(folder, f"./checked_{compiler}").endswith("0 faults\n")


@pytest.mark.skipif(not shutil.which("valgrind"), reason="valgrind is not here")
def test_valgrind_reports_no_error(doubles):
    compiled(COMPILERS[0], doubles, "-g", "-O1", *WITH_SCENARIO, "test_law.c", "-o", "plain", "-lm")
    run(doubles, "valgrind", "--quiet", "--error-exitcode=1", "./plain")


@pytest.mark.full
@pytest.mark.skipif(not shutil.which("cmake"), reason="cmake is not here")
def test_cmake_builds_and_tests_the_project(exported):
    folder, law = exported
    run(folder, "cmake", "-S", ".", "-B", "build")
    run(folder, "cmake", "--build", "build")
    assert "100% tests passed" in run(folder, "ctest", "--test-dir", "build")
    frames = [int(line.split("\t")[1]) for line in run(folder, "cmake", "--build", "build", "-t", "stack").splitlines()
              if "\tstatic" in line]  # fmt: skip
    assert 0 < max(frames) <= law.stack


@pytest.mark.parametrize("optimisation", ["-O1", "-O3"])
def test_the_stack_stays_below_its_stated_bound(exported, optimisation):
    folder, law = exported
    for compiler in COMPILERS:
        compiled(compiler, folder, optimisation, f"-Wframe-larger-than={law.stack}", "-c", *LAW, "-o", "framed.o")
    compiled("gcc", folder, optimisation, "-fstack-usage", "-c", *LAW, "-o", "used.o")
    used = [int(line.split("\t")[1]) for line in (folder / "used.su").read_text().splitlines()]
    assert 0 < sum(used) <= law.stack


@pytest.mark.skipif(not shutil.which("clang-tidy"), reason="clang-tidy is not here")
@pytest.mark.parametrize(
    "file",
    [
        "slidax_law.c",
        *(
            pytest.param(file, marks=pytest.mark.full)
            for file in ("slidax_law_scenario.c", "test_law.c", "latency.c", "example.c")
        ),
    ],
)
def test_clang_tidy_reports_no_warning(folder, file):
    run(folder, "clang-tidy", "--quiet", file, "--", "-std=c99")


def test_the_code_has_no_allocation_global_state_or_recursion(folder):
    text = (folder / "slidax_law.c").read_text()
    assert not re.search(r"\b(malloc|calloc|realloc|free|alloca)\b", text)
    compiled(COMPILERS[0], folder, "-O0", "-c", *LAW, "-o", "law.o")
    sections = dict(line.split()[:2] for line in run(folder, "size", "-A", "law.o").splitlines() if line[:1] == ".")
    assert int(sections[".data"]) == int(sections[".bss"]) == 0
    bodies = re.findall(r"^(?:static )?(?:inline )?\w+ (\w+)\([^;{]*\)\n\{(.*?)^\}", text, re.MULTILINE | re.DOTALL)
    names = [name for name, _ in bodies]
    assert "slidax_law_step" in names and "answered" in names
    # Each function calls only those that stand before it.
    for k, (name, inside) in enumerate(bodies):
        assert not any(re.search(rf"\b{later}\(", inside) for later in names[k:]), name


def test_each_function_of_the_step_has_one_return_at_its_end_and_no_jumps(folder):
    text = re.sub(r"/\*.*?\*/", "", (folder / "slidax_law.c").read_text(), flags=re.DOTALL)
    assert not re.search(r"\b(goto|switch|continue|setjmp|longjmp)\b", text)
    bodies = re.findall(r"^\{(.*?)^\}", text, re.MULTILINE | re.DOTALL)
    assert len(bodies) > 8
    for body in bodies:
        assert body.count("return ") <= 1
        # Behind the last statement at the outermost level there is nothing.
        assert "return " not in body or re.search(r"^    return [^;]*;\n$", body, re.MULTILINE), body
    # A loop counts up to a number or down to 0, or has a counter in its condition.
    for head in re.findall(r"\bfor \((.*)\) \{", text):
        up, down = r"(?:\w+ (\w+) = 0)?; \w+ < (?:\d+|n); \+\+\w+", r"; n (?:>= 4; n -= 4|> 0; --n)"
        assert head == ";;" or re.fullmatch(f"{up}|{down}", head), head
    conditions = re.findall(r"for \(;;\) \{(.*?)break;", text, re.DOTALL) + re.findall(r"while \((.*)\) \{", text)
    assert all(re.search(r"\bstep\w* < \d+", item) for item in conditions)


def test_c_code_of_example_4_1_is_short_and_keeps_the_papers_names(doubles):
    text = (doubles / "slidax_law.c").read_text()
    assert len(text.splitlines()) < 1000
    for name in ("s_1", "eps1_2", "rho_1", "tau0_1", "tau1_2", "u", "slope_1", "alpha_2"):
        assert re.search(rf"const double {name} = ", text), name
    for equation in ("eq. (20)", "eq. (23)", "eq. (29)", "eq. (41)", "eqs. (45), (46)"):
        assert equation in text
    assert text.isascii() and max(map(len, text.splitlines())) <= 120


def test_the_header_names_units_meanings_and_defaults(doubles):
    header = (doubles / "slidax_law.h").read_text()
    for line in (
        " *     1  rad       rad/s     N m",
        "double q[2];  /* positions [rad] */",
        "double surface_p;     /* 0.5: exponent near zero, in (0, 1) */",
        "double bound_inverse_inertia_min; /* 0.09: m1 <= |M^-1(q)|, 1/(kg m^2), > 0 */",
        "q_next[2];   /* positions one period later [rad]; not read by this law, may be anything */",
        "limits_torque[2]; /* none: largest torque, N m or N, > 0, infinite for no limit */",
        "#define SLIDAX_LAW_ENVELOPE_LEFT 16u",
    ):
        assert line in header
    assert header.isascii()


@pytest.mark.full
def test_header_of_a_panda_lists_its_nominal_parameters_and_their_values(panda):
    header = (panda / "slidax_law.h").read_text()
    for member in ("nominal_masses[7]", "nominal_inertias[63]", "nominal_armature[7]", "nominal_payload_mass;"):
        assert member in header, member
    assert " -0.02872," in header


def test_the_exported_readme_explains_every_status_bit_and_shows_a_control_loop(exported):
    folder, law = exported
    readme = (folder / "README.md").read_text()
    for condition in CONDITIONS:
        assert f"`{condition.name}` ({condition.bit})" in readme
    assert "clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME" in readme
    assert f"at most {law.stack} bytes" in readme and "{{" not in readme and "None" not in readme


def test_the_latency_program_prints_percentiles_and_draws_a_picture(doubles):
    compiled(COMPILERS[0], doubles, "-O2", *WITH_SCENARIO, "latency.c", "-o", "latency", "-lm")
    message = run(doubles, "./latency", "5000", "picture.svg")
    times = [
        float(re.search(rf"^{name} +(\d+) ns$", message, re.MULTILINE)[1]) for name in ("p50", "p99", "p99.9", "max")
    ]
    assert times == sorted(times) and message.count("#") > 50
    picture = (doubles / "picture.svg").read_text()
    words = [element.text for element in ElementTree.fromstring(picture).iter() if element.text]
    assert any("p99.9" in word for word in words) and "time of one step [µs]" in words


def test_the_c_example_runs_for_the_given_time_and_prints_the_tracking_errors(doubles):
    compiled(COMPILERS[0], doubles, "-O2", *WITH_SCENARIO, "example.c", "-o", "example", "-lm")
    start, errors = run(doubles, "./example", "0.05").split(" the errors are ")
    assert re.fullmatch(r"500 periods, \d+ late; at t = 0\.050 s", start)
    # They were -0.6 and 0.5 rad at the start, and decrease slowly.
    first, second = map(float, errors.split())
    assert -0.6 < first < -0.55 and 0.45 < second < 0.5


def test_the_c_example_counts_each_period_that_ends_after_its_deadline(doubles):
    text, count = re.subn(r"#define PERIOD_NS \d+L", "#define PERIOD_NS 1L", (doubles / "example.c").read_text())
    assert count == 1
    (doubles / "hurried.c").write_text(text)
    compiled(COMPILERS[0], doubles, "-O2", *WITH_SCENARIO, "hurried.c", "-o", "hurried", "-lm")
    assert run(doubles, "./hurried", "1e-7").startswith("100 periods, 100 late; ")


@pytest.mark.skipif(not shutil.which("g++"), reason="g++ is not here")
def test_the_c_plus_plus_wrapper_gives_the_torque_of_the_step(doubles):
    (doubles / "wrapped.cpp").write_text(WRAPPED)
    compiled(COMPILERS[0], doubles, "-c", *WITH_SCENARIO)
    strict = [option for option in STRICT if not option.startswith("-std")]
    objects = [name.replace(".c", ".o") for name in WITH_SCENARIO]
    run(doubles, "g++", "-std=c++17", *strict, "-fno-exceptions", "wrapped.cpp", *objects, "-o", "wrapped", "-lm")
    assert run(doubles, "./wrapped") == "same\n"


WRAPPED = """
#include "slidax_law.hpp"
#include "slidax_law_scenario.h"
#include <algorithm>
#include <cstdio>
#include <limits>

namespace law = slidax::law;

int main() {
    law::Controller controller;
    controller.parameters.surface_k1 *= 2.0;
    slidax_law_measurement measured;
    slidax_law_reference wanted;
    slidax_law_state state;
    slidax_law_command command;
    slidax_law_reset(&state);
    slidax_law_plant plant;
    slidax_law_start(&plant);
    slidax_law_measure(&plant, &measured);
    slidax_law_motion(0.0, controller.parameters.period, &wanted);
    (void)slidax_law_step(&measured, &wanted, &state, &controller.parameters, &command);

    law::Measurement sample;
    law::Reference reference;
    std::copy(measured.q, measured.q + law::joints, sample.q.begin());
    std::copy(wanted.q, wanted.q + law::joints, reference.q.begin());
    std::copy(wanted.dq, wanted.dq + law::joints, reference.dq.begin());
    std::copy(wanted.ddq, wanted.ddq + law::joints, reference.ddq.begin());
    const law::Status status = controller.step(sample, reference);
    bool same = status == law::Status::ok && !law::held(status);
    for (std::size_t i = 0; i < law::joints; ++i) {
        same = same && controller.tau()[i] == command.tau[i] && controller.tau()[i] != 0.0;
    }
    sample.q[1] = std::numeric_limits<double>::quiet_NaN();
    const law::Status bad = controller.step(sample, reference);
    same = same && law::held(bad) && law::has(bad, law::Status::measurement_not_finite);
    std::puts(same ? "same" : "different");
}
"""


def test_exporting_a_law_twice_gives_identical_files(doubles, tmp_path):
    again = project(load("example-4.1"), name="law", command="slidax export c example-4.1", with_golden=False)
    write_law(again, tmp_path)
    for file in tmp_path.iterdir():
        assert file.read_text() == (doubles / file.name).read_text()


@pytest.mark.parametrize("name", ["3arm", "Arm", "a-b", "", "x" * 41])
def test_a_name_that_is_invalid_in_c_is_refused(name, tmp_path):
    with pytest.raises(DefinitionError, match="cannot be the law's name in C"):
        export_c(load("example-4.1"), tmp_path, name=name)


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DefinitionError, match="cannot write the project"):
        export_c(load("example-4.1"), Path(tmp_path / "file"), name="law")
