import re
import shutil
import subprocess

import pytest

from slidax.export.golden_samples import BAD, OF_A_RUN, RANDOM
from slidax.export.micro import export_micro
from slidax.scenarios import load

from .exported import COMPILERS, compiled, copied_with_a_wrong_answer, needs_a_compiler, run

NEEDED = {
    "m4f": ("arm-none-eabi-gcc", "qemu-system-arm"),
    "m7": ("arm-none-eabi-gcc", "qemu-system-arm"),
    "rv64": ("riscv64-unknown-elf-gcc", "qemu-system-riscv64"),
    "linux": ("riscv64-linux-gnu-gcc", "qemu-riscv64"),
}
LAW = ("slidax_law.c", "slidax_law_scenario.c", "test.c", "hosted.c")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("micro")
    export_micro(load("example-4.1"), path, name="law", command="slidax export micro example-4.1")
    return path


def emulated(folder, target):
    missing = [name for name in ("make", *NEEDED[target]) if not shutil.which(name)]
    if missing:
        pytest.skip(f"{' and '.join(missing)} not here")
    return run(folder, "make", "-s", f"test-{target}")


@needs_a_compiler
def test_every_golden_sample_is_answered_as_in_python_and_a_wrong_answer_is_detected(folder, tmp_path):
    compiled(COMPILERS[0], folder, "-O1", *LAW, "-o", "hosted", "-lm")
    result = re.fullmatch(r"golden samples: (\d+) of (\d+)\n", run(folder, "./hosted"))
    assert result[1] == result[2] and OF_A_RUN + RANDOM < int(result[2]) <= OF_A_RUN + RANDOM + BAD
    copied_with_a_wrong_answer(folder, tmp_path)
    compiled(COMPILERS[0], tmp_path, "-O1", *LAW, "-o", "hosted", "-lm")
    done = subprocess.run(["./hosted"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and len(re.findall(r"^sample \d+: s$", done.stdout, re.MULTILINE)) == 10
    passed, of = map(int, re.search(r"golden samples: (\d+) of (\d+)\n$", done.stdout).groups())
    assert passed < of - 100
    (tmp_path / "golden.bin").write_bytes((tmp_path / "golden.bin").read_bytes()[:-1])
    done = subprocess.run(["./hosted"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "ends too early" in done.stdout


@pytest.mark.parametrize(
    "target", ["m7", "rv64", *(pytest.param(target, marks=pytest.mark.full) for target in ("m4f", "linux"))]
)
def test_emulated_law_agrees_with_python_and_reports_stack_and_instructions(folder, target):
    message = emulated(folder, target)
    passed, of = map(int, re.search(r"golden samples: (\d+) of (\d+)", message).groups())
    assert passed == of > OF_A_RUN
    if target == "linux":
        return
    assert 200 < int(re.search(r"stack: (\d+) bytes", message)[1]) < 8192
    mean, most = map(int, re.search(r"a step: (\d+) instructions on average, (\d+) at most", message).groups())
    assert 500 < mean <= most < 100_000


@pytest.mark.full
@pytest.mark.parametrize("target", ["m4f", "m7", "rv64"])
def test_an_emulated_law_in_single_precision_answers_every_golden_sample(target, tmp_path):
    export_micro(load("example-4.1-1khz"), tmp_path, name="law", single=True)
    passed, of = map(int, re.search(r"golden samples: (\d+) of (\d+)", emulated(tmp_path, target)).groups())
    assert passed == of > OF_A_RUN


def test_the_bare_metal_sources_are_complete_and_ascii(folder):
    names = {path.name for path in folder.iterdir() if path.is_file() and path.suffix not in ("", ".bin")}
    assert {"slidax_law.c", "slidax_law.h", "bare.c", "cortex_m.c", "riscv.S", "mps2.ld", "virt.ld"} <= names
    for path in folder.iterdir():
        if path.name in names | {"Makefile"}:
            text = path.read_text()
            assert "{{" not in text and "{%" not in text and text.isascii() | (path.suffix == ".md")
