"""Odd names, paths, files and folders: one line and exit code 2, whatever they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from .commands import in_process

SHORT = ("--set", "simulation.t1=0.01")


def assert_one_line(words: list[str], *arguments: str) -> None:
    result = in_process(*arguments)
    line = result.stderr.strip()
    assert result.exit_code == 2, line
    assert line.startswith("slidax: ") and len(line.splitlines()) == 1 and len(line) < 1500
    for word in words:
        assert word in line


SETTINGS = {
    ".scale=1": ["is no path"],
    "disturbance.=1": ["is no path"],
    "disturbance..scale=1": ["`disturbance..scale` is no path"],
    "..=1": ["is no path"],
    "trajectory.offset.x=1": ["list of 2", "`x`"],
    "trajectory.offset.-1=1": ["list of 2"],
    "trajectory.offset.²=1": ["list of 2"],
    f"trajectory.offset.{'9' * 5000}=1": ["list of 2"],
    "title.0=1": ["`title` is a single value"],
    "größe=1": ["unknown key `größe`"],
    "a\nb=1": ["unknown key `a\\nb`"],
    f"{'k' * 10000}=1": ["unknown key"],
    "robot=&a [*a]": ["part of"],
    "title=" + "[" * 5000: ["levels"],
    f"title={'1' * 5000}": ["not valid YAML"],
    "title=!!float ''": ["not valid YAML"],
    "title=2001-13-45": ["not valid YAML"],
    "start.q=!!set {a}": ["start.q"],
    f"scheme.overshoot={[0.5] * 1000}": ["overshoot"],
    "simulation.period=1e-300": ["periods"],
    "simulation.t1=1e12": ["at most 1e+09 periods"],
    "simulation.substeps=1000000000000": ["simulation.substeps", "<= 10000"],
    "simulation.log_every=1000000000000": ["simulation.log_every", "<= 1e+09"],
    "sensor.delay=1e12": ["sensor.delay", "<= 100"],
    "sensor.jitter=1e12": ["sensor.jitter", "<= 100"],
    "actuator.dead_time=1e12": ["actuator.dead_time", "<= 100"],
    "sensor.loss={outages: [{start: 0, samples: 1000000000000}]}": ["outages.0.samples", "<= 1e+09"],
    "trajectory={kind: minimum_jerk, times: [0, 1], waypoints: [[-0.4, 2.5], [1]]}": ["waypoints.1", "got 1"],
    "trajectory={kind: trapezoidal, waypoints: [[-0.4, 2.5], []], velocity: 1, acceleration: 1}": ["waypoints.1"],
    "trajectory={kind: quintic, waypoints: [[1], [1, 2]], velocity: 1, acceleration: 1}": ["waypoints.0"],
}


@pytest.mark.parametrize("change", SETTINGS, ids=lambda change: change[:40])
def test_odd_settings_are_one_line(change: str) -> None:
    assert_one_line(SETTINGS[change], "run", "example-4.1-1khz", "--set", change)


@pytest.mark.parametrize("name", ["", ".", "..", "a.b.c", "ü\n", "x" * 10000, "\x1b[31m", "schemes."])
def test_odd_names_of_parts_are_one_line(name: str) -> None:
    assert_one_line(["there is nothing called"], "list", name)


LAUGHS = "a: &a0 [1, 1]\n" + "".join(f"b{k}: &a{k + 1} [{', '.join([f'*a{k}'] * 10)}]\n" for k in range(12))

TEXTS = {
    "empty": (b"", "a scenario is a mapping"),
    "binary": (b"\x00\x01\xff\xfe", "not UTF-8"),
    "zeros": (b"\x00" * 100, "not valid YAML"),
    "list": (b"[1, 2]", "a scenario is a mapping"),
    "laughs": (LAUGHS.encode(), "aliases written out"),
    "itself": (b"&a {title: *a}", "part of"),
    "deep": (b"title: " + b"[" * 60 + b"]" * 60, "levels"),
    "bottomless": (b"title: " + b"[" * 3000, "levels"),
    "long": (b"title: [" + b"1," * 1_000_000 + b"1]", "characters"),
    "twice": (b"title: a\ntitle: b", "not valid YAML"),
    "keys": (b"{1: 2, null: 3, [1]: 4}", "a key must be text; got `1`"),
    "tag": (b"!!python/object:os.system x", "not valid YAML"),
}


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.full] if kind == "bottomless" else []) for kind in TEXTS]
)
def test_a_file_that_is_no_scenario_is_one_line(kind: str, tmp_path: Path) -> None:
    text, words = TEXTS[kind]
    path = tmp_path / "odd.yaml"
    path.write_bytes(text)
    assert_one_line([words], "run", str(path))
    if kind == "list":
        # All read alike.
        assert_one_line([words], "compare", str(path))
        assert_one_line([words], "export", "c", str(path), "--out", str(tmp_path / "law"))


def test_folders_and_links_that_lead_nowhere_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "loop.yaml").symlink_to(tmp_path / "loop.yaml")
    (tmp_path / "gone.yaml").symlink_to(tmp_path / "nowhere")
    for name in ("folder.yaml", "loop.yaml", "gone.yaml"):
        assert_one_line(["cannot read", name], "run", str(tmp_path / name))


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    taken.write_text("a file")
    assert_one_line(["cannot write", "taken"], "run", "example-4.1-1khz", *SHORT, "--out", str(taken))
    assert_one_line(["taken"], "export", "c", "example-4.1-1khz", "--out", str(taken))


def test_a_panic_of_a_foreign_library_is_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class PanicException(BaseException):
        """As PyO3 raises it."""

    def panic(*_: object) -> None:
        raise PanicException("called `Result::unwrap()` on an `Err` value\nnote: run with RUST_BACKTRACE=1")

    monkeypatch.setattr("slidax.runtime.logs.mcap_files.read_mcap", panic)
    assert_one_line(["a library crashed (called `Result::unwrap()`"], "replay", str(tmp_path / "x.mcap"))
