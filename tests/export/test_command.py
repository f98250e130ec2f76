"""`slidax export c` as a user types it."""

from __future__ import annotations

from tests.cli.commands import in_process


def test_it_writes_the_project_and_says_where_it_is(tmp_path):
    out = tmp_path / "law"
    done = in_process(
        "export", "c", "example-4.1", "--out", str(out), "--name", "arm", "--set", "scheme.surface.k1=0.4"
    )
    assert done.exit_code == 0, done.output
    assert str(out / "README.md") in done.output
    assert "bytes of stack" in done.output
    assert " lines" in done.output
    files = {path.name for path in out.iterdir()}
    assert files == {
        "slidax_arm.h", "slidax_arm.c", "slidax_arm.hpp", "slidax_arm_scenario.h", "slidax_arm_scenario.c",
        "golden.h", "test_arm.c", "latency.c", "example.c", "CMakeLists.txt", "README.md", ".clang-tidy",
    }  # fmt: skip
    assert ".surface_k1 = 0.4," in (out / "slidax_arm.c").read_text()


def test_bad_input_is_one_line_and_exit_code_2(tmp_path):
    for arguments, word in (
        (("example-4.1", "--out", str(tmp_path), "--name", "4x"), "--name"),
        (("example-9", "--out", str(tmp_path)), "unknown scenario"),
        (("example-4.1", "--out", str(tmp_path), "--set", "scheme.overshoot=2"), "overshoot"),
    ):
        done = in_process("export", "c", *arguments)
        assert done.exit_code == 2
        assert word in done.output
        assert len(done.output.strip().splitlines()) == 1
        assert not list(tmp_path.iterdir())
