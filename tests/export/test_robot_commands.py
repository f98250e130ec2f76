import pytest

from tests.cli.commands import in_process

WITHOUT = ("--set", "scheme={name: computed_torque}", "--set", "simulation.t1=0.5")
"""A law that exports fast, and a short run for its golden samples."""


@pytest.mark.full
def test_export_ros2_writes_a_package_and_prints_its_path(tmp_path):
    out = tmp_path / "package"
    done = in_process("export", "ros2", "example-4.1-1khz", "--out", str(out), "--name", "arm", *WITHOUT, code=0)
    assert str(out / "README.md") in done.output
    assert (out / "src" / "parameters.yaml").is_file() and (out / "law" / "golden.h").is_file()
    # The written node runs without this package.
    assert "slidax" not in "".join(
        line for line in (out / "node.py").read_text().splitlines() if line.startswith(("import", "from"))
    )
