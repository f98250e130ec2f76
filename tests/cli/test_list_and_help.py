import io
import json
import re
import subprocess
import sys

import pytest
from typer.main import get_command

import slidax
from slidax import scenarios
from slidax.cli import app
from slidax.cli.common import columns, complete_scenarios, wrapped

from .commands import in_process


def test_list_shows_every_built_in_scenario_with_a_line():
    result = in_process("list", "scenarios", code=0)
    lines = result.stdout.splitlines()
    assert [line.split()[0] for line in lines] == scenarios.names()
    assert all(len(line.split()) > 2 for line in lines)


@pytest.mark.parametrize(
    ("kind", "member"),
    [
        *(("schemes", "cftsmppc"), ("robots", "scara"), ("trajectories", "minimum_jerk")),
        *(("disturbances", "friction"), ("estimators", "kalman"), ("sensors", "encoders")),
        ("performance", "finite_time"),
    ],
)
def test_list_shows_the_parts_of_each_kind(kind, member):
    assert member in json.loads(in_process("list", kind, "--json").stdout)[kind]
    assert member in in_process("list", kind).stdout and member in in_process("list").stdout


def test_h_is_short_for_help_in_commands_and_subcommands():
    for words in ((), ("run",), ("export",), ("export", "c")):
        assert in_process(*words, "-h", code=0).stdout == in_process(*words, "--help", code=0).stdout


def test_shell_completion_offers_scenario_names_and_files(monkeypatch, tmp_path):
    (tmp_path / "panda-mine.yaml").write_text("", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert {"panda-mine.yaml", "panda-payload"} <= set(complete_scenarios("panda"))
    assert complete_scenarios("example-4.2") == ["example-4.2", "example-4.2-1khz"]


COMMANDS = [
    *((name,) for name in get_command(app).commands if name != "export"),
    *(("export", name) for name in get_command(app).commands["export"].commands),
]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_the_help_of_each_command_shows_an_example(command):
    result = in_process(*command, "--help", code=0)
    assert f"Example: slidax {' '.join(command)} " in " ".join(result.stdout.split())


def _condensed(text):
    return re.sub(r"[\s`\u2500-\u257f]", "", text)


@pytest.mark.parametrize("command", [(), ("export",), *COMMANDS], ids=lambda words: " ".join(words) or "slidax")
def test_help_shows_the_complete_text_including_units(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    shown = _condensed(in_process(*command, "--help").stdout)
    described = get_command(app)
    for word in command:
        described = described.commands[word]
    texts = [described.help or "", *(item.help or "" for item in described.params)]
    texts += [item.get_short_help_str(1000) for item in getattr(described, "commands", {}).values()]
    assert any(texts)
    for text in texts:
        assert _condensed(text) in shown, text


@pytest.mark.parametrize("command", [(), ("export",), *COMMANDS], ids=lambda words: " ".join(words) or "slidax")
def test_help_fits_80_columns_without_truncated_words(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    lines = in_process(*command, "--help").stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert not [line for line in lines if re.search(r"…\s*│", line)]


def test_paragraphs_of_help_fill_the_width_of_the_terminal(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = [line.strip() for line in in_process("run", "--help").stdout.splitlines()]
    start = next(k for k, line in enumerate(text) if line.startswith("--set scheme.name=NAME"))
    paragraph = text[start : text.index("", start)]
    assert len(paragraph) > 3 and all(len(line) > 50 for line in paragraph[:-1])


def test_help_and_version_answer_without_importing_jax():
    program = (
        "import sys; from typer.testing import CliRunner; from slidax.cli import app\n"
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0\n"
        "print(CliRunner().invoke(app, ['--version']).stdout.strip(), 'jax' in sys.modules)"
    )
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout
    assert answer.split("\n")[0] == f"slidax {slidax.__version__} False"


def test_schema_prints_the_schema_of_scenario_files():
    assert json.loads(in_process("schema").stdout) == json.loads(json.dumps(scenarios.schema()))


def test_ctrl_c_prints_one_line_and_exits_with_130(monkeypatch, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("slidax.design.problem.read_problem", interrupted)
    result = in_process("design", str(tmp_path / "x.yaml"), "--out", str(tmp_path / "y.yaml"), code=130)
    assert result.stderr.splitlines() == ["slidax: interrupted: the same command starts again from the beginning"]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_messages_wrap_between_words_with_a_hanging_indent_and_unbroken_commands(width):
    command = "`--set 'scheme.sampled_data.adaptation={kind: joint_learning}'`"
    text = f"1. joint 4: its torque is at its limit in 61 % of the samples. Remedy: {command} (tried successfully)."
    lines = wrapped(text, width, margin="  ", hang=3).split("\n")
    assert " ".join(line.strip() for line in lines) == text and len(lines) > 1
    assert lines[0].startswith("  1. ") and all(line.startswith("     ") for line in lines[1:])
    assert any(command in line for line in lines) and max(len(line) for line in lines if command not in line) <= width


def test_messages_to_a_pipe_are_not_wrapped(monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    assert columns(io.StringIO()) is None and wrapped(40 * "word ", None) == 40 * "word "
    monkeypatch.setenv("COLUMNS", "72")
    assert columns(io.StringIO()) == 72


@pytest.mark.parametrize("width", ["80", "120"])
def test_lists_of_parts_fit_the_terminal(width, monkeypatch):
    monkeypatch.setenv("COLUMNS", width)
    for command in (("list",), ("list", "schemes"), ("list", "cftsmppc")):
        lines = in_process(*command).stdout.splitlines()
        assert max(map(len, lines)) <= int(width), max(lines, key=len)
