import pytest

from tests.cli.commands import in_process


def test_export_c_writes_the_project_and_prints_its_path(tmp_path):
    out = tmp_path / "law"
    done = in_process(
        "export", "c", "example-4.1", "--out", str(out), "--name", "arm", "--set", "scheme.surface.k1=0.4", code=0
    )
    assert str(out / "README.md") in done.output and "bytes of stack" in done.output
    assert " lines" in done.output
    files = {path.name for path in out.iterdir()}
    assert files == {
        "slidax_arm.h", "slidax_arm.c", "slidax_arm.hpp", "slidax_arm_scenario.h", "slidax_arm_scenario.c",
        "slidax_arm_flat.h", "slidax_arm_flat.c", "golden.h", "test_arm.c", "latency.c", "example.c",
        "CMakeLists.txt", "README.md", ".clang-tidy", "law.json",
    }  # fmt: skip
    assert ".surface_k1 = 0.4," in (out / "slidax_arm.c").read_text()


@pytest.mark.full
def test_export_ros2_writes_a_package_and_prints_its_path(tmp_path):
    # A law that exports fast, and a short run for its golden samples.
    short = ("--set", "scheme={name: computed_torque}", "--set", "simulation.t1=0.5")
    out = tmp_path / "package"
    done = in_process("export", "ros2", "example-4.1-1khz", "--out", str(out), "--name", "arm", *short, code=0)
    assert str(out / "README.md") in done.output
    assert (out / "src" / "parameters.yaml").is_file() and (out / "law" / "golden.h").is_file()
    # The written node runs without this package.
    imports = [line for line in (out / "node.py").read_text().splitlines() if line.startswith(("import", "from"))]
    assert "import sys" in imports and "slidax" not in "".join(imports)
